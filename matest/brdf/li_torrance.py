"""Li and Torrance's model: five components, each a model of its own, and their sum."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from matest.brdf import declarations
from matest.brdf.base import Brdf
from matest.brdf.fresnel import schlick_weight
from matest.brdf.microfacet import decay
from matest.brdf.rough_surface import Roughness, RoughSurface
from matest.brdf.terms import Term, complement_of, lambertian
from matest.directions import Directions
from matest.parameters import Role, option

_SWITCH = ("on", "off")
_COHERENT = {"coherent": ("on",)}


@dataclass(frozen=True, eq=False)
class DirectionalDiffuse(RoughSurface):
    """Light reflected once by the facets of a rough surface.

    f = k F S D/(π cos θi cos θr) = k F S Dn/(4 cos θi cos θr)

    D, the rough limit of He and Torrance's, is exactly Beckmann's distribution Dn of slope 2 σe/τ with the
    normalisation 1/4. F is Schlick's; S and σe are the paper's approximations to Smith's functions. `k_dd` scales;
    the rest as in `RoughSurface`.

    Source: Li & Torrance 2005, eq. 5-10 and 20-25, without the (2π/λ)² that the print leaves in D. Limits: without
    masking the albedo diverges at grazing incidence.
    """

    k_dd: Tensor = declarations.amplitude("scale of the directional-diffuse light")

    name: ClassVar[str] = "li-torrance-directional"
    source: ClassVar[str] = "Li & Torrance 2005, eq. 9-10"

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        return surface_terms(self.roughness(directions).lobe(directions), directions)


@dataclass(frozen=True, eq=False)
class FirstSurfaceDiffuse(Brdf):
    """Light scattered several times between the facets of a rough metal: f = k/π.

    Source: Li & Torrance 2005, eq. 11.
    """

    k_udf: Tensor = declarations.k_udf()

    name: ClassVar[str] = "li-torrance-uniform"
    source: ClassVar[str] = "Li & Torrance 2005, eq. 11"
    body: ClassVar[bool] = True

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        return (lambertian(("k_udf",), directions.cos_i * directions.cos_o),)


@dataclass(frozen=True, eq=False)
class SubsurfaceDiffuse(Brdf):
    """Light that enters a dielectric, is scattered evenly and leaves: f = (k/π) T(θi) T(θr), T = 1 − F.

    Source: Li & Torrance 2005, eq. 12, with Schlick's F at the angles to the mean surface.
    """

    k_uds: Tensor = declarations.k_uds()
    f0: Tensor = declarations.f0()

    name: ClassVar[str] = "li-torrance-subsurface"
    source: ClassVar[str] = "Li & Torrance 2005, eq. 12"
    body: ClassVar[bool] = True

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        return (_subsurface(_transmittances(directions)),)


@dataclass(frozen=True, eq=False)
class ForwardScattering(RoughSurface):
    """Light scattered forward below the surface of a dielectric.

    f = (k/π) T(θi) T(θr) (1 − cos θi)(1 − cos θr) exp(−tan²θf/(16 me²)),   cos θf = V·t

    t is the tangent that points away from the light. The lobe exists for cos θf > 0 only, as the paper means it:
    tan² alone would give the same lobe backward. `k_fs` scales and may exceed 1; the albedo at k = 1 is about 0.002.

    `law=printed` is not reciprocal: θf depends on the viewer alone. `law=reciprocal` takes the mean of tan²θf for both
    ways.

    Source: Li & Torrance 2005, eq. 13-14 (anisotropic: eq. 26 with the azimuth of the light).
    """

    k_fs: Tensor = declarations.k_fs()
    law: str = option("printed", choices=("printed", "reciprocal"), doc="dependence on the azimuth")

    name: ClassVar[str] = "li-torrance-forward"
    source: ClassVar[str] = "Li & Torrance 2005, eq. 13-14"

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        return (_forward(self.roughness(directions), directions, _transmittances(directions), self.law),)


@dataclass(frozen=True, eq=False)
class Coherent(RoughSurface):
    """The mirror-like reflection of a surface that is smooth against the wavelength, from a source of finite size.

    f = k F S e^(−g) K(γ) · 2/(cos θi + cos θr),   g = ((2π σe/λ)(cos θi + cos θr))²

    K is a smooth kernel in the angle γ between the light and the mirror direction, ∫ K dω = 1, as wide as the source of
    solid angle `solid_angle` (sr): K = exp((cos γ − 1)/s²)/(2π s² (1 − e^(−2/s²))), 2π s² = `solid_angle`. `wavelength`
    λ in µm, one value a channel; both come from the capture where it says them. On the mirror direction
    2/(cos θi + cos θr) is the 1/cos θi of eq. 16 (eq. 3 prints 1/(cos θi cos θr)); beside it this keeps f reciprocal.

    Source: Li & Torrance 2005, eq. 2-4 and 16.
    """

    k_dd: Tensor = declarations.amplitude("scale of the mirror-like light")
    height_rms: Tensor = declarations.height_rms()
    wavelength: Tensor = declarations.wavelength()
    solid_angle: Tensor = declarations.solid_angle()

    name: ClassVar[str] = "li-torrance-coherent"
    source: ClassVar[str] = "Li & Torrance 2005, eq. 2-4, 16"

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        roughness = self.roughness(directions)
        share = _coherent_share(roughness, directions, self.height_rms / self.wavelength)
        return _coherent(roughness, directions, share, self.solid_angle)


@dataclass(frozen=True, eq=False)
class LiTorrance(RoughSurface):
    """Five processes at and below a rough surface, each of which may be left out.

    f = `Coherent` + `DirectionalDiffuse` + `FirstSurfaceDiffuse` + `SubsurfaceDiffuse` + `ForwardScattering`

    A component that is off costs nothing and has no parameters; `assemble` says which components a surface needs.
    Parameters are those of the components (`k_dd` scales two of them), shapes as `Brdf`.

    The directional-diffuse lobe already carries all the energy of the rough limit, so that with the coherent component
    more light may leave than arrives; `energy=he` multiplies it by 1 − e^(−g), as in He and Torrance's model.

    Source: Li & Torrance 2005, eq. 3-14 and 20-26.
    """

    k_dd: Tensor = declarations.amplitude("scale of the directional light", when={"directional": ("on",)})
    k_udf: Tensor = declarations.k_udf(when={"uniform": ("on",)})
    k_uds: Tensor = declarations.k_uds(when={"subsurface": ("on",)})
    k_fs: Tensor = declarations.k_fs(when={"forward": ("on",)})
    height_rms: Tensor = declarations.height_rms(
        held=1.0, role=Role.YARDSTICK, variants=((_COHERENT, {"held": None, "role": Role.NONE}),)
    )
    wavelength: Tensor = declarations.wavelength(when=_COHERENT)
    solid_angle: Tensor = declarations.solid_angle(when=_COHERENT)
    directional: str = option("on", choices=_SWITCH, doc="directional-diffuse reflection (eq. 9)")
    uniform: str = option("off", choices=_SWITCH, doc="first-surface uniform-diffuse reflection (eq. 11)")
    subsurface: str = option("on", choices=_SWITCH, doc="subsurface uniform-diffuse reflection (eq. 12)")
    forward: str = option("off", choices=_SWITCH, doc="subsurface forward scattering (eq. 13)")
    coherent: str = option("off", choices=_SWITCH, doc="mirror-like reflection (eq. 3)")
    law: str = option("printed", choices=("printed", "reciprocal"), doc="azimuth of forward scattering")
    energy: str = option("paper", choices=("paper", "he"), doc="share of the directional beside the coherent light")

    name: ClassVar[str] = "li-torrance"
    source: ClassVar[str] = "Li & Torrance 2005, eq. 3-14, 20-26"
    excluded: ClassVar[tuple[tuple[dict[str, str], str], ...]] = (
        (
            {"coherent": "on", "directional": "off"},
            "the mirror-like component shares k_dd with the directional one; take li-torrance-coherent alone.",
        ),
        (
            {"directional": "off", "uniform": "off", "subsurface": "off", "forward": "off"},
            "every component is off; leave one on.",
        ),
    )

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        out: list[Term] = []
        if self.uniform == "on":
            out += FirstSurfaceDiffuse().terms(directions)
        if "on" in (self.subsurface, self.forward):
            transmittance = _transmittances(directions)
        if self.subsurface == "on":
            out.append(_subsurface(transmittance))
        if "on" not in (self.directional, self.forward):
            return tuple(out)
        roughness = self.roughness(directions)
        if self.forward == "on":
            out.append(_forward(roughness, directions, transmittance, self.law))
        if self.directional == "on":
            lobe = roughness.lobe(directions)
            if self.coherent == "on":
                share = _coherent_share(roughness, directions, self.height_rms / self.wavelength)
                out += _coherent(roughness, directions, share, self.solid_angle)
                lobe = lobe * (1 - share) if self.energy == "he" else lobe
            out += surface_terms(lobe, directions)
        return tuple(out)


def surface_terms(lobe: Tensor, directions: Directions) -> tuple[Term, ...]:
    """k_dd F times a lobe, F = f0 + (1 − f0)(1 − cos θh)⁵."""
    return Term(("k_dd", "f0"), lobe), Term(("k_dd", complement_of("f0")), lobe * schlick_weight(directions.short_d))


def _transmittances(directions: Directions) -> Tensor:
    """T(θi) T(θr)/(π (1 − f0)²): Schlick's transmittances of the mean surface over their value at normal incidence."""
    return _transmittance(directions.cos_i) * _transmittance(directions.cos_o) / math.pi


