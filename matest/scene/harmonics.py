"""Irradiance from a map of radiance by spherical harmonics: a convolution with the clamped cosine.

E(n) = Σ_l A_l Σ_m L_lm Y_lm(n),   A_l = 2π ∫₀¹ t P_l(t) dt,   L_lm = ∫ L Y_lm dω

A_l is 0 for odd l > 1 and falls as l^(−5/2). Orders beyond `ORDER` add at most `TRUNCATION` of the light, if all of it
came from one point on the horizon, and far less of light from broad parts of the sky.

Source: Ramamoorthi & Hanrahan 2001, "An efficient representation for irradiance environment maps".
"""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

# Highest order l.
ORDER = 8
# Largest difference between max(cos θ, 0) and its Legendre series up to that order.
TRUNCATION = 0.0337
# Orders that the clamped cosine has.
_ORDERS = (0, 1, *range(2, ORDER + 1, 2))


def harmonics(directions: Tensor) -> Tensor:
    """Real orthonormal harmonics of the orders that the clamped cosine has, at unit vectors [..., 3], [..., T]."""
    x, y, z = directions.unbind(-1)
    # Re and Im of (x + i y)^m hold the sine of the polar angle to the m as well: polynomials throughout.
    real, imaginary, factorial = torch.ones_like(x), torch.zeros_like(x), 1.0
    values: dict[tuple[int, int], Tensor] = {}
    for m in range(ORDER + 1):
        below, here = torch.zeros_like(z), torch.full_like(z, factorial)
        for degree in range(m, ORDER + 1):
            if degree in _ORDERS:
                scale = math.sqrt(
                    (2 * degree + 1) / (4 * math.pi) * math.factorial(degree - m) / math.factorial(degree + m)
                )
                values[degree, m] = scale * (math.sqrt(2) if m else 1) * here * real
                if m:
                    values[degree, -m] = scale * math.sqrt(2) * here * imaginary
            below, here = here, ((2 * degree + 1) * z * here - (degree + m) * below) / (degree - m + 1)
        real, imaginary, factorial = x * real - y * imaginary, x * imaginary + y * real, factorial * (2 * m + 1)
    return torch.stack([values[degree, m] for degree in _ORDERS for m in range(-degree, degree + 1)], dim=-1)


def cosine_coefficients(dtype: torch.dtype = torch.float64) -> Tensor:
    """A_l of every harmonic [T]."""
    node, weight = np.polynomial.legendre.leggauss(ORDER + 1)
    t, w = (node + 1) / 2, weight / 2
    by_order = [2 * math.pi * np.sum(w * t * np.polynomial.legendre.legval(t, np.eye(n + 1)[n])) for n in _ORDERS]
    counts = torch.tensor([2 * degree + 1 for degree in _ORDERS])
    return torch.tensor(by_order, dtype=dtype).repeat_interleave(counts)
