"""Oren and Nayar's qualitative model, eq. 17."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from matest.brdf import declarations
from matest.brdf.base import Brdf
from matest.brdf.terms import Term, mixture
from matest.directions import Directions


@dataclass(frozen=True, eq=False)
class OrenNayarQualitative(Brdf):
    """Oren-Nayar without C3 and without interreflection.

    f = (ρ/π) (A + B max(0, cos Δφ) sin α tan β),  A = 1 − 0.5 σ²/(σ²+0.33),  B = 0.45 σ²/(σ²+0.09)

    with `albedo` ρ of a facet and `sigma` σ in radians; max(0, cos Δφ) sin α tan β = max(0, s)/max(cos θi, cos θr),
    s = sin θi sin θr cos Δφ. Shapes as `Brdf`.

    Source: Oren & Nayar 1994, eq. 17. Limits: σ = 0 is Lambert exactly; the albedo exceeds ρ
    by up to 1.5 % at grazing incidence. Against the full integral it is off by 10 %
    of the Lambert radiance (rms) and by half of it in the forward half-plane: fit and predict with the same one.
    """

    albedo: Tensor = declarations.albedo()
    sigma: Tensor = declarations.sigma()

    name: ClassVar[str] = "oren-nayar-qualitative"
    source: ClassVar[str] = "Oren & Nayar 1994, eq. 17"
    body: ClassVar[bool] = True

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        s2 = self.sigma * self.sigma
        a = 1 - 0.5 * s2 / (s2 + 0.33)
        b = 0.45 * s2 / (s2 + 0.09)
        cos_beta = torch.maximum(directions.cos_i, directions.cos_o).clamp(min=1e-6)
        backward = directions.tangential.clamp(min=0) / cos_beta
        columns = torch.cat([torch.ones_like(backward), backward], dim=-1)
        return (mixture(("albedo",), columns, torch.stack([a, b], dim=-1) / math.pi),)
