"""Reflection geometry with explicit angles in 50 digits, to evaluate equations as they are printed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import mpmath
import torch
from mpmath import mp, mpf
from torch import Tensor

from matest.brdf import Brdf
from tests.sampling import random_angles, spherical
from tests.tolerances import UNDERFLOW

mp.dps = 50


@dataclass(frozen=True)
class Geometry:
    """Polar angles and azimuths of light and viewer."""

    theta_i: mpf
    phi_i: mpf
    theta_o: mpf
    phi_o: mpf

    @property
    def cos_i(self) -> mpf:
        return mpmath.cos(self.theta_i)

    @property
    def cos_o(self) -> mpf:
        return mpmath.cos(self.theta_o)

    @property
    def cos_azimuth(self) -> mpf:
        return mpmath.cos(self.phi_o - self.phi_i)

    @cached_property
    def light(self) -> mpmath.matrix:
        return _vector(self.theta_i, self.phi_i)

    @cached_property
    def view(self) -> mpmath.matrix:
        return _vector(self.theta_o, self.phi_o)

    @cached_property
    def half(self) -> mpmath.matrix:
        total = self.light + self.view
        return total / mpmath.norm(total)

    @property
    def alpha(self) -> mpf:
        """Angle between half vector and normal."""
        return mpmath.acos(self.half[2])

    @property
    def cos_difference(self) -> mpf:
        """V·H."""
        return (self.view.T * self.half)[0]

    @property
    def v_cavity(self) -> mpf:
        """G = min{1, 2(N·H)(N·V)/(V·H), 2(N·H)(N·L)/(V·H)}."""
        twice = 2 * self.half[2] / self.cos_difference
        return min(mpf(1), twice * self.cos_o, twice * self.cos_i)


def _vector(theta: mpf, phi: mpf) -> mpmath.matrix:
    sin = mpmath.sin(theta)
    return mpmath.matrix([sin * mpmath.cos(phi), sin * mpmath.sin(phi), mpmath.cos(theta)])


def angles_and_directions(n: int, seed: int) -> tuple[list[Geometry], Tensor, Tensor]:
    """`n` random geometries, and the same as float64 unit vectors `wi`, `wo`."""
    angles = random_angles(n, seed)
    geometries = [Geometry(*(mpf(angle) for angle in row)) for row in angles.tolist()]
    return geometries, spherical(angles[:, 0], angles[:, 1]), spherical(angles[:, 2], angles[:, 3])


def relative_deviation(actual: Tensor, expected: list[mpf]) -> float:
    """Largest |actual/expected − 1|; where both have underflowed they agree."""
    pairs = [(mpf(a), e) for a, e in zip(actual.reshape(-1).tolist(), expected, strict=True)]
    return float(max(abs(a - e) / max(abs(e), mpf(UNDERFLOW)) for a, e in pairs))


def deviation_from_print(brdf: Brdf, printed: Callable[[Geometry], mpf], seed: int, n: int = 60) -> float:
    """Largest relative deviation of a model in float64 from its printed equation, over random directions."""
    geometries, wi, wo = angles_and_directions(n, seed)
    assert wi.dtype == torch.float64
    return relative_deviation(brdf(wi, wo), [printed(geometry) for geometry in geometries])
