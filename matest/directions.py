"""Directions to the light and to the viewer in the local frame, and the angles between them.

Local frame: z is the surface normal, x the tangent, y the bitangent (right-handed). Both directions point away from
the surface. Each quantity is computed once, at its first use, and the terms of a sum share it.
"""

from __future__ import annotations

from functools import cached_property

import torch
from torch import Tensor

# Smallest sin²: two derivatives of its square root, and of the inverse of that, stay finite in float32.
_SIN2_FLOOR = 1e-16
# Smallest squared length in the half azimuth, for the same reason.
_HALF_AZIMUTH_FLOOR = 1e-12
# Smallest height of L + V, which graze from opposite sides there, for the same reason.
_HALF_Z_FLOOR = 1e-5
# Largest x² of the series of atan²(x): with six terms it is exact in float64 up to there.
_ATAN2_SMALL = 1e-3
# Its coefficients: atan²(x) = Σ (−1)^(n−1) (1 + 1/3 + … + 1/(2n−1)) x^(2n)/n.
_ATAN2_SERIES = [(-1) ** (n - 1) * sum(1 / (2 * k + 1) for k in range(n)) / n for n in range(1, 7)]


def dot(vectors: Tensor, other: Tensor) -> Tensor:
    """Scalar products [n] of vectors [n, 3] with as many others, or with one [1, 3]."""
    return vectors @ other[0] if len(other) == 1 else (vectors * other).sum(-1)


class Directions:
    """A batch of direction pairs. Every quantity has the shape [..., 1], ready to broadcast against channels.

    Args:
        wi: unit vectors to the light, [..., 3].
        wo: unit vectors to the viewer, [..., 3], broadcastable against `wi`.
    """

    def __init__(self, wi: Tensor, wo: Tensor) -> None:
        self._wi: tuple[Tensor, ...] = wi.split(1, dim=-1)
        self._wo: tuple[Tensor, ...] = wo.split(1, dim=-1)

    @property
    def cos_i(self) -> Tensor:
        """cos θi = N·L."""
        return self._wi[2]

    @property
    def cos_o(self) -> Tensor:
        """cos θr = N·V."""
        return self._wo[2]

    @cached_property
    def sin_i(self) -> Tensor:
        return _sine(self._wi)

    @cached_property
    def sin_o(self) -> Tensor:
        return _sine(self._wo)

    @cached_property
    def theta_i(self) -> Tensor:
        """Polar angle of the light, from both sine and cosine: accurate over the whole quadrant."""
        return torch.atan2(self.sin_i, self.cos_i)

    @cached_property
    def theta_o(self) -> Tensor:
        return torch.atan2(self.sin_o, self.cos_o)

    @cached_property
    def tangential(self) -> Tensor:
        """sin θi sin θr cos(φr − φi): the one scalar that carries the azimuth in isotropic models."""
        return self._wi[0] * self._wo[0] + self._wi[1] * self._wo[1]

    @cached_property
    def crosswise(self) -> Tensor:
        """sin θi sin θr sin(φr − φi)."""
        return self._wi[0] * self._wo[1] - self._wi[1] * self._wo[0]

    @cached_property
    def azimuthal(self) -> Tensor:
        """s / t: s = `tangential`, t = max(cos θi, cos θr) on the side of the light (s > 0), 1 on the far side."""
        t = torch.maximum(self.cos_i, self.cos_o).clamp(min=1e-6)
        return self.tangential / torch.where(self.tangential > 0, t, torch.ones_like(t))

    @cached_property
    def half_azimuth(self) -> tuple[Tensor, Tensor]:
        """Cosine and sine of (φr − φi)/2, |φr − φi| ≤ π; undefined, and finite, where a direction is the normal."""
        (xi, yi, _), (xo, yo, _) = self._wi, self._wo
        xi, yi, xo, yo = xi / self.sin_i, yi / self.sin_i, xo / self.sin_o, yo / self.sin_o
        # Half the sum and half the difference of unit vectors: no digits lost where the azimuths are nearly the same.
        cos2 = ((xi + xo).square() + (yi + yo).square()).clamp(min=_HALF_AZIMUTH_FLOOR)
        sin2 = ((xi - xo).square() + (yi - yo).square()).clamp(min=_HALF_AZIMUTH_FLOOR)
        length = (cos2 + sin2).sqrt()
        return cos2.sqrt() / length, sin2.sqrt() / length

    @cached_property
    def along_tangent(self) -> tuple[Tensor, Tensor]:
        """cos² of the azimuths of L and V from the tangent; undefined, and finite, at the normal."""
        return (self._wi[0] / self.sin_i).square(), (self._wo[0] / self.sin_o).square()

    @cached_property
    def mirror_chord2(self) -> Tensor:
        """|R − L|² = 2 (1 − cos γ), γ the angle between L and the mirror direction R of V."""
        x, y, z = self._wi[0] + self._wo[0], self._wi[1] + self._wo[1], self._wi[2] - self._wo[2]
        return x * x + y * y + z * z

    def along(self, azimuth: Tensor) -> tuple[Tensor, Tensor]:
        """Tangential components of L and V along an azimuth in radians, from the tangent toward the bitangent."""
        x, y = azimuth.cos(), azimuth.sin()
        return self._wi[0] * x + self._wi[1] * y, self._wo[0] * x + self._wo[1] * y

    @cached_property
    def half_squared(self) -> Tensor:
        """|L + V|² = 4 cos²θh, θh the angle between light and half vector. Positive above the horizon."""
        return self._half_tangential_squared + self.half_z * self.half_z

    @cached_property
    def cos_d(self) -> Tensor:
        """cos θh = V·H = L·H, clamped to at most 1 (inputs are unit vectors to rounding only)."""
        return (0.5 * self.half_squared.sqrt()).clamp(max=1.0)

    @cached_property
    def short_d(self) -> Tensor:
        """1 − cos θh = sin²θh/(1 + cos θh) with 4 sin²θh = |L − V|²: accurate where L and V are close."""
        squares = [(a - b).square() for a, b in zip(self._wi, self._wo, strict=True)]
        return 0.25 * (squares[0] + squares[1] + squares[2]) / (1 + self.cos_d)

    @cached_property
    def half_slopes(self) -> tuple[Tensor, Tensor]:
        """Slopes along tangent and bitangent of the facet that mirrors L to V: Hx/Hz, Hy/Hz."""
        x, y = self._wi[0] + self._wo[0], self._wi[1] + self._wo[1]
        return x / self.half_z, y / self.half_z

    @cached_property
    def tan2_half(self) -> Tensor:
        """tan²α, α the angle between half vector and normal."""
        # From the slopes: second derivatives of the quotient of the squares leave the range of float32.
        x, y = self.half_slopes
        return x * x + y * y

    @cached_property
    def cos2_half(self) -> Tensor:
        """cos²α."""
        return 1 / (1 + self.tan2_half)

    @cached_property
    def theta_half(self) -> Tensor:
        """α itself, by atan2: its derivative stays finite at α = 0."""
        return torch.atan2(self._half_tangential_squared.clamp(min=1e-20).sqrt(), self.half_z)

    @cached_property
    def theta2_half(self) -> Tensor:
        """α² = atan²(√tan²α), smooth in L and V: near 0 by its series, which needs no root."""
        u = self.tan2_half
        small, series = u.clamp(max=_ATAN2_SMALL), torch.zeros_like(u)
        for coefficient in reversed(_ATAN2_SERIES):
            series = small * (coefficient + series)
        root = u.clamp(min=_ATAN2_SMALL).sqrt()
        return torch.where(u < _ATAN2_SMALL, series, root.atan().square())

    @cached_property
    def half_z(self) -> Tensor:
        """cos θi + cos θr, the height of L + V."""
        # Only this height has a floor, so that cosine and tangent of α agree when L and V graze from opposite sides.
        return (self.cos_i + self.cos_o).clamp(min=_HALF_Z_FLOOR)

    @cached_property
    def _half_tangential_squared(self) -> Tensor:
        x = self._wi[0] + self._wo[0]
        y = self._wi[1] + self._wo[1]
        return x * x + y * y


