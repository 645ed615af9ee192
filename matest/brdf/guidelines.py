"""Which components of Li and Torrance's model a surface needs: guidelines A to F of their section 4."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from matest.brdf.li_torrance import LiTorrance


@dataclass(frozen=True)
class Assembly:
    """A model with the components that a surface needs.

    Attributes:
        model: with all other components switched off.
        reasons: why each component, and masking, is in the model or left out.
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
    components = {
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
        "subsurface": (
            not metal,
            "E: light enters a dielectric and is scattered back evenly",
            "no light leaves a metal that has entered it",
        ),
        "forward": (
            forward_scattering and not metal,
            "F: measurements show it",
            "no light leaves a metal that has entered it" if metal else "F: only on evidence from measurements",
        ),
    }
    reasons = {name: present if needed else absent for name, (needed, present, absent) in components.items()}
    reasons["masking"] = (
        "C: facets shadow and mask each other"
        if masked
        else "eq. 7: S > 0.99 at all directions used"
        if rough
        else "C: negligible on a smooth or slightly rough surface"
    )
    reasons["fresnel"] = (
        "D: nearly constant on a metal: give its f0, near 1" if metal else "D: necessary on a dielectric"
    )
    switches: dict[str, Any] = {name: "on" if needed else "off" for name, (needed, _, _) in components.items()}
    return Assembly(LiTorrance(masking="on" if masked else "off", **switches), reasons)
