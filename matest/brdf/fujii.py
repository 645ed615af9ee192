"""Fujii's improvement of Oren and Nayar's qualitative model."""

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
class Fujii(Brdf):
    """Oren and Nayar's qualitative model that also darkens the forward side, with its interreflection.

    f = (ρ/π) [1 − 0.5 σ²/(σ²+0.33) + 0.45 σ²/(σ²+0.09) s/t + 0.17 ρ σ²/(σ²+0.13)],
    s = sin θi sin θr cos Δφ,  t = max(cos θi, cos θr) if s > 0, otherwise 1

    `albedo` ρ is the albedo of a facet, `sigma` σ (rad) the std. deviation of its slope angle; `interreflection` as in
    `OrenNayar`. Shapes as `Brdf`.

    Source: Fujii, "A tiny improvement of Oren-Nayar reflectance model". Limits: σ = 0 is Lambert exactly; positive
    everywhere; the albedo exceeds 1 by up to 2.9 % when ρ > 0.97.
    """

    albedo: Tensor = declarations.albedo()
    sigma: Tensor = declarations.sigma()
    interreflection: Tensor = declarations.interreflection()

    name: ClassVar[str] = "fujii"
    source: ClassVar[str] = "Fujii, A tiny improvement of Oren-Nayar reflectance model"
    body: ClassVar[bool] = True

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        s2 = self.sigma * self.sigma
        azimuthal = directions.azimuthal
        one = torch.ones_like(azimuthal)
        weights = torch.stack([1 - 0.5 * s2 / (s2 + 0.33), 0.45 * s2 / (s2 + 0.09)], dim=-1)
        return (
            mixture(("albedo",), torch.cat([one, azimuthal], dim=-1), weights / math.pi),
            mixture(("albedo", "albedo", "interreflection"), one, (0.17 / math.pi) * (s2 / (s2 + 0.13))[..., None]),
        )