def from_angles(theta: Tensor, phi: Tensor) -> Tensor:
    """Unit vectors [..., 3] at polar angles θ from the normal and azimuths φ from the tangent, in radians."""
    return torch.stack(torch.broadcast_tensors(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()), dim=-1)


def above_horizon(wi: Tensor, wo: Tensor) -> tuple[Directions, Tensor]:
    """Directions safe to evaluate, and the mask [..., 1] of pairs with both ends above the horizon.

    Pairs below the horizon are replaced by the normal *before* any arithmetic: their values are not used, but their
    derivatives must be finite.
    """
    directions = Directions(wi, wo)
    above = (directions.cos_i > 0) & (directions.cos_o > 0)
    # Component by component: each becomes an array of its own, which is faster to read than one column of three.
    directions._wi, directions._wo = (
        tuple(torch.where(above, part, end) for part, end in zip(vector, (0.0, 0.0, 1.0), strict=True))
        for vector in (directions._wi, directions._wo)
    )
    return directions, above


def to_local(normal: Tensor, *vectors: Tensor) -> list[Tensor]:
    """Components of world vectors [..., 3] in the frame (tangent, bitangent, normal) of unit normals [..., 3].

    The tangent is the projection of the world's x axis (of the y axis where the normal is near x): it varies smoothly
    over an object facing the viewer, and isotropic models do not depend on it.
    """
    nx, ny, nz = (part.contiguous() for part in normal.unbind(-1))
    near_x = nx.abs() >= 0.9
    # The axis along the tangent is x or y: its component of the normal, and 1/sin of the angle between them.
    along = torch.where(near_x, ny, nx)
    scale = (1 - along * along).rsqrt()
    components = []
    for vector in vectors:
        vx, vy, vz = vector.unbind(-1)
        z = nx * vx + ny * vy + nz * vz
        x = (torch.where(near_x, vy, vx) - along * z) * scale
        # The bitangent is normal × axis, to that scale.
        y = torch.where(near_x, nx * vz - nz * vx, nz * vy - ny * vz) * scale
        # Each component is an array of its own, which is faster to read than one column of three.
        components.append(torch.stack([x, y, z]).movedim(0, -1))
    return components


def _sine(vector: tuple[Tensor, ...]) -> Tensor:
    return (vector[0] * vector[0] + vector[1] * vector[1]).clamp(min=_SIN2_FLOOR).sqrt()
