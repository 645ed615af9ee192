"""Small even rectangles and discs of light, as points that stand for their parts above the horizon."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

# Most nodes along each side: 64 for a source.
LARGEST_ORDER = 8
# Half the size of a source, in widths of the narrowest lobe, up to which its middle stands for it to 1e-3.
_POINT = 0.076
# How much larger it may be for every further node along each side, to the same accuracy.
_PER_NODE = 0.57
# Curvature of what a matte surface sends back of a near light, by its cosine and distance, 1/rad².
MATTE_CURVATURE = 4.0
# Slope of the height of a source along a side, as a share of the side, below which it lies level.
_LEVEL = 1e-6


@dataclass(frozen=True)
class Source:
    """The shape of a small even source about its middle.

    Args:
        sides: half the width and half the height of a rectangle as vectors, two orthogonal radii of a disc [2, 3].
        round: whether it is a disc.
        order: nodes along each side.
    """

    sides: Tensor
    round: bool = False
    order: int = 2

    @property
    def nodes(self) -> int:
        return self.order**2

    @property
    def area(self) -> Tensor:
        """In world units²."""
        width, height = self.sides.norm(dim=1)
        return width * height * (math.pi if self.round else 4)

    def spread(self, middle: Tensor, positions: Tensor, normals: Tensor) -> tuple[Tensor, Tensor]:
        """Places [N, nodes, 3] that stand for the part above the horizon of N points, and their shares [N, nodes].

        Across the source run strips at Gaussian nodes: of Legendre for a rectangle, of Chebyshev for a disc, whose
        strips have the lengths √(1 − u²). Each ends where the horizon cuts it, and has Legendre nodes in what is left.
        Strips run along the side that is the steeper one against the horizon. Shares sum to that of the source which
        has risen.

        Args:
            middle: of the source [3].
            positions: of the surface [N, 3].
            normals: of the surface [N, 3].
        """
        across, along, length, weight = _rule(self.order, self.round, self.sides.dtype, self.sides.device)
        height = ((middle - positions) * normals).sum(-1)[:, None]
        slopes = normals @ self.sides.T
        turned = slopes[:, :1].abs() > slopes[:, 1:].abs()
        # The height at (u, v) is that of the middle plus u and v times the slopes.
        outer, inner = (
            torch.where(turned, slopes[:, 1:], slopes[:, :1]),
            torch.where(turned, slopes[:, :1], slopes[:, 1:]),
        )
        level = inner.abs() < _LEVEL * self.sides.norm(dim=1).max()
        cut = -(height + across * outer) / torch.where(level, 1, inner)
        lower = torch.where((inner > 0) & ~level, cut, -length).clamp(-length, length)
        upper = torch.where((inner < 0) & ~level, cut, length).clamp(-length, length)
        v = (lower[..., None] + upper[..., None] + along * (upper - lower)[..., None]) / 2
        shares = weight * ((upper - lower) / (2 * length))[..., None]
        shares = torch.where(level[..., None], shares * (height > 0)[..., None], shares)
        u = across[:, None].expand_as(v)
        first = torch.where(turned[..., None], v, u)[..., None] * self.sides[0]
        second = torch.where(turned[..., None], u, v)[..., None] * self.sides[1]
        return (middle + first + second).flatten(1, 2), shares.expand_as(v).flatten(1)

    def for_curvature(self, curvature: float, distance: float) -> Source:
        """The same source with as many nodes as make its light exact to about 1e-3 of its peak.

        Args:
            curvature: of what the surface reflects with the direction of the light, as a share of its peak, 1/rad².
            distance: to the nearest point of the surface.
        """
        half = float(self.sides.detach().norm(dim=1).max()) / distance
        widths = half * math.sqrt(max(curvature, MATTE_CURVATURE))
        order = 1 if widths < _POINT else max(2, math.ceil(1 + widths / _PER_NODE))
        return replace(self, order=min(order, LARGEST_ORDER))

    @property
    def key(self) -> tuple[float | bool, ...]:
        return (*self.sides.flatten().tolist(), self.round)

    def to(self, dtype: torch.dtype, device: torch.device | str) -> Source:
        return replace(self, sides=self.sides.to(device, dtype))


@lru_cache(maxsize=64)
def _rule(order: int, disc: bool, dtype: torch.dtype, device: torch.device) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Strips at u [n], nodes along them in −1 to 1 [n], half their lengths [n], and weights that sum to 1 [n, n]."""
    along, weight_along = np.polynomial.legendre.leggauss(order)
    across, weight_across, length = along, weight_along / 2, np.ones(order)
    if disc:
        angle = math.pi * np.arange(1, order + 1) / (order + 1)
        across, length = np.cos(angle), np.sin(angle)
        weight_across = 2 / (order + 1) * length**2
    arrays = (across, along, length, np.outer(weight_across, weight_along / 2))
    # Made outside inference mode: later calls may differentiate through the cached tensors.
    with torch.inference_mode(False):
        u, v, half, weight = (torch.from_numpy(array.copy()).to(device, dtype) for array in arrays)
        return u, v, half, weight
