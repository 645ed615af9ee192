"""Cook and Torrance's model."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from matest.brdf import declarations
from matest.brdf.base import Brdf
from matest.brdf.fresnel import colour_shift_weight, conductor, dielectric, schlick_weight
from matest.brdf.microfacet import beckmann, gaussian, ggx, smith_beckmann, smith_ggx, v_cavity
from matest.brdf.terms import Factor, Term, complement_of, lambertian
from matest.directions import Directions
from matest.parameters import interval, option, parameter, unit_interval

# The lobe is F Dn G / (divisor · cos θi cos θr), with Dn normalised; here the factor 4/divisor.
_NORMALISATION = {"physical": 1.0, "ngan": 4 / math.pi, "paper1982": 4.0}
_DISTRIBUTION = {"beckmann": beckmann, "gaussian": gaussian, "ggx": ggx}
_SMITH = {"beckmann": smith_beckmann, "ggx": smith_ggx}

# Factors of each lobe, by the option `lobes`.
_SHARES: dict[str, list[tuple[str | Factor, ...]]] = {
    "1": [()],
    "2": [(complement_of("weight_2"),), ("weight_2",)],
    "3": [(complement_of("weight_2"),), ("weight_2", complement_of("weight_3")), ("weight_2", "weight_3")],
}

_SEVERAL = {"lobes": ("2", "3")}
_COLOURED = {"fresnel": ("schlick", "colour-shift")}
_METALLIC = {"fresnel": ("schlick", "colour-shift", "conductor")}
_METAL = {"fresnel": ("conductor",)}
_SHIFT = {"fresnel": ("colour-shift",)}


@dataclass(frozen=True, eq=False)
class CookTorrance(Brdf):
    """A Lambertian body under a microfacet surface.

    f = diffuse/π + specular · F D G / (4 cos θi cos θr)

    `diffuse` = d·π·Rd and `specular` = s in the paper's s·Rs + d·Rd. Shapes as `Brdf`. The options choose

    - `distribution` D, normalised to ∫ D cos α dω = 1: Beckmann's of rms slope `slope` m, a Gaussian of the facet angle
      exp(−(α/m)²), or GGX of width m.
    - `lobes`: surfaces with structure at several scales, D = (1 − w₂) D(m) + w₂ D(m₂); with three
      D = (1 − w₂) D(m) + w₂ [(1 − w₃) D(m₂) + w₃ D(m₃)]. An estimate has them in the order of `ordered`.
    - `masking` G: of V-cavities (the paper's) or Smith's.
    - `fresnel` F: of a `dielectric` with normal reflectance `f0` = ((n−1)/(n+1))²; of a `conductor` of index
      `eta` − i `k`; `schlick`, f0 + (1 − f0)(1 − V·H)⁵; or the paper's interpolation of colours, `colour-shift`, from
      `f0` toward white as the Fresnel term of a dielectric with the average reflectance `f0_mean` (to be given) rises.
      Where F has a colour, `specular` is held at 1 unless determined. Tensors broadcast: give `f0`, `eta`, `k` one
      value per channel, or per wavelength of a spectrum.
    - `weights`: `complementary` ties s + d = 1; `diffuse` is then π·Rd alone, the albedo of the body.
    - `normalisation`: `physical` divides by 4, `ngan` by π, `paper1982` by 1: the paper prints D without its 1/π
      beside a divisor π, four times as bright as a mirror can be.

    Source: Cook & Torrance 1982; the 1/4 from dω_r = 4 (V·H) dω_h. Limits: single bounce between facets, so rough
    lobes lose energy (at m = 0.4 up to 10 %, GGX with Smith's masking 25 %). A body without complementary weights is
    not dimmed by the surface on it.
    """

    diffuse: Tensor = declarations.diffuse()
    specular: Tensor = declarations.amplitude(
        "weight of the surface reflection s", 1.0, variants=((_METALLIC, {"held": 1.0}),)
    )
    slope: Tensor = declarations.slope("rms slope of the facets m", 0.2)
    f0: Tensor = declarations.f0(
        when={"fresnel": ("dielectric", "schlick", "colour-shift")},
        variants=((_COLOURED, {"per_channel": True, "held": None}),),
    )
    f0_mean: Tensor = parameter(
        unit_interval, unit="1", doc="average of f0 over wavelengths", default=0.04, log=True, when=_SHIFT
    )
    eta: Tensor = parameter(
        interval(0.05, 10), unit="1", doc="index of refraction n", default=1.5, log=True, per_channel=True, when=_METAL
    )
    k: Tensor = parameter(
        interval(0, 12), unit="1", doc="extinction coefficient", default=3.0, per_channel=True, when=_METAL
    )
    slope_2: Tensor = declarations.slope("rms slope of the second lobe", 0.4, when=_SEVERAL)
    slope_3: Tensor = declarations.slope("rms slope of the third lobe", 0.6, when={"lobes": ("3",)})
    weight_2: Tensor = parameter(
        unit_interval, unit="1", doc="share of the further lobes w₂", default=0.5, when=_SEVERAL
    )
    weight_3: Tensor = parameter(
        unit_interval, unit="1", doc="share of the third lobe in these w₃", default=0.5, when={"lobes": ("3",)}
    )
    distribution: str = option("beckmann", choices=tuple(_DISTRIBUTION), doc="slope distribution")
    lobes: str = option("1", choices=("1", "2", "3"), doc="number of slope distributions")
    masking: str = option("v-cavity", choices=("v-cavity", "smith"), doc="masking and shadowing of facets")
    fresnel: str = option(
        "dielectric", choices=("dielectric", "conductor", "schlick", "colour-shift"), doc="Fresnel reflectance"
    )
    weights: str = option("independent", choices=("independent", "complementary"), doc="whether s + d = 1")
    normalisation: str = option("physical", choices=tuple(_NORMALISATION), doc="constant of the lobe")

    name: ClassVar[str] = "cook-torrance"
    source: ClassVar[str] = "Cook & Torrance 1982"
    excluded: ClassVar[tuple[tuple[dict[str, str], str], ...]] = (
        (
            {"distribution": "gaussian", "masking": "smith"},
            "Smith's masking has no closed form for a Gaussian of the angle; take masking=v-cavity or beckmann.",
        ),
    )

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        body = (complement_of("specular"), "diffuse") if self.weights == "complementary" else ("diffuse",)
        out = [lambertian(body, directions.cos_i * directions.cos_o)]
        for share, lobe in self._lobes(directions):
            for factors, reflectance in self._reflectances(directions):
                out.append(Term(("specular", *share, *factors), lobe * reflectance))
        return tuple(out)

    @property
    def ordered(self) -> Brdf:
        """The same reflectance with its lobes from narrow to wide, those without a share last."""
        slopes = [self.slope, self.slope_2, self.slope_3][: int(self.lobes)]
        if len(slopes) == 1:
            return self
        inner = [1 - self.weight_3, self.weight_3] if len(slopes) == 3 else [torch.ones_like(self.weight_2)]
        widths = torch.stack(torch.broadcast_tensors(*slopes))
        shares = torch.stack(torch.broadcast_tensors(1 - self.weight_2, *(self.weight_2 * share for share in inner)))
        order = torch.where(shares > 0, widths, math.inf).argsort(dim=0, stable=True)
        if bool((order.diff(dim=0) > 0).all()):
            return self
        (slope, *further), shares = widths.gather(0, order), shares.gather(0, order)
        values = dict(zip(("slope_2", "slope_3"), further, strict=False))
        rest = 1 - shares[0]
        if len(slopes) == 3:
            values["weight_3"] = shares[2] / rest.clamp(min=1e-12)
        return self.replace({"slope": slope, "weight_2": rest, **values})

    def _lobes(self, directions: Directions) -> list[tuple[tuple[str | Factor, ...], Tensor]]:
        """Factors and D G / (4 cos θi cos θr) of every lobe."""
        slopes = [self.slope, self.slope_2, self.slope_3][: int(self.lobes)]
        scale = _NORMALISATION[self.normalisation]
        distribution = _DISTRIBUTION[self.distribution]
        if self.masking == "v-cavity":
            masking = [scale * v_cavity(directions)] * len(slopes)
        else:
            masking = [scale * _SMITH[self.distribution](directions, slope) for slope in slopes]
        lobes = [distribution(directions, slope) * factor for slope, factor in zip(slopes, masking, strict=True)]
        return list(zip(_SHARES[self.lobes], lobes, strict=True))

    def _reflectances(self, directions: Directions) -> list[tuple[tuple[str | Factor, ...], Tensor]]:
        """F, as a sum of products of factors where it is linear in f0."""
        cos_d = directions.cos_d
        if self.fresnel == "dielectric":
            return [((), dielectric(cos_d, self.f0))]
        if self.fresnel == "conductor":
            return [((), conductor(cos_d, self.eta, self.k))]
        shift = self.fresnel == "colour-shift"
        weight = colour_shift_weight(cos_d, self.f0_mean) if shift else schlick_weight(directions.short_d)
        return [(("f0",), torch.ones_like(weight)), ((complement_of("f0"),), weight)]
