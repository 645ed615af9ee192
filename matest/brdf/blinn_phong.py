"""Blinn and Phong's highlight, normalised."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from matest.brdf import declarations
from matest.brdf.base import Brdf
from matest.brdf.microfacet import decay
from matest.brdf.terms import Term, lambertian
from matest.directions import Directions


@dataclass(frozen=True, eq=False)
class BlinnPhong(Brdf):
    """f = diffuse/π + specular · c (N·H)^n,   c = (n+2)(n+4)/(8π(2^(−n/2) + n))

    c makes the albedo of the lobe 1 at normal incidence, and less elsewhere; `exponent` n. Shapes as `Brdf`.

    Source: Blinn 1977, made reciprocal; baseline of Li & Torrance 2005, Table 4. Limits: loses most of the light at
    grazing incidence (albedo 0.09 at 75° for n = 100).
    """

    diffuse: Tensor = declarations.diffuse()
    specular: Tensor = declarations.amplitude("weight of the highlight", 0.1)
    exponent: Tensor = declarations.exponent()

    name: ClassVar[str] = "blinn-phong"
    source: ClassVar[str] = "Blinn 1977"

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        n = self.exponent
        scale = (n + 2) * (n + 4) / (8 * math.pi * (torch.exp2(-0.5 * n) + n))
        # (N·H)² = 1/(1 + tan²α): the power keeps its digits near the normal.
        lobe = scale * decay(0.5 * n * torch.log1p(directions.tan2_half))
        return lambertian(("diffuse",), lobe), Term(("specular",), lobe)
