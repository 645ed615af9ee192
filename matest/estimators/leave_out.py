"""The error that a model makes at samples left out of its fit, from additive statistics: leaving out is subtraction."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from matest.estimators.basis import TangentBasis
from matest.estimators.levenberg_marquardt import bounded_step, minimise, moved
from matest.estimators.passes import Evaluate, passes_over
from matest.estimators.statistics import Statistics
from matest.estimators.unknowns import Problem
from matest.samples import Batch, Tile
from matest.samples.likelihood import squared_errors
from matest.samples.residual_scale import ResidualScale
from matest.samples.tiles import in_memory

# Passes over a pilot: a model that fits takes four or five, and one that does not is not worth more.
_MAX_PASSES = 12
# Standard errors. A comparison needs no optimum closer than this.
_TOLERANCE = 0.1
# Share of the cost by which a step has to lower it where the model does not hold: a tenth of a per cent tells no two
# models apart.
_LEAST_SHARE = 1e-3
# The same of the cost beyond that of the noise, where it is less.
_LEAST_SHARE_BEYOND_NOISE = 1e-2


@dataclass(frozen=True, eq=False)
class LeftOut:
    """A model fitted to a pilot in B parts, and its error at each part when that is left out of the fit.

    Attributes:
        problem: what was estimated.
        unknowns: u [P] from all parts.
        cost: rᵀWr of all parts together, none left out.
        reduced_chi2: χ² per value that was measured well, none left out.
        costs: rᵀWr of each part when it is left out [B].
        moves: by which u changes then [B, P].
    """

    problem: Problem
    unknowns: Tensor
    cost: float
    reduced_chi2: float
    costs: Tensor
    moves: Tensor

    def relative_rmse(self, batch: Batch) -> float:
        """Rms residual over rms signal of the usable values of a batch, each predicted without its own part.

        The labels of its groups are those of the parts.
        """
        tile, basis = Tile(batch), TangentBasis(self.problem, self.unknowns)
        columns = basis.columns(tile)
        slopes = columns.sums((basis.slopes @ self.problem.selectors).mT)
        moves = self.moves[self.problem.groups.group_of(batch)].to(slopes)
        radiance = basis.radiance_of(columns, batch) + torch.einsum("pnc,np->nc", slopes, moves)
        residual, signal = squared_errors(radiance, batch.radiance, batch.noise)
        return math.sqrt(residual / signal) if signal > 0 else 0.0


def leave_out(
    problem: Problem, tile: Tile, start: Tensor, residual_scale: ResidualScale, parts: int, refine: bool = True
) -> LeftOut:
    """Fit a pilot, and predict each of its parts from the others.

    The optimum without a part is one Gauss-Newton step away; the error there follows to second order.

    Args:
        problem: what is estimated.
        tile: the pilot with a fixed least-squares problem; the labels of its groups are the parts.
        start: u [P] near the optimum.
        residual_scale: of the least-squares problem.
        parts: B.
        refine: whether to go from the start to the optimum; if not, errors are those one step from the start.
    """
    evaluate = passes_over(problem, in_memory([tile]), start, None, residual_scale)
    unknowns, statistics = start, evaluate(start)
    if refine:
        unknowns, statistics = _optimum(problem, start, evaluate, statistics)
    costs, moves = torch.zeros(parts, dtype=torch.float64), torch.zeros(parts, problem.size, dtype=torch.float64)
    for row, label in enumerate(statistics.labels.tolist()):
        moves[label] = _move_without(problem, unknowns, statistics, row)
        costs[label] = _cost_after(statistics, row, moves[label])
    return LeftOut(problem, unknowns, statistics.cost, statistics.reduced_chi2, costs, moves)


def _optimum(problem: Problem, start: Tensor, evaluate: Evaluate, first: Statistics) -> tuple[Tensor, Statistics]:
    """The lowest point u [P] of a descent from a start, and the statistics there."""
    lowest = start, first

    def recorded(unknowns: Tensor) -> Statistics:
        nonlocal lowest
        statistics = evaluate(unknowns)
        if statistics.cost < lowest[1].cost:
            lowest = unknowns, statistics
        return statistics

    minimise(problem, start, recorded, passes=_MAX_PASSES, tolerance=_tolerance, first=first)
    return lowest


def _tolerance(statistics: Statistics) -> float:
    """The length of a step, in standard errors, that no comparison of models would show."""
    cost, noise = statistics.cost, statistics.total("values")
    drop = min(_LEAST_SHARE * cost, _LEAST_SHARE_BEYOND_NOISE * (cost - noise))
    return max(math.sqrt(max(drop, 0.0) / statistics.inflation), _TOLERANCE)


def _move_without(problem: Problem, unknowns: Tensor, statistics: Statistics, row: int) -> Tensor:
    """The change of u [P] when one of the groups is left out."""
    part = statistics.only(row)
    change = bounded_step(
        problem, unknowns, statistics.information - part.information, statistics.gradient - part.gradient
    )
    return moved(problem, unknowns, change) - unknowns


def _cost_after(statistics: Statistics, row: int, change: Tensor) -> float:
    """rᵀWr of one of the groups after a change of u [P]; without noise rounding could make it negative."""
    return max(statistics.only(row).moved(change).total("cost"), 0.0)
