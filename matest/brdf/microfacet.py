"""Slope distributions and masking of microfacet surfaces."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import torch
from scipy.special import roots_legendre
from torch import Tensor

from matest.directions import Directions

# Rms slopes below this are replaced by it: the distributions divide by the slope.
_SLOPE_FLOOR = 1e-3
# Products of cosines below this are replaced by it: the quotients by them stay finite.
_COS_PRODUCT_FLOOR = 1e-12
# G1 differs from 1 by less than float64 rounding beyond this argument.
_SMITH_LIMIT = 6.5
# exp(−x²) is below float64 rounding beyond this argument.
_GAUSSIAN_LIMIT = 6.5
# Degree of the Chebyshev series of the constant of `gaussian`: its error is 3e-13.
_GAUSSIAN_DEGREE = 40


def decay(exponent: Tensor) -> Tensor:
    """exp(−x) for x ≥ 0, but at least the smallest normal number; its derivative is zero where this limit acts.

    For smaller results torch's exponential takes ten to thirty times as long, and most pairs of directions lie far
    outside a lobe.
    """
    return torch.exp(-exponent.clamp(max=_decay_limit(exponent.dtype)))


def _decay_limit(dtype: torch.dtype) -> float:
    return math.floor(-math.log(torch.finfo(dtype).tiny))


def beckmann(directions: Directions, slope: Tensor) -> Tensor:
    """Beckmann's slope distribution, normalised to ∫ D cos α dω = 1, in 1/sr.

    D = exp(−tan²α/m²) / (π m² cos⁴α), m = `slope` (rms slope), taken at least 1e-3.

    Source: Cook & Torrance 1982, D divided by π (their D integrates to π).
    """
    m2 = slope.clamp(min=_SLOPE_FLOOR).square()
    # Limit 1/cos⁴α where the exponential vanishes: 0 times infinity would make derivatives NaN.
    tan2 = torch.minimum(directions.tan2_half, _decay_limit(m2.dtype) * m2)
    return torch.exp(-tan2 / m2) * (1 + tan2).square() / (math.pi * m2)


def beckmann_anisotropic(directions: Directions, slope_x: Tensor, slope_y: Tensor) -> Tensor:
    """Beckmann's distribution with different rms slopes along tangent and bitangent, normalised, in 1/sr.

    D = exp(−(hx²/mx² + hy²/my²)) / (π mx my cos⁴α), hx, hy the slopes of the facet. Shapes and floor as `beckmann`.
    """
    mx, my = slope_x.clamp(min=_SLOPE_FLOOR), slope_y.clamp(min=_SLOPE_FLOOR)
    hx, hy = directions.half_slopes
    exponent = (hx / mx).square() + (hy / my).square()
    tan2 = torch.minimum(directions.tan2_half, _decay_limit(mx.dtype) * torch.maximum(mx, my).square())
    return decay(exponent) * (1 + tan2).square() / (math.pi * mx * my)


def gaussian(directions: Directions, slope: Tensor) -> Tensor:
    """A Gaussian of the facet angle, normalised to ∫ D cos α dω = 1, in 1/sr.

    D = c exp(−(α/m)²), m = `slope` in radians, within [1e-3, 1]; 1/c = π ∫ exp(−α²/m²) sin 2α dα over [0, π/2].

    Source: Cook & Torrance 1982, with their arbitrary constant c determined.
    """
    m = slope.clamp(_SLOPE_FLOOR, 1.0)
    return decay(directions.theta2_half / m.square()) * gaussian_constant(m)


def gaussian_constant(slope: Tensor) -> Tensor:
    """c of `gaussian` for m in (0, 1]: π m² c is smooth in m, here a Chebyshev series of it, exact to 3e-13."""
    x = 2 * slope - 1
    # Clenshaw's recurrence: b_k = 2x b_(k+1) − b_(k+2) + c_k.
    b_1, b_2 = torch.zeros_like(x), torch.zeros_like(x)
    c_0, *others = _gaussian_series()
    for coefficient in reversed(others):
        b_1, b_2 = 2 * x * b_1 - b_2 + coefficient, b_1
    return (x * b_1 - b_2 + c_0) / (math.pi * slope.square())


@cache
def _gaussian_series() -> list[float]:
    nodes, weights = roots_legendre(128)

    def product(x: np.ndarray) -> np.ndarray:
        m = ((x + 1) / 2)[:, None]
        # α = m y, y up to where the Gaussian vanishes: 1/(π m² c) = ∫ exp(−y²) sin(2 m y)/m dy.
        end = np.minimum(math.pi / (2 * m), _GAUSSIAN_LIMIT)
        y = end * (nodes + 1) / 2
        return 1 / (np.exp(-y * y) * 2 * y * np.sinc(2 * m * y / math.pi) * weights * end / 2).sum(-1)

    return np.polynomial.Chebyshev.interpolate(product, _GAUSSIAN_DEGREE).coef.tolist()


def ggx(directions: Directions, width: Tensor) -> Tensor:
    """The distribution of Trowbridge and Reitz, normalised to ∫ D cos α dω = 1, in 1/sr.

    D = m² / (π (m² cos²α + sin²α)²), m = `width`, taken at least 1e-3; its rms slope is infinite.

    Source: Trowbridge & Reitz 1975; named GGX by Walter et al. 2007.
    """
    m2 = width.clamp(min=_SLOPE_FLOOR).square()
    return 1 / (math.pi * m2 * (directions.cos2_half * (1 + directions.tan2_half / m2)).square())


def v_cavity(directions: Directions) -> Tensor:
    """G / (4 cos θi cos θr) for V-shaped grooves, G = min{1, 2(N·H)(N·V)/(V·H), 2(N·H)(N·L)/(V·H)}.

    With |L+V|² = h², 2(N·H)/(V·H) = 4 (cos θi + cos θr)/h²: the quotient needs no half vector and stays bounded when
    one cosine vanishes.

    Source: Torrance & Sparrow 1967; Cook & Torrance 1982.
    """
    cos_i, cos_o = directions.cos_i, directions.cos_o
    no_masking = 0.25 / (cos_i * cos_o).clamp(min=_COS_PRODUCT_FLOOR)
    # Divide twice: the derivatives of a single quotient would leave the range of float32.
    masking = (cos_i + cos_o) / torch.maximum(cos_i, cos_o).clamp(min=1e-6) / directions.half_squared
    return torch.minimum(no_masking, masking)


def smith_beckmann(directions: Directions, slope: Tensor) -> Tensor:
    """G1(θi) G1(θr) / (4 cos θi cos θr), Smith's masking of a Beckmann surface of rms slope `slope`.

    G1 = 2√π a / (√π a (1 + erf a) + e^(−a²)),  a = cos θ / (m sin θ): exact, in a form without cancellation.

    Source: Smith 1967; Walter et al. 2007 (who approximate it by a rational function).
    """
    m = slope.clamp(min=_SLOPE_FLOOR)
    return (
        0.25 * _g1_over_cos(directions.cos_i, directions.sin_i, m) * _g1_over_cos(directions.cos_o, directions.sin_o, m)
    )


def smith_ggx(directions: Directions, width: Tensor) -> Tensor:
    """G1(θi) G1(θr) / (4 cos θi cos θr), Smith's masking of a GGX surface of width `width`.

    G1 = 2 cos θ / (cos θ + √(cos²θ + m² sin²θ)).

    Source: Walter et al. 2007, eq. 34.
    """
    m = width.clamp(min=_SLOPE_FLOOR)
    sides = [
        cos + (cos * cos + (m * sin).square()).clamp(min=_COS_PRODUCT_FLOOR).sqrt()
        for cos, sin in ((directions.cos_i, directions.sin_i), (directions.cos_o, directions.sin_o))
    ]
    return 1 / (sides[0] * sides[1])


def _g1_over_cos(cos: Tensor, sin: Tensor, slope: Tensor) -> Tensor:
    # a / cos θ = 1/(m sin θ), limited to where G1 reaches 1.
    spread = torch.maximum(slope * sin, cos / _SMITH_LIMIT)
    a = cos / spread
    root = math.sqrt(math.pi)
    return 2 * root / (root * a * (1 + torch.erf(a)) + torch.exp(-a * a)) / spread
