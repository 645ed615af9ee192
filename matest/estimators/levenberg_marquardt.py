"""Levenberg-Marquardt within bounds, on additive statistics."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from matest.estimators.passes import Evaluate
from matest.estimators.statistics import Statistics
from matest.estimators.unknowns import Problem
from matest.samples import Tiles
from matest.samples.residual_scale import NOISE_ALONE, ResidualScale

# Standard errors below which a step ends a fit, or what gives them for the statistics where the step starts.
Tolerance = float | Callable[[Statistics], float]

# Passes over the samples; a fit that takes more goes round in circles.
MAX_PASSES = 60
# Share of χ². A smaller expected drop is lost in the rounding of single precision.
_ROUNDING_DROP = 1e-9
# Share of the width of a domain. A smaller move of an unknown is rounding.
_ROUNDING_MOVE = 1e-6
# Standard errors. A fit that rounding ends counts as converged if its next step would be no longer.
_CONVERGED_STEP = 0.1
# Standard errors. After a step that did not lower χ² the next may be short only because it is damped: to end the fit it
# has to be shorter than this.
_DAMPED_TOLERANCE = 0.01
# Damping that keeps the scaled normal equations regular: far above the rounding of double precision.
_REGULARISATION = 1e-13
# Damping at the start: hardly any, since starts lie near an optimum.
_FIRST_DAMPING = 1e-6
# Least damping after a step that did not lower χ².
_RETRY_DAMPING = 1e-3
# Active sets tried, as a multiple of the number of unknowns; far more than are ever needed.
_MAX_ACTIVE_SETS = 4
# Share of the width of a domain. An unknown this near an end lies on it, up to rounding.
_BOUND_MARGIN = 1e-9


@dataclass(frozen=True)
class Solution:
    """Where an iteration ended.

    Attributes:
        problem: what was solved.
        unknowns: u [P].
        statistics: of the last pass, at most `last_step` away from `unknowns`.
        iterations: passes over the samples.
        last_step: length of the last step, in standard errors.
        converged: whether that is small.
        residual_scale: typical residual in standard deviations of the noise, by which outliers were judged.
        tiles: of the samples that it rests on.
    """

    problem: Problem
    unknowns: Tensor
    statistics: Statistics
    iterations: int
    last_step: float
    converged: bool
    residual_scale: ResidualScale = NOISE_ALONE
    tiles: Tiles = ()


def at_bound(problem: Problem, unknowns: Tensor, gradient: Tensor) -> Tensor:
    """True for unknowns [P] at an end of their domain that the data push outward (JᵀWr points downhill)."""
    below, above = _ends(problem, unknowns)
    return (below & (gradient <= 0)) | (above & (gradient >= 0))


def moved(problem: Problem, unknowns: Tensor, change: Tensor) -> Tensor:
    """u [P] after a change; what ends on a bound lies on it exactly.

    A rounding beside it a shape may have a derivative so small that the step along it is without limit.
    """
    end = unknowns + change
    below, above = _ends(problem, end)
    return torch.where(below, problem.lower, torch.where(above, problem.upper, end))


def _ends(problem: Problem, unknowns: Tensor) -> tuple[Tensor, Tensor]:
    """Which unknowns [P] lie on the lower and which on the upper end of their domain."""
    lower, upper = problem.lower, problem.upper
    width = torch.where(torch.isfinite(upper), upper - lower, torch.ones_like(upper))
    return unknowns <= lower + _BOUND_MARGIN * width, unknowns >= upper - _BOUND_MARGIN * width


@dataclass(frozen=True)
class _Step:
    """A damped Gauss-Newton step inside the bounds.

    Attributes:
        change: of the unknowns [P].
        slope: rate at which χ² falls along it at its start.
        curvature: second-order term of the Gauss-Newton model, so that χ² drops by slope − curvature.
        length: see `step_length`: short along a direction that is hardly determined.
    """

    change: Tensor
    slope: float
    curvature: float
    length: float


def _step(problem: Problem, unknowns: Tensor, statistics: Statistics, damping: float) -> _Step:
    information, gradient = statistics.information, statistics.gradient
    change = bounded_step(problem, unknowns, information, gradient, damping)
    curvature = float((change @ information @ change).clamp(min=0))
    length = step_length(problem, change, information, statistics.inflation)
    return _Step(change, float(2 * gradient @ change), curvature, length)


def step_length(problem: Problem, change: Tensor, information: Tensor, inflation: float) -> float:
    """The length of a change of u [P] in standard errors, jointly; beside errors of the calibration that of the others.

    Args:
        problem: names the unknowns.
        change: of u [P].
        information: JᵀWJ [P, P].
        inflation: how many times as large as the noise variance squared residuals are.
    """
    if problem.nuisances:
        count = problem.where[problem.nuisances[0].name].start
        cross = information[:count, count:]
        information = information[:count, :count] - cross @ torch.linalg.solve(information[count:, count:], cross.T)
        change = change[:count]
    return math.sqrt(max(float(change @ information @ change), 0.0) / inflation)


def bounded_step(
    problem: Problem, unknowns: Tensor, information: Tensor, gradient: Tensor, damping: float = 0.0
) -> Tensor:
    """The change of u [P] that minimises the damped quadratic model of χ² inside the bounds (primal active set)."""
    # An unknown without information stays where it is.
    informed = information.diagonal() > 0
    root = information.diagonal().clamp(min=0).sqrt()
    scale = torch.where(informed, 1 / root, 0.0)
    # In units of standard errors without correlation: the damped matrix has diagonal 1 + damping.
    scaled = (
        information * scale[:, None] * scale[None, :] + (damping + _REGULARISATION) * torch.eye(len(scale)).double()
    )
    position, slope = unknowns, gradient * scale
    active = at_bound(problem, position, slope) | ~informed
    for _ in range(_MAX_ACTIVE_SETS * problem.size):
        index = (~active).nonzero()[:, 0]
        direction = torch.zeros_like(unknowns)
        if len(index):
            # The default driver, gelsy, reads its pivots from memory that nobody has set: its last bits vary by call.
            step = torch.linalg.lstsq(scaled[index][:, index], slope[index][:, None], driver="gelsd").solution[:, 0]
            direction[index] = step * scale[index]
        # Go no further than the first bound on the way; the unknown that meets it stays there.
        room = torch.where(direction > 0, problem.upper - position, problem.lower - position)
        share = torch.where(direction != 0, room / direction, math.inf).clamp(min=0)
        reach = float(share.min())
        position = position + min(reach, 1.0) * direction
        position = torch.minimum(torch.maximum(position, problem.lower), problem.upper)
        slope = gradient * scale - scaled @ ((position - unknowns) * root)
        if reach < 1:
            active[int(share.argmin())] = True
            continue
        inward = active & informed & ~at_bound(problem, position, slope)
        if not bool(inward.any()):
            break
        active[int((inward * slope.abs()).argmax())] = False
    return position - unknowns


def step_is_visible(problem: Problem, unknowns: Tensor, change: Tensor, length: float) -> bool:
    """Whether no unknown moves by more of its domain than the step has standard errors.

    A step that does so follows a direction in which the model is flat here; elsewhere the model may not be flat.

    Args:
        problem: gives the domains.
        unknowns: u [P].
        change: of u [P].
        length: of the step, in standard errors.
    """
    width = problem.upper - problem.lower
    width = torch.where(torch.isfinite(width), width, 1 + unknowns.abs())
    return bool((change.abs() <= max(length, _ROUNDING_MOVE) * width).all())


def minimise(
    problem: Problem,
    start: Tensor,
    evaluate: Evaluate,
    *,
    passes: int,
    tolerance: Tolerance,
    first: Statistics | None = None,
) -> Solution:
    """Minimise a sum of squares with fixed weights from `start` (damping after Nielsen 1999).

    Args:
        problem: bounds.
        start: u [P].
        evaluate: a pass over the samples: statistics at u with the same weights every time.
        passes: at most this many.
        tolerance: stop when the next step would move u by less than this many standard errors. These follow from the
            residuals: a misfit makes them larger than the noise alone would.
        first: the statistics at the start, if a pass has given them already.
    """
    unknowns = moved(problem, start, torch.zeros_like(start))
    statistics = evaluate(unknowns) if first is None else first
    damping, growth, share = _FIRST_DAMPING, 2.0, 1.0
    step = _step(problem, unknowns, statistics, damping)
    for iteration in range(1, passes):
        was_rejected = growth > 2.0
        limit = _limit(tolerance, statistics)
        if step.length < (min(limit, _DAMPED_TOLERANCE) if was_rejected else limit):
            # The last step needs no pass: the one after it would be shorter by its square.
            change = share * step.change
            if not step_is_visible(problem, unknowns, step.change, step.length):
                change = torch.zeros_like(unknowns)
            end = moved(problem, unknowns, change)
            return Solution(problem, end, statistics, iteration, step.length, True)
        chi2 = statistics.cost
        expected_drop = share * step.slope - share**2 * step.curvature
        target = moved(problem, unknowns, share * step.change)
        target_statistics = evaluate(target)
        drop = chi2 - target_statistics.cost
        if drop > 0:
            # Residuals of a model that does not hold curve χ² more than the Gauss-Newton model: shorten the next step.
            curvature_ratio = (share * step.slope - drop) / (share**2 * step.curvature)
            unknowns, statistics = target, target_statistics
            damping *= max(0.1, 1 - (2 * drop / expected_drop - 1) ** 3)
            growth, share = 2.0, 1 / max(curvature_ratio, 1.0)
        elif expected_drop < _ROUNDING_DROP * chi2:
            return Solution(problem, unknowns, statistics, iteration + 1, step.length, step.length < _CONVERGED_STEP)
        else:
            damping, growth, share = max(damping, _RETRY_DAMPING) * growth, growth * 2, 1.0
        step = _step(problem, unknowns, statistics, damping)
    converged = step.length < _limit(tolerance, statistics)
    return Solution(problem, unknowns, statistics, passes, step.length, converged)


def _limit(tolerance: Tolerance, statistics: Statistics) -> float:
    return tolerance(statistics) if callable(tolerance) else tolerance
