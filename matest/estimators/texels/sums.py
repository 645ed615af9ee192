"""Sums over the photographs of every texel: columns of a model, and what they tell of unknowns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from torch import Tensor

from matest.estimators.columns import Columns
from matest.estimators.texels.unknowns import Row
from matest.samples.likelihood import LeastSquares

# Products of two columns that are computed before they are summed: as many as fit a cache.
_TOGETHER = 1 << 18


class Coefficients(NamedTuple):
    """The weights of K columns in the radiance of n texels.

    Attributes:
        total: [C, K, n].
        slopes: their derivatives by parameters, by name [C, K, n]; each channel's by its own value.
    """

    total: Tensor
    slopes: Mapping[str, Tensor]


class TexelNormal(NamedTuple):
    """The least-squares problem of R unknowns of each of n texels.

    Attributes:
        cost: rᵀWr [n].
        gradient: JᵀWr [R, n].
        information: JᵀWJ [R, R, n].
    """

    cost: Tensor
    gradient: Tensor
    information: Tensor


@dataclass(frozen=True, eq=False)
class TexelGram:
    """Sums of the columns Φ over the samples of every texel, r being the residual of some radiance.

    Attributes:
        products: ΦᵀWΦ [C, K, K, n].
        moments: ΦᵀWr [C, K, n].
        cost: rᵀWr [n].
        reference: coefficients of the radiance that residuals are of [C, K, n].
    """

    products: Tensor
    moments: Tensor
    cost: Tensor
    reference: Tensor

    @classmethod
    def of(cls, columns: Columns, squares: LeastSquares, reference: Tensor, images: int) -> TexelGram:
        """Of columns [G, K, I·n], residuals being those of coefficients `reference` [C, K, n]."""
        values = columns.values.unflatten(-1, (images, -1))
        tint = columns.tint[:, None, None, None]
        is_white = bool((tint == 1).all())
        weights, responses = (part.T.unflatten(-1, (images, -1)) for part in squares[1::-1])
        channels, count, size = len(weights), values.shape[1], values.shape[-1]
        products = reference.new_empty(channels, count, count, size)
        moments, cost = reference.new_empty(channels, count, size), reference.new_empty(size)
        together = max(_TOGETHER // max(channels * count**2 * images, 1), 1)
        for first in range(0, size, together):
            some = slice(first, first + together)
            here = values[..., some] if is_white else values[..., some] * tint
            residual = responses[..., some] - (reference[:, :, None, some].to(here) * here).sum(1)
            weighted = weights[:, None, :, some] * here
            products[..., some] = (weighted[:, :, None] * here[:, None]).sum(3)
            moments[..., some] = (weighted * residual[:, None]).sum(2)
            cost[some] = (weights[..., some] * residual.square()).sum((0, 1))
        return cls(products, moments, cost, reference)

    def normal(self, at: Coefficients, rows: Sequence[Row]) -> TexelNormal:
        """What the samples tell of unknowns about some coefficients, of which the first K belong to the columns."""
        count = self.reference.shape[1]
        change = at.total[:, :count] - self.reference
        bent = _times(self.products, change)
        cost = self.cost + (change * (bent - 2 * self.moments)).sum((0, 1))
        moments = self.moments - bent
        gradient = cost.new_empty(len(rows), len(cost))
        information = cost.new_zeros(len(rows), len(rows), len(cost))
        # Parameter by parameter, for all channels at once: short loops cost more than arithmetic.
        parts = [(part, at.slopes[name][:, :count]) for name, part in _by_name(rows).items()]
        images = [_times(self.products, slope) for _, slope in parts]
        for k, (part, slope) in enumerate(parts):
            gradient[part] = _of_rows((slope * moments).sum(1), part)
            for (other, _), image in zip(parts[: k + 1], images, strict=False):
                block = (slope * image).sum(1)
                if _count(part) == _count(other):
                    # Each channel has its own of both, or all share both.
                    information[part, other].diagonal().copy_(_of_rows(block, part).T)
                elif _count(part) > 1:
                    information[part, other] = block[:, None]
                else:
                    information[part, other] = block
                if other != part:
                    information[other, part] = information[part, other].transpose(0, 1)
        return TexelNormal(cost, gradient, information)

    def some(self, places: Tensor) -> TexelGram:
        """Of some of the texels, int64 [m]."""
        parts = (self.products, self.moments, self.cost, self.reference)
        return TexelGram(*(part.index_select(-1, places) for part in parts))


def _by_name(rows: Sequence[Row]) -> dict[str, slice]:
    """The places of each parameter's unknowns, one for all channels or one a channel."""
    places: dict[str, slice] = {}
    for k, row in enumerate(rows):
        places[row.name] = slice(places[row.name].start if row.name in places else k, k + 1)
    return places


def _times(matrices: Tensor, vectors: Tensor) -> Tensor:
    """Products of matrices [C, K, K, n] with vectors [C, K, n]."""
    out = matrices[:, :, 0] * vectors[:, :1]
    for k in range(1, vectors.shape[1]):
        out.addcmul_(matrices[:, :, k], vectors[:, k : k + 1])
    return out


def _count(part: slice) -> int:
    return part.stop - part.start


def _of_rows(by_channel: Tensor, part: slice) -> Tensor:
    """Sums by channel [C, n] as those of a parameter's unknowns [1 or C, n]."""
    return by_channel if _count(part) == len(by_channel) else by_channel.sum(0, keepdim=True)
