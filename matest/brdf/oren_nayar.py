"""Oren and Nayar's generalisation of Lambert's law: functional approximation, eq. 14-16."""

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

# Cosines below this are replaced by it in quotients: f is unbounded at double grazing, while cos θi · f is bounded.
_COS_FLOOR = 1e-6


@dataclass(frozen=True, eq=False)
class OrenNayar(Brdf):
    """Rough diffuse surface of Lambertian V-cavities with Gaussian slope-area distribution.

    f = (ρ/π) [C1 + cos Δφ · C2 tan β + (1 − |cos Δφ|) C3 tan((α+β)/2)]
        + 0.17 (ρ²/π) σ²/(σ²+0.13) [1 − cos Δφ (2β/π)²],   α = max(θi, θr), β = min(θi, θr)

    `albedo` ρ is the albedo of a facet, `sigma` σ the standard deviation of the facet slope angle in radians. All
    tensors broadcast; directions [..., 3] give values [..., C].

    `interreflection` scales the second bounce: 1 is the model, 0 (or `false`) drops eq. 15. When only relative light
    intensities are known it is the reciprocal of the unknown light scale, for ρ then carries that scale once and ρ²
    twice.

    Source: Oren & Nayar 1994, eq. 14-16. Limits: σ = 0 is Lambert exactly. The direct part of the fit turns negative
    near forward double grazing for σ > 38°; negative values are set to zero. Albedo exceeds 1 by up to 5.1 % at grazing
    incidence when ρ > 0.95 and σ is 1.5° to 35°. Two bounces only, so ρ = 1 is not a white surface.
    """

    albedo: Tensor = declarations.albedo()
    sigma: Tensor = declarations.sigma()
    interreflection: Tensor = declarations.interreflection()

    name: ClassVar[str] = "oren-nayar"
    source: ClassVar[str] = "Oren & Nayar 1994, eq. 14-16"
    body: ClassVar[bool] = True

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        d = directions
        s2 = self.sigma * self.sigma
        c1 = 1 - 0.5 * s2 / (s2 + 0.33)
        b = 0.45 * s2 / (s2 + 0.09)
        c3 = 0.125 * s2 / (s2 + 0.09) * (16 / math.pi**4)

        theta_i, theta_o, s = d.theta_i, d.theta_o, d.tangential
        # α belongs to the more oblique direction. Azimuth-free: s = sin α sin β cos Δφ, and sin β / sin α ≤ 1.
        alpha, beta = torch.maximum(theta_i, theta_o), torch.minimum(theta_i, theta_o)
        sin_alpha, sin_beta = torch.maximum(d.sin_i, d.sin_o), torch.minimum(d.sin_i, d.sin_o)
        cos_beta = torch.maximum(d.cos_i, d.cos_o).clamp(min=_COS_FLOOR)
        ratio = sin_beta / sin_alpha
        beta_over_sin = beta / sin_beta
        half_tangent = (sin_alpha + sin_beta) / (d.cos_i + d.cos_o).clamp(min=_COS_FLOOR)

        # Forward of the plane normal to incidence, C2 = B (sin α − (2β/π)³); the case split is continuous (s = 0).
        # 1 − (2β/π)³/sin α is formed from 1 − 2β/π and 1 − sin α: near double grazing it vanishes before tan β grows.
        away = (2 / math.pi) * torch.atan2(cos_beta, sin_beta)
        short = torch.minimum(d.cos_i, d.cos_o).square() / (1 + sin_alpha)
        forward = (away * (3 - away * (3 - away)) - short) / sin_alpha
        backward = s.clamp(min=0)
        in_plane = (backward + (s - backward) * forward) / cos_beta
        # (1 − |cos Δφ|)(αβ)²; |cos Δφ| = |s| / (sin α sin β).
        out_of_plane = (alpha * beta).square() - alpha * beta * (alpha / sin_alpha) * beta_over_sin * s.abs()
        bounce = 1 - s * (4 / math.pi**2) * beta_over_sin * beta_over_sin * ratio

        direct = torch.cat([torch.ones_like(in_plane), in_plane, out_of_plane * half_tangent], dim=-1)
        return (
            mixture(("albedo",), direct, torch.stack([c1, b, c3], dim=-1) / math.pi),
            mixture(("albedo", "albedo", "interreflection"), bounce, (0.17 / math.pi) * (s2 / (s2 + 0.13))[..., None]),
        )
