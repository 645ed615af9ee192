"""Facets whose slopes may differ along tangent and bitangent, as other programs have them.

A width α is a number, or a pair: along the tangent and along the bitangent.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from matest.brdf.microfacet import beckmann, beckmann_anisotropic, ggx
from matest.directions import Directions

# Widths below this are replaced by it: the distributions divide by them.
_FLOOR = 1e-3


def is_pair(alpha: Tensor) -> bool:
    """Whether a width is one along the tangent and one along the bitangent."""
    return alpha.shape == (2,)


def beckmann_facets(directions: Directions, alpha: Tensor) -> Tensor:
    """Beckmann's distribution [n, 1] of rms slopes α."""
    return beckmann_anisotropic(directions, *alpha) if is_pair(alpha) else beckmann(directions, alpha)


def ggx_facets(directions: Directions, alpha: Tensor) -> Tensor:
    """GGX [n, 1] of widths α: D = 1/(π αx αy cos⁴α' (1 + (hx/αx)² + (hy/αy)²)²), hx and hy the slopes of the facet.

    Source: Burley 2012, eq. 13.
    """
    if not is_pair(alpha):
        return ggx(directions, alpha)
    x, y = alpha.clamp(min=_FLOOR)
    hx, hy = directions.half_slopes
    spread = 1 + (hx / x).square() + (hy / y).square()
    return 1 / (math.pi * x * y * (directions.cos2_half * spread).square())


def reach(directions: Directions, alpha: Tensor) -> tuple[Tensor, Tensor]:
    """α sin θ of light and viewer [n, 1] with the α of their azimuths, by which Smith's functions mask.

    Source: Heitz 2014, eq. 80.
    """
    if not is_pair(alpha):
        return alpha * directions.sin_i, alpha * directions.sin_o
    quarter = torch.tensor(0.5 * math.pi, dtype=alpha.dtype)
    along_x, along_y = directions.along(torch.zeros_like(quarter)), directions.along(quarter)
    x, y = alpha.clamp(min=_FLOOR)
    toward, away = (((x * u).square() + (y * v).square()).sqrt() for u, v in zip(along_x, along_y, strict=True))
    return toward, away


def separate_ggx(directions: Directions, alpha: Tensor) -> Tensor:
    """G1(θi) G1(θr)/(4 cos θi cos θr), Smith's masking of GGX."""
    sides = zip((directions.cos_i, directions.cos_o), reach(directions, alpha), strict=True)
    toward, away = (1 / (cos + (cos.square() + slanted.square()).sqrt()) for cos, slanted in sides)
    return toward * away


def correlated_ggx(directions: Directions, alpha: Tensor) -> Tensor:
    """G/(4 cos θi cos θr), Smith's masking with correlated heights (Heitz 2014, eq. 99)."""
    cosines = (directions.cos_i, directions.cos_o)
    toward, away = (
        (cos.square() + slanted.square()).sqrt()
        for cos, slanted in zip(cosines, reach(directions, alpha), strict=True)
    )  # fmt: skip
    return 0.5 / (toward * directions.cos_o + away * directions.cos_i)


def pair(alpha: Tensor) -> list[float]:
    """Widths along tangent and bitangent."""
    return alpha.expand(2).tolist()
