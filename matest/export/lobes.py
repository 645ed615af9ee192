"""A material as the sum of lobes that renderers have, or that `mitsuba_plugin` adds to them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import torch
from torch import Tensor

from matest.brdf import (
    Brdf,
    CookTorrance,
    DirectionalDiffuse,
    Eon,
    FirstSurfaceDiffuse,
    ForwardScattering,
    Fujii,
    Lambert,
    LiTorrance,
    OrenNayar,
    OrenNayarQualitative,
    SubsurfaceDiffuse,
    Sum,
    TorranceSparrow,
    Ward,
)
from matest.brdf.microfacet import gaussian_constant

# Kinds of diffuse models.
BODIES = {"lambert", "oren-nayar", "oren-nayar-qualitative", "fujii", "eon"}
# Reflectance at normal incidence above which a surface is taken for a metal.
METALLIC = 0.2
# A microfacet lobe is specular · F D G/(4 cos θi cos θr); these normalisations multiply it.
_NORMALISATION = {"physical": 1.0, "ngan": 4 / math.pi, "paper1982": 4.0}
# σ of Torrance and Sparrow's lobe and slopes of a Gaussian below and above these are replaced by them.
_SIGMA_FLOOR = 1e-3
_SLOPE_RANGE = (1e-3, 1.0)


@dataclass(frozen=True, eq=False)
class Lobe:
    """One summand of a material.

    Attributes:
        kind: of `mitsuba_plugin`.
        values: by the plugin's names; [] or [C].
        words: options of the kind.
    """

    kind: str
    values: Mapping[str, Tensor]
    words: Mapping[str, str] = field(default_factory=dict)


def lobes_of(material: Brdf) -> list[Lobe] | None:
    """The lobes whose sum a material is; None where one of its parts is none of them."""
    parts = material.components if isinstance(material, Sum) else (material,)
    lobes: list[Lobe] = []
    for part in parts:
        split = _SPLIT.get(type(part))
        pieces = None if split is None else split(part)
        if pieces is None:
            return None
        lobes += pieces
    # What reflects nothing is no lobe; one stays, of a black material.
    return [lobe for lobe in lobes if bool((_amplitude(lobe) != 0).any())] or lobes[:1]


def is_matte(lobes: Sequence[Lobe] | None) -> bool:
    """Whether all lobes are diffuse models; False where none are known."""
    return lobes is not None and all(lobe.kind in BODIES for lobe in lobes)


def index_of(f0: Tensor) -> Tensor:
    """The index of a dielectric of that reflectance at normal incidence."""
    root = f0.clamp(1e-6, 1 - 1e-4).sqrt()
    return (1 + root) / (1 - root)


def _amplitude(lobe: Lobe) -> Tensor:
    return next(lobe.values[name] for name in ("albedo", "specular", "k") if name in lobe.values)


def _body(part: Brdf) -> list[Lobe]:
    return [Lobe(part.name, part.parameters)]


def _torrance_sparrow(part: Brdf) -> list[Lobe]:
    assert isinstance(part, TorranceSparrow)
    # ks · G e/(cos θi cos θr) has no divisor 4, and exp(−α²/(2σ²)) = exp(−(α/m)²) with m = √2 σ.
    values = {"specular": 4 * part.specular, "slope": math.sqrt(2) * part.sigma.clamp(min=_SIGMA_FLOOR)}
    return [Lobe("microfacet", values, {"distribution": "gaussian", "masking": "v-cavity", "fresnel": "none"})]


def _cook_torrance(part: Brdf) -> list[Lobe]:
    assert isinstance(part, CookTorrance)
    body = part.diffuse * (1 - part.specular) if part.weights == "complementary" else part.diffuse
    words = {"distribution": part.distribution, "masking": part.masking, "fresnel": part.fresnel}
    names = {"f0": "f0", "f0_mean": "f0_mean", "eta": "eta", "k": "extinction"}
    optics = {new: part.parameters[name] for name, new in names.items() if name in part.parameters}
    surfaces = []
    for slope, share in _slopes(part):
        strength = part.specular * share * _NORMALISATION[part.normalisation]
        if part.distribution == "gaussian":
            slope = slope.clamp(*_SLOPE_RANGE)
            strength = strength * gaussian_constant(slope)
        surfaces.append(Lobe("microfacet", {"specular": strength, "slope": slope, **optics}, words))
    return [Lobe("lambert", {"albedo": body}), *surfaces]


def _slopes(part: CookTorrance) -> Iterator[tuple[Tensor, Tensor]]:
    """Slope and share of every distribution of facets."""
    one = torch.ones((), dtype=part.slope.dtype)
    first = one - part.weight_2 if part.lobes != "1" else one
    yield part.slope, first
    if part.lobes == "2":
        yield part.slope_2, part.weight_2
    if part.lobes == "3":
        yield part.slope_2, part.weight_2 * (1 - part.weight_3)
        yield part.slope_3, part.weight_2 * part.weight_3


def _ward(part: Brdf) -> list[Lobe]:
    assert isinstance(part, Ward)
    slopes = (part.slope, part.slope) if part.anisotropy == "none" else (part.slope_x, part.slope_y)
    values = {"specular": part.specular, "slope_x": slopes[0], "slope_y": slopes[1]}
    return [Lobe("lambert", {"albedo": part.diffuse}), Lobe("ward", values, {"form": part.form})]


def _li_torrance(part: Brdf) -> list[Lobe] | None:
    """Its components, but no mirror-like ones."""
    values = part.parameters
    if getattr(part, "coherent", "off") == "on":
        return None
    masking = {"masking": getattr(part, "masking", "on"), "anisotropy": getattr(part, "anisotropy", "none")}
    words = masking | {"law": getattr(part, "law", "printed")}
    lobes = [Lobe("lambert", {"albedo": values["k_udf"]})] if "k_udf" in values else []
    surface = {"f0": values["f0"]} if "f0" in values else {}
    if "k_uds" in values:
        lobes.append(Lobe("li-torrance-subsurface", {"k": values["k_uds"], **surface}))
    for axis in ("", "_x", "_y"):
        if f"correlation_length{axis}" in values:
            surface[f"slope_ratio{axis}"] = values["height_rms"] / values[f"correlation_length{axis}"]
    if "k_dd" in values:
        lobes.append(Lobe("li-torrance-directional", {"k": values["k_dd"], **surface}, masking))
    if "k_fs" in values:
        lobes.append(Lobe("li-torrance-forward", {"k": values["k_fs"], **surface}, words))
    return lobes


_SPLIT: dict[type[Brdf], Callable[[Brdf], list[Lobe] | None]] = {
    Lambert: _body,
    OrenNayar: _body,
    OrenNayarQualitative: _body,
    Fujii: _body,
    Eon: _body,
    TorranceSparrow: _torrance_sparrow,
    Ward: _ward,
    CookTorrance: _cook_torrance,
    LiTorrance: _li_torrance,
    DirectionalDiffuse: _li_torrance,
    FirstSurfaceDiffuse: _li_torrance,
    SubsurfaceDiffuse: _li_torrance,
    ForwardScattering: _li_torrance,
}