def _transmittance(cos: Tensor) -> Tensor:
    """1 − (1 − cos θ)⁵, without cancellation at grazing."""
    short = 1 - cos
    square = short * short
    return cos * ((1 + short) * (1 + square) + square * square)


def _subsurface(transmittance: Tensor) -> Term:
    return Term(("k_uds", complement_of("f0"), complement_of("f0")), transmittance)


def _forward(roughness: Roughness, directions: Directions, transmittance: Tensor, law: str) -> Term:
    d = directions
    ahead = (-d.tangential).clamp(min=0)
    exponent = _tan2(ahead, d.crosswise, d.sin_i, d.cos_o) * _inverse_width(roughness, d, 0)
    if law == "reciprocal":
        exponent = 0.5 * (exponent + _tan2(ahead, d.crosswise, d.sin_o, d.cos_i) * _inverse_width(roughness, d, 1))
    # All derivatives of the lobe are 0 where `sign` ends it.
    lobe = decay(exponent) * torch.sign(ahead) * (1 - d.cos_i) * (1 - d.cos_o) * transmittance
    return Term(("k_fs", complement_of("f0"), complement_of("f0")), lobe)


def _tan2(ahead: Tensor, crosswise: Tensor, sin_i: Tensor, cos_o: Tensor) -> Tensor:
    """tan²θf for light at `sin_i` and viewer at `cos_o`, with sin²θf as a sum of squares: no cancellation."""
    sin2 = cos_o.square() + (crosswise / sin_i).square()
    return sin2 / (ahead / sin_i).square().clamp(min=1e-6)


