"""Fresnel reflectance of an interface, unpolarised light."""

from __future__ import annotations

from torch import Tensor


def dielectric(cos_d: Tensor, f0: Tensor) -> Tensor:
    """Reflectance of a dielectric with normal reflectance `f0` at the angle acos(cos_d) to the facet.

    F = ½ ((g−c)/(g+c))² {1 + [(c(g+c)−1)/(c(g−c)+1)]²},  g² = n² + c² − 1,  n = (1+√f0)/(1−√f0)

    Args:
        cos_d: cosine of the angle between light and half vector, in [0, 1].
        f0: reflectance at normal incidence, in [0, 1]; taken within [1e-6, 1 − 1e-4], where n is finite.

    Source: Cook & Torrance 1982 (Fresnel equation with k = 0). g − c is formed as (n²−1)/(g+c): no cancellation.
    """
    root = f0.clamp(1e-6, 1 - 1e-4).sqrt()
    n2_minus_1 = 4 * root / (1 - root).square()
    c = cos_d
    plus = (n2_minus_1 + c * c).sqrt() + c
    minus = n2_minus_1 / plus
    return 0.5 * (minus / plus).square() * (1 + ((c * plus - 1) / (c * minus + 1)).square())
