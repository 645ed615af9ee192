"""Lafortune's generalised cosine lobe."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from matest.brdf import declarations
from matest.brdf.base import Brdf
from matest.brdf.microfacet import decay
from matest.brdf.terms import Term, lambertian
from matest.directions import Directions
from matest.parameters import interval, parameter

_COEFFICIENT = interval(-1.2, 1.2)


@dataclass(frozen=True, eq=False)
class Lafortune(Brdf):
    """f = diffuse/π + specular · (Cxy (LxVx + LyVy) + Cz LzVz)₊ⁿ

    One isotropic lobe: `c_xy` < 0 forward, > 0 backward; |Cz| < |Cxy| off-specular; `exponent` n. Shapes as `Brdf`.

    Source: Lafortune, Foo, Torrance & Greenberg 1997. Limits: not normalised; c_z = −c_xy = ((n+2)/(2π))^(1/n) is
    Phong's normalised lobe.
    """

    diffuse: Tensor = declarations.diffuse()
    specular: Tensor = declarations.amplitude("weight of the lobe", 0.1)
    c_xy: Tensor = parameter(_COEFFICIENT, unit="1", doc="coefficient along the surface", default=-1.0)
    c_z: Tensor = parameter(_COEFFICIENT, unit="1", doc="coefficient along the normal", default=1.0)
    exponent: Tensor = parameter(interval(1, 100), unit="1", doc="exponent n", default=10.0, log=True)

    name: ClassVar[str] = "lafortune"
    source: ClassVar[str] = "Lafortune et al. 1997"

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        d = directions
        cosine = self.c_xy * d.tangential + self.c_z * d.cos_i * d.cos_o
        lobe = decay(-self.exponent * cosine.clamp(min=1e-6).log())
        lobe = torch.where(cosine > 0, lobe, torch.zeros_like(lobe))
        return lambertian(("diffuse",), lobe), Term(("specular",), lobe)
