"""Slope distributions, masking and Fresnel reflectance by definition, in 50 digits."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import mpmath
from mpmath import mpf, pi

from tests.exact import Geometry

Distribution = Callable[[Geometry, mpf], mpf]


def beckmann(g: Geometry, m: mpf) -> mpf:
    return mpmath.exp(-((mpmath.tan(g.alpha) / m) ** 2)) / (pi * m**2 * mpmath.cos(g.alpha) ** 4)


@cache
def gaussian_constant(m: mpf) -> mpf:
    """c that makes ∫ c exp(−(α/m)²) cos α dω one."""
    ends = [mpf(0), *(end for end in (m, 3 * m, 6 * m, 12 * m) if end < pi / 2), pi / 2]
    return 1 / mpmath.quad(lambda a: 2 * pi * mpmath.exp(-((a / m) ** 2)) * mpmath.cos(a) * mpmath.sin(a), ends)


def gaussian(g: Geometry, m: mpf) -> mpf:
    return gaussian_constant(m) * mpmath.exp(-((g.alpha / m) ** 2))


def ggx(g: Geometry, m: mpf) -> mpf:
    return m**2 / (pi * (m**2 * mpmath.cos(g.alpha) ** 2 + mpmath.sin(g.alpha) ** 2) ** 2)


def smith_g1(theta: mpf, slope_density: Callable[[mpf], mpf], scale: mpf) -> mpf:
    """1/(1 + Λ), Λ the integral of the slopes that shade: ∫_μ^∞ (q − μ) p(q) dq / μ, μ = cot θ."""
    mu = mpmath.cot(theta)
    ends = [mu, mu + scale, mu + 3 * scale, mu + 8 * scale, mu + 20 * scale, mpmath.inf]
    return 1 / (1 + mpmath.quad(lambda q: (q - mu) * slope_density(q), ends) / mu)


def ggx_slopes(m: mpf) -> Callable[[mpf], mpf]:
    """Density of one component of the slope: m²/(π (m² + p² + q²)²) integrated over the other."""
    return lambda q: m**2 / (2 * (m**2 + q**2) ** mpf("1.5"))


def dielectric(c: mpf, f0: float) -> mpf:
    """½ ((g−c)/(g+c))² {1 + [(c(g+c)−1)/(c(g−c)+1)]²}, g² = n² + c² − 1."""
    root = mpmath.sqrt(mpf(f0))
    index = (1 + root) / (1 - root)
    g = mpmath.sqrt(index**2 + c**2 - 1)
    return ((g - c) / (g + c)) ** 2 / 2 * (1 + ((c * (g + c) - 1) / (c * (g - c) + 1)) ** 2)


def conductor(c: mpf, eta: float, k: float) -> mpf:
    """½ (|rs|² + |rp|²) from Snell's law with the complex index η − ik."""
    index = mpmath.mpc(mpf(eta), -mpf(k))
    inside = mpmath.sqrt(1 - (1 - c**2) / index**2)
    r_s = (c - index * inside) / (c + index * inside)
    r_p = (index * c - inside) / (index * c + inside)
    return (abs(r_s) ** 2 + abs(r_p) ** 2) / 2


def schlick(c: mpf, f0: float) -> mpf:
    return mpf(f0) + (1 - mpf(f0)) * (1 - c) ** 5


def colour_shift(c: mpf, f0: float, f0_mean: float) -> mpf:
    """col0 + (col90 − col0) max(0, F(θ) − F(0))/(F(90°) − F(0)), col90 = F(90°) = 1."""
    normal, grazing = dielectric(mpf(1), f0_mean), dielectric(mpf(0), f0_mean)
    risen = max(mpf(0), dielectric(c, f0_mean) - normal) / (grazing - normal)
    return mpf(f0) + (1 - mpf(f0)) * risen