def _inverse_width(roughness: Roughness, directions: Directions, side: int) -> Tensor:
    """1/(16 me²) along the azimuth of the light (`side` 0) or the viewer (1); roughness holds 2 me."""
    x = 0.25 / roughness.slope_x.clamp(min=2e-2).square()
    if roughness.isotropic:
        return x
    share = directions.along_tangent[side]
    return share * x + (1 - share) * (0.25 / roughness.slope_y.clamp(min=2e-2).square())


def _coherent_share(roughness: Roughness, directions: Directions, ratio: Tensor) -> Tensor:
    """e^(−g), `ratio` = σ/λ."""
    apparent = 2 * math.pi * ratio * roughness.effective * (directions.cos_i + directions.cos_o)
    return decay(apparent.square())


def _coherent(roughness: Roughness, directions: Directions, share: Tensor, solid_angle: Tensor) -> tuple[Term, ...]:
    d = directions
    s = roughness.masking * 4 * d.cos_i * d.cos_o
    lobe = s * share * mirror_kernel(d, solid_angle) * 2 / (d.cos_i + d.cos_o).clamp(min=1e-4)
    return surface_terms(lobe, d)


def mirror_kernel(directions: Directions, solid_angle: Tensor) -> Tensor:
    """K(γ) of `Coherent`: a lobe about the mirror direction as wide as a source of that solid angle, ∫ K dω = 1."""
    width = solid_angle / (2 * math.pi)
    return decay(0.5 * directions.mirror_chord2 / width) / (solid_angle * -torch.expm1(-2 / width))
