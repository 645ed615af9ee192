"""Which components of Li and Torrance's model a surface needs: guidelines A to F of their section 4."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from matest.brdf.li_torrance import LiTorrance


@dataclass(frozen=True)
class Assembly:
    """A model with the components that a surface needs.

    Attributes:
        model: all other components are off.
        reasons: why the model has each component, and masking, or why it has not.
    """

    model: LiTorrance
    reasons: dict[str, str]


def assemble(
    *,
    metal: bool,
    rough: bool,
    mirror_at_grazing: bool = False,
    angular_variation: bool = True,
    forward_scattering: bool = False,
    masked: bool | None = None,
) -> Assembly:
    """The components that a surface with these properties needs.

    Args:
        metal: a conductor; otherwise a dielectric.
        rough: moderately or very rough, so that facets shadow each other; otherwise smooth or slightly rough.
        mirror_at_grazing: a mirror image emerges at large angles of illumination.
        angular_variation: the reflection visibly changes with the angles; otherwise it looks perfectly diffuse.
        forward_scattering: measurements show light scattered forward from below the surface (dielectrics only).
        masked: whether light or viewer ever stand so low that facets hide each other (beyond `unmasked_angle`); by
            default on every rough surface.

    Source: Li & Torrance 2005, section 4.
    """
    masked = rough if masked is None else masked
    closed = "no light leaves a metal that has entered it"
    not_rough = "C: negligible on a smooth or slightly rough surface"
    no_masking = "eq. 7: S > 0.99 at all directions used" if rough else not_rough
    guidelines: dict[str, tuple[bool, str, str]] = {
        "coherent": (
            mirror_at_grazing and angular_variation,
            "A: a mirror image emerges at large angles of illumination",
            "A: no mirror image emerges, even at large angles",
        ),
        "directional": (
            angular_variation,
            "B: the reflection varies with the angles",
            "B: the reflection looks perfectly diffuse",
        ),
        "uniform": (
            metal and rough,
            "E: light is scattered several times between the facets of a rough metal",
            "E: negligible on a smooth metal" if metal else "E: on a dielectric the subsurface component outshines it",
        ),
        "subsurface": (not metal, "E: light enters a dielectric and is scattered back evenly", closed),
        "forward": (
            forward_scattering and not metal,
            "F: measurements show it",
            closed if metal else "F: only on evidence from measurements",
        ),
        "masking": (masked, "C: facets shadow and mask each other", no_masking),
    }
    reasons = {name: reason if needed else objection for name, (needed, reason, objection) in guidelines.items()}
    fresnel = "D: nearly constant on a metal: give its f0, near 1" if metal else "D: necessary on a dielectric"
    switches: dict[str, Any] = {name: "on" if needed else "off" for name, (needed, _, _) in guidelines.items()}
    return Assembly(LiTorrance(**switches), reasons | {"fresnel": fresnel})
