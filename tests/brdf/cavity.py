"""V-cavities by other routes than `matest.brdf.groove`: the printed equations, their quadrature, and traced rays."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import mpmath
import numpy as np
from mpmath import mpf, pi
from scipy.integrate import dblquad
from scipy.special import roots_legendre
from scipy.stats import qmc

from tests.exact import Geometry

Array = np.ndarray


def facet_normals(t: mpf, psi: mpf) -> tuple[mpmath.matrix, mpmath.matrix]:
    """A facet tilted by t toward ψ, and the one opposite."""
    sin, cos = mpmath.sin(t), mpmath.cos(t)
    x, y = sin * mpmath.cos(psi), sin * mpmath.sin(psi)
    return mpmath.matrix([x, y, cos]), mpmath.matrix([-x, -y, cos])


def _dot(a: mpmath.matrix, b: mpmath.matrix) -> mpf:
    return (a.T * b)[0]


def _clip(x: mpf) -> mpf:
    return min(max(x, mpf(0)), mpf(1))


def printed_direct(g: Geometry, t: mpf, psi: mpf) -> mpf:
    """Eq. 6 for one facet, over (ρ/π) E0 cos θi."""
    a, _ = facet_normals(t, psi)
    lit, seen = _dot(g.light, a), _dot(g.view, a)
    if lit <= 0 or seen <= 0:
        return mpf(0)
    shadow, mask = 2 * g.cos_i * a[2] / lit, 2 * g.cos_o * a[2] / seen
    attenuation = min(mpf(1), max(mpf(0), shadow), max(mpf(0), mask))
    return lit * seen * attenuation / (a[2] * g.cos_o * g.cos_i)


def widths(g: Geometry, t: mpf, psi: mpf) -> tuple[mpf, mpf] | None:
    """Masked part of a facet and shadowed part of the one opposite, from the bottom; None if nothing is exchanged."""
    a, opposite = facet_normals(t, psi)
    seen, lit = _dot(g.view, a), _dot(g.light, opposite)
    if seen <= 0 or lit <= 0:
        return None
    return _clip(-_dot(g.view, opposite) / seen), _clip(-_dot(g.light, a) / lit)


def interreflection_factor(t: mpf, masked: mpf, shadowed: mpf) -> mpf:
    """Eq. 11."""

    def d(x: mpf, y: mpf) -> mpf:
        return mpmath.sqrt(x * x + 2 * x * y * mpmath.cos(2 * t) + y * y)

    one = mpf(1)
    return pi / 2 * (d(one, masked) + d(one, shadowed) - d(shadowed, masked) - d(one, one))


def interreflection_integral(t: mpf, masked: mpf, shadowed: mpf) -> mpf:
    """The kernel of eq. 8 over the lit part of one facet and the seen part of the other, by adaptive quadrature."""
    cos, scale = math.cos(2 * float(t)), math.pi * math.sin(2 * float(t)) ** 2 / 2

    def kernel(x: float, y: float) -> float:
        return scale * x * y / (x * x + 2 * x * y * cos + y * y) ** 1.5

    return mpf(dblquad(kernel, float(masked), 1, float(shadowed), 1, epsabs=1e-13, epsrel=1e-11)[0])


def printed_second(
    g: Geometry, t: mpf, psi: mpf, factor: Callable[[mpf, mpf, mpf], mpf] = interreflection_factor
) -> mpf:
    """Eq. 10 for one facet, over (ρ²/π) E0 cos θi: `factor` IF takes π out of (ρ/π)²."""
    limits = widths(g, t, psi)
    if limits is None:
        return mpf(0)
    a, opposite = facet_normals(t, psi)
    exchanged = _dot(g.light, opposite) * _dot(g.view, a) / (a[2] * g.cos_o * g.cos_i)
    return exchanged * factor(t, *limits) / pi


# The same equations on arrays, for integrals over many grooves.


def bounces(light: Array, view: Array, t: Array, psi: Array) -> tuple[Array, Array]:
    """Eq. 6 and 10-11 of one facet, over (ρ/π) E0 cos θi and (ρ²/π) E0 cos θi."""
    sin, cos, x, y = np.sin(t), np.cos(t), np.cos(psi), np.sin(psi)
    lit, seen = (v[2] * cos + sin * (v[0] * x + v[1] * y) for v in (light, view))
    lit_2, seen_2 = (v[2] * cos - sin * (v[0] * x + v[1] * y) for v in (light, view))
    scale = cos * light[2] * view[2]
    with np.errstate(divide="ignore", invalid="ignore"):
        shadow, mask = 2 * light[2] * cos / lit, 2 * view[2] * cos / seen
        first = np.where((lit > 0) & (seen > 0), lit * seen * np.minimum(1, np.minimum(shadow, mask)) / scale, 0)
        masked, shadowed = np.clip(-seen_2 / seen, 0, 1), np.clip(-lit / lit_2, 0, 1)

        def d(x: Array | float, y: Array | float) -> Array:
            return np.sqrt(np.square(x) + 2 * np.cos(2 * t) * x * y + np.square(y))

        factor = (d(1, masked) + d(1, shadowed) - d(shadowed, masked) - d(1, 1)) / 2
        second = np.where((lit_2 > 0) & (seen > 0), lit_2 * seen * factor / scale, 0)
    return first, second


@cache
def slope_nodes(count: int) -> tuple[Array, Array]:
    """Nodes and weights on [0, π/2], crowded toward 0."""
    u, weight = roots_legendre(count)
    u = (u + 1) / 2
    return math.pi / 2 * u**2, math.pi / 2 * u * weight


def images(light: Array, view: Array, slopes: int, orientations: int) -> Array:
    """Means over all azimuths of both bounces, of grooves of every slope node: [2, slopes]."""
    t, _ = slope_nodes(slopes)
    # Off any symmetry of the directions.
    psi = (np.arange(orientations) + 0.3) * (2 * math.pi / orientations)
    return np.stack([part.mean(-1) for part in bounces(light, view, t[:, None], psi)])


def slope_weights(sigma: float, slopes: int) -> Array:
    """P(t) sin t dt of eq. 12: fractions of the projected area."""
    t, weight = slope_nodes(slopes)
    area = np.exp(-np.square(t / sigma) / 2) * np.sin(t) * weight
    return area / area.sum()


def drawn_slopes(uniform: Array, sigma: float) -> Array:
    """Slopes dense as P(t) sin t from numbers uniform on [0, 1]."""
    t = np.linspace(0, math.pi / 2, 20001)
    density = np.exp(-np.square(t / sigma) / 2) * np.sin(t)
    cumulative = np.concatenate([[0.0], np.cumsum(density[1:] + density[:-1])])
    return np.interp(uniform, cumulative / cumulative[-1], t)


def trace(uniform: Array, light: Array, view: Array, t: Array | float, psi: Array | float) -> tuple[float, float]:
    """Mean of both bounces, one ray per groove (t, ψ), over (ρ/π) E0 cos θi and (ρ²/π) E0 cos θi.

    `uniform` [4, n] chooses facet, point and direction. A groove seen along its length is two segments that meet at the
    origin and rise to unit width. Of a point on one of them, a direction is free where it leaves the facet and does not
    meet the other facet.
    """
    cos, sin = np.cos(t), np.sin(t)
    # The facet that faces right stands on the left.
    side, along = np.where(uniform[0] < 0.5, -1.0, 1.0), uniform[1]
    across_light, across_view = (v[0] * np.cos(psi) + v[1] * np.sin(psi) for v in (light, view))

    def leaves(side: Array, x: Array | float, z: Array | float) -> Array:
        return -side * sin * x + cos * z

    def meets_other(side: Array, along: Array, x: Array, z: Array | float) -> tuple[Array, Array]:
        """Whether the ray from `along` on one facet toward (x, z) crosses the other, and how far up that."""
        start_x, start_z = side * cos * along, sin * along
        with np.errstate(divide="ignore", invalid="ignore"):
            # start + τ (x, z) = u (−side cos t, sin t)
            determinant = x * sin + side * cos * z
            tau = (-side * cos * start_z - sin * start_x) / determinant
            up = (x * start_z - z * start_x) / determinant
        return (tau > 0) & (up >= 0) & (up <= 1), up

    def free(side: Array, along: Array, x: Array, z: float) -> Array:
        return (leaves(side, x, z) > 0) & ~meets_other(side, along, x, z)[0]

    seen = leaves(side, across_view, view[2]) * free(side, along, across_view, view[2])
    area = cos * light[2] * view[2]
    first = leaves(side, across_light, light[2]) * free(side, along, across_light, light[2]) * seen / area

    # A direction dense as its cosine with the facet normal; the component left out runs along the groove.
    radius, turn = np.sqrt(uniform[2]), 2 * math.pi * uniform[3]
    out, up_slope = np.sqrt(1 - radius**2), radius * np.cos(turn)
    x, z = -side * sin * out + side * cos * up_slope, cos * out + sin * up_slope
    hit, height = meets_other(side, along, x, z)
    height = np.where(hit, height, 0.5)
    sent = leaves(-side, across_light, light[2]) * free(-side, height, across_light, light[2]) * hit
    second = sent * seen / area
    return first.mean(), second.mean()


# What the traced means must reach before anything is compared with them, as a fraction of them.
STANDARD_ERROR = 0.005


def trace_batches(trace_one: Callable[[Array], tuple[float, float]], power: int) -> list[tuple[float, float]]:
    """Mean and standard error of both bounces over 16 independent scrambled sequences [6, 2^power]."""
    batches = np.array([trace_one(qmc.Sobol(6, seed=seed).random_base2(power).T) for seed in range(16)])
    return list(zip(batches.mean(0).tolist(), (batches.std(0, ddof=1) / 4).tolist(), strict=True))


def traced_surface(light: Array, view: Array, sigma: float, power: int) -> list[tuple[float, float]]:
    """Grooves of every orientation with slopes dense as P(t) sin t: fractions of the projected area."""
    return trace_batches(
        lambda uniform: trace(uniform[2:], light, view, drawn_slopes(uniform[0], sigma), 2 * math.pi * uniform[1]),
        power,
    )
