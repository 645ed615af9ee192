"""Slope distributions and masking of microfacet surfaces."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from matest.directions import Directions

_SLOPE_FLOOR = 1e-3
_COS_PRODUCT_FLOOR = 1e-12
# G1 differs from 1 by less than float64 rounding beyond this argument.
_SMITH_LIMIT = 6.5


def beckmann(directions: Directions, slope: Tensor) -> Tensor:
    """Beckmann's slope distribution, normalised to ∫ D cos α dω = 1, in 1/sr.

    D = exp(−tan²α/m²) / (π m² cos⁴α), m = `slope` (rms slope), taken at least 1e-3.

    Source: Cook & Torrance 1982, D divided by π (their D integrates to π).
    """
    m2 = slope.clamp(min=_SLOPE_FLOOR).square()
    return torch.exp(-directions.tan2_half / m2) / (math.pi * m2 * directions.cos2_half.square())


def v_cavity(directions: Directions) -> Tensor:
    """G / (4 cos θi cos θr) for V-shaped grooves, G = min{1, 2(N·H)(N·V)/(V·H), 2(N·H)(N·L)/(V·H)}.

    With |L+V|² = h², 2(N·H)/(V·H) = 4 (cos θi + cos θr)/h²: the quotient needs no half vector and stays bounded when
    one cosine vanishes.

    Source: Torrance & Sparrow 1967; Cook & Torrance 1982.
    """
    cos_i, cos_o = directions.cos_i, directions.cos_o
    unmasked = 0.25 / (cos_i * cos_o).clamp(min=_COS_PRODUCT_FLOOR)
    masked = (cos_i + cos_o) / (directions.half_squared * torch.maximum(cos_i, cos_o).clamp(min=1e-6))
    return torch.minimum(unmasked, masked)


def smith_beckmann(directions: Directions, slope: Tensor) -> Tensor:
    """G1(θi) G1(θr) / (4 cos θi cos θr), Smith's masking of a Beckmann surface of rms slope `slope`.

    G1 = 2√π a / (√π a (1 + erf a) + e^(−a²)),  a = cos θ / (m sin θ): exact, in a form without cancellation.

    Source: Smith 1967; Walter et al. 2007 (who approximate it by a rational function).
    """
    m = slope.clamp(min=_SLOPE_FLOOR)
    return (
        0.25 * _g1_over_cos(directions.cos_i, directions.sin_i, m) * _g1_over_cos(directions.cos_o, directions.sin_o, m)
    )


def _g1_over_cos(cos: Tensor, sin: Tensor, slope: Tensor) -> Tensor:
    spread = slope * sin
    a = (cos / spread).clamp(max=_SMITH_LIMIT)
    root = math.sqrt(math.pi)
    masked = 2 * root / (root * a * (1 + torch.erf(a)) + torch.exp(-a * a))
    # a / cos = 1 / (m sin θ) where masking acts at all.
    return masked * torch.where(a < _SMITH_LIMIT, 1 / spread, _SMITH_LIMIT / cos.clamp(min=1e-6))
