"""Neumann and Neumann's stretched Phong lobe."""

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
class NeumannNeumann(Brdf):
    """f = diffuse/π + specular · (n+2)/(2π) · (R·V)₊ⁿ / max(cos θi, cos θr)

    `exponent` n. Shapes as `Brdf`.

    Source: Neumann, Neumann & Szirmay-Kalos 1999 (stretched Phong; that this member of their family is the one of Li &
    Torrance 2005, Table 4, is an assumption). Limits: keeps its energy far better than Phong at grazing incidence;
    albedo 1.0003 at most, for n = 1.
    """

    diffuse: Tensor = declarations.diffuse()
    specular: Tensor = declarations.amplitude("weight of the highlight", 0.1)
    exponent: Tensor = declarations.exponent()

    name: ClassVar[str] = "neumann-neumann"
    source: ClassVar[str] = "Neumann, Neumann & Szirmay-Kalos 1999"

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        # 1 − R·V from |R − V|², R the mirror direction of L: it keeps its digits at the peak.
        short = 0.5 * directions.mirror_chord2
        power = decay(-self.exponent * torch.log1p(-short.clamp(max=1 - 1e-6)))
        power = torch.where(short < 1, power, torch.zeros_like(power))
        stretch = torch.maximum(directions.cos_i, directions.cos_o).clamp(min=1e-6)
        lobe = (self.exponent + 2) / (2 * math.pi) * power / stretch
        return lambertian(("diffuse",), lobe), Term(("specular",), lobe)
