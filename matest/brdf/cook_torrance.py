"""Cook and Torrance's model."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from matest.brdf.base import Brdf, Term
from matest.brdf.fresnel import dielectric
from matest.brdf.microfacet import beckmann, smith_beckmann, v_cavity
from matest.directions import Directions
from matest.parameters import interval, option, parameter, unit_interval

# Lobe = F Dn G / (divisor · cos θi cos θr), with Dn normalised; here as a multiple of the physical 1/4.
_NORMALISATION = {"physical": 1.0, "ngan": 4 / math.pi, "paper1982": 4.0}


@dataclass(frozen=True, eq=False)
class CookTorrance(Brdf):
    """A Lambertian body under a microfacet surface.

    f = diffuse/π + specular · F D G / (4 cos θi cos θr)

    D is Beckmann's distribution of rms slope `slope` m, normalised to ∫ D cos α dω = 1; F the Fresnel reflectance of a
    dielectric with normal reflectance `f0`; G the masking of V-cavities or Smith's. `diffuse` = d·π·Rd and `specular`
    = s in the paper's s·Rs + d·Rd. Shapes as `Brdf`.

    `normalisation`: `physical` divides by 4, `ngan` by π, `paper1982` by 1: the paper prints D without its 1/π beside
    a divisor π, four times as bright as a mirror can be.

    Source: Cook & Torrance 1982; the 1/4 from dω_r = 4 (V·H) dω_h. Limits: single bounce between facets, so rough
    lobes lose energy (7 % at m = 0.4).
    """

    diffuse: Tensor = parameter(
        unit_interval, unit="1", doc="albedo of the body", default=0.5, linear=True, per_channel=True
    )
    specular: Tensor = parameter(
        unit_interval, unit="1", doc="weight of the surface reflection s", default=1.0, linear=True, per_channel=True
    )
    slope: Tensor = parameter(interval(1e-3, 1), unit="1", doc="rms slope of the facets m", default=0.2, log=True)
    f0: Tensor = parameter(
        unit_interval, unit="1", doc="reflectance at normal incidence", default=0.04, held=0.04, log=True
    )
    masking: str = option("v-cavity", choices=("v-cavity", "smith"), doc="masking and shadowing of facets")
    normalisation: str = option("physical", choices=tuple(_NORMALISATION), doc="constant of the lobe")

    name: ClassVar[str] = "cook-torrance"
    source: ClassVar[str] = "Cook & Torrance 1982"

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        masked = v_cavity(directions) if self.masking == "v-cavity" else smith_beckmann(directions, self.slope)
        lobe = dielectric(directions.cos_d, self.f0) * beckmann(directions, self.slope) * masked
        body = torch.full_like(directions.cos_i * directions.cos_o, 1 / math.pi)
        return Term(("diffuse",), body), Term(("specular",), lobe * _NORMALISATION[self.normalisation])
