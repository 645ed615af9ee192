"""The texels of a tile eliminated from the least-squares problem of everything."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from matest.estimators.texels.fit import TexelFitter, TileFit
from matest.estimators.texels.small_systems import Factored
from matest.estimators.texels.sums import TexelNormal
from matest.estimators.texels.unknowns import TexelUnknowns

# Added to the diagonal, in units of it, for an unknown that is held by a bound.
_HELD = 1e12


class CommonSums(NamedTuple):
    """What texels tell together.

    Attributes:
        information: of the unknowns in common, the texels following them [S, S].
        scores: [S].
    """

    information: Tensor
    scores: Tensor


class Elimination(NamedTuple):
    """The texels of a tile eliminated from the least-squares problem of everything.

    Attributes:
        information: of each texel on the unknowns in common, which it follows [S, S, n].
        scores: of each [S, n].
        moves: how far each unknown of the texels follows those in common [T, S, n].
        covariance: of the texels where those in common stand still, without inflation [T, T, n].
        held: whether a bound holds an unknown [T, n].
    """

    information: Tensor
    scores: Tensor
    moves: Tensor
    covariance: Tensor
    held: Tensor

    @property
    def variance(self) -> Tensor:
        """Of the unknowns of the texels [T, n]."""
        return self.covariance.diagonal().T

    def replaced(self, places: Tensor, some: Elimination) -> Elimination:
        """The same where those at some places, int64 [m], are others."""
        return Elimination(*(part.index_copy(-1, places, new) for part, new in zip(self, some, strict=True)))

    def sums(self, counted: Tensor | None = None) -> CommonSums:
        """The sums over the texels that are `counted` [n]; None: all."""
        parts = (self.information, self.scores)
        if counted is not None:
            parts = (self.information * counted, self.scores * counted)
        return CommonSums(*(part.sum(-1, dtype=torch.float64) for part in parts))

    @classmethod
    def of(cls, fitter: TexelFitter, fit: TileFit) -> Elimination:
        """At a solution of the texels."""
        texels = fitter.texels
        normal = fit.normal([*texels.rows, *texels.common])
        count = len(texels.rows)
        held = _held(texels, fit.theta, normal)
        own = normal.information[:count, :count].clone()
        own.diagonal().mul_(1 + _HELD * held.T)
        cross, common = normal.information[:count, count:], normal.information[count:, count:]
        factored = Factored.of(own)
        moves = -factored.solve(cross) if cross.shape[1] else cross
        information = common + (cross[:, :, None] * moves[:, None]).sum(0)
        scores = normal.gradient[count:] + (moves * normal.gradient[:count, None]).sum(0)
        covariance = factored.inverse()
        # What a bound holds is known as well as it would be beside it, the others standing still.
        alone = normal.information[:count, :count].diagonal().T.clamp(min=torch.finfo(covariance.dtype).tiny)
        covariance.diagonal().copy_(torch.where(held, 1 / alone, covariance.diagonal().T).T)
        return cls(information, scores, moves, covariance, held)


def _held(texels: TexelUnknowns, theta: Tensor, normal: TexelNormal) -> Tensor:
    """Whether a bound holds each unknown of the texels [T, n]."""
    gradient = normal.gradient[: len(theta)]
    return ((theta <= texels.lower) & (gradient <= 0)) | ((theta >= texels.upper) & (gradient >= 0))
