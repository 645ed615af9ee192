"""Fresnel reflectance of an interface, unpolarised light."""

from __future__ import annotations

import torch
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


def conductor(cos_d: Tensor, eta: Tensor, k: Tensor) -> Tensor:
    """Reflectance of a conductor of complex index `eta` − i `k`.

    F = ½ Rs (1 + ((ac − s²)² + b²c²)/((ac + s²)² + b²c²)),  Rs = ((a−c)² + b²)/((a+c)² + b²),
    (a − ib)² = (n − ik)² − s²,  c = cos_d, s² = 1 − c²

    Args:
        cos_d: cosine of the angle between light and half vector, in [0, 1].
        eta: real part n of the index, positive.
        k: extinction coefficient, at least 0.

    Source: Cook & Torrance 1982 (Fresnel equation); Born & Wolf. Sums of squares instead of the printed differences,
    and the smaller of a, b from ab = nk: no cancellation.
    """
    c, c2 = cos_d, cos_d * cos_d
    s2 = 1 - c2
    nk = eta * k
    t = eta * eta - k * k - s2
    modulus = (t * t + 4 * nk * nk).clamp(min=1e-24).sqrt()
    larger = (0.5 * (modulus + t.abs())).sqrt()
    smaller = nk / larger
    a, b = torch.where(t >= 0, larger, smaller), torch.where(t >= 0, smaller, larger)
    b2 = b * b
    senkrecht = ((a - c).square() + b2) / ((a + c).square() + b2)
    ratio = ((a * c - s2).square() + b2 * c2) / ((a * c + s2).square() + b2 * c2)
    return 0.5 * senkrecht * (1 + ratio)


def schlick_weight(short: Tensor) -> Tensor:
    """(1 − c)⁵, the share by which the reflectance has rise from its normal value to 1: F = f0 + (1 − f0)(1 − c)⁵.

    `short` is 1 − c, formed without cancellation (`Directions.short_d`).

    Source: Schlick 1994.
    """
    return short.square().square() * short


def colour_shift_weight(cos_d: Tensor, f0_mean: Tensor) -> Tensor:
    """max(0, F(θ) − F(0)) / (1 − F(0)): the share by which the colour has shifted from its normal value to the light's.

    F = ½(rs² + rp²) is the reflectance of a dielectric whose normal reflectance is the average over wavelengths
    `f0_mean`. With r0 = (n−1)/(n+1) and g² = n² + c² − 1 its two differences are computed as
    rs − r0 = 2(n−1)s²/((g+nc)(g+c)) and rp − r0 = −2n(n−1)s²/((g+nc)(n²c+g)). Subtracting F(0) from F(θ), which hardly
    differ over wide angles, would lose digits.

    Source: Cook & Torrance 1982, the interpolation of colours. The max removes the Brewster dip of the dielectric,
    which the metal does not have.
    """
    root = f0_mean.clamp(1e-6, 1 - 1e-4).sqrt()
    n_minus_1, n = 2 * root / (1 - root), (1 + root) / (1 - root)
    n2, c = n * n, cos_d
    s2 = 1 - c * c
    g = (n_minus_1 * (n + 1) + c * c).sqrt()
    rs, rp = n_minus_1 * (n + 1) / (g + c).square(), (n2 * c - g) / (n2 * c + g)
    rise = (rs + root) / (g + c) - n * (rp + root) / (n2 * c + g)
    return (n_minus_1 * s2 / (g + n * c) * rise * ((n + 1).square() / (4 * n))).clamp(min=0)
