"""The texels of a tile eliminated from the least-squares problem of everything."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from matest.estimators.texels.fit import TexelFitter, TileFit
from matest.estimators.texels.small_systems import Factored
from matest.estimators.texels.sums import TexelNormal
from matest.estimators.texels.unknowns import TexelUnknowns

# Added to the diagonal, in units of it, for an unknown that is held by a bound.
_HELD = 1e12
# Share of the information on an unknown that is left once the others follow it, below which it is rounding.
_SINGULAR = 1e-6
# Standard deviations beyond a bound that the cut Gaussian is told at: rounding takes what is left further out.
_FAR_BEYOND = 1e3


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
        covariance: of the texels where those in common stand still, without inflation [T, T, n]; of what a bound holds
            the mean square of its distance from there.
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
    def of(cls, fitter: TexelFitter, fit: TileFit, inflation: float = 1.0) -> Elimination:
        """At a solution of the texels; `inflation` of squared errors says how far a bound's push reaches."""
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
        for row in held.any(1).nonzero()[:, 0].tolist():
            at = held[row].nonzero()[:, 0]
            some = normal.information[:count, :count, at]
            covariance[..., at] += _of_held(row, some, normal.gradient[row, at], own[..., at], inflation)
        return cls(information, scores, moves, covariance, held)


def _held(texels: TexelUnknowns, theta: Tensor, normal: TexelNormal) -> Tensor:
    """Whether a bound holds each unknown of the texels [T, n]."""
    gradient = normal.gradient[: len(theta)]
    return ((theta <= texels.lower) & (gradient <= 0)) | ((theta >= texels.upper) & (gradient >= 0))


def _of_held(row: int, information: Tensor, gradient: Tensor, own: Tensor, inflation: float) -> Tensor:
    """What an unknown that a bound holds adds to the covariance of n texels, without inflation [T, T, n].

    Beside the bound, at a distance δ ≥ 0, the density falls as exp(−(A δ² / 2 + g δ) / χ²), A being the information on
    the unknown with the others following and g what pushes against the bound: a Gaussian that the bound cuts off.

    Args:
        row: of the unknown in θ.
        information: of the texels [T, T, n].
        gradient: of the unknown [n].
        own: the information with what bounds hold standing still [T, T, n].
        inflation: χ².
    """
    follow = -Factored.of(own).solve(information[:, row])
    follow[row] = 1
    left = (information[row] * follow).sum(0).double()
    variance = inflation / left.clamp(min=_SINGULAR * information[row, row].double() + torch.finfo(own.dtype).tiny)
    # Standard deviations by which the middle of the Gaussian lies beyond the bound.
    beyond = (gradient.double().abs() * variance.sqrt() / inflation).clamp(max=_FAR_BEYOND)
    cut = variance * (
        1 + beyond.square() - beyond * math.sqrt(2 / math.pi) / torch.special.erfcx(beyond / math.sqrt(2))
    )
    return (follow[:, None] * follow * (cut / inflation).to(own)).to(own)
