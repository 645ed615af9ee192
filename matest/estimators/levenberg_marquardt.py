"""Levenberg-Marquardt within bounds, on additive statistics."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from matest.estimators.passes import Evaluate
from matest.estimators.statistics import Statistics
from matest.estimators.unknowns import Problem
from matest.samples import Tiles

# A promised drop in χ² below this share of it drowns in single-precision rounding; where it does, the estimate counts
# as converged if the step it comes from is no longer than so many standard errors.
_ROUNDING = 1e-9
# Moves by a smaller share of a domain are rounding.
_ROUNDING_STEP = 1e-6
_SHORT = 0.1
# After a step that led nowhere the next may be short because it is damped: it has to be shorter than so many to end.
_DAMPED = 0.01


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
    residual_scale: float = 1.0
    tiles: Tiles = ()


def at_bound(problem: Problem, unknowns: Tensor, gradient: Tensor) -> Tensor:
    """True for unknowns at an end of their domain that the data push outward (gradient = JᵀWr points downhill)."""
    lower, upper = problem.lower, problem.upper
    width = torch.where(torch.isfinite(upper), upper - lower, torch.ones_like(upper))
    below = (unknowns <= lower + 1e-9 * width) & (gradient <= 0)
    above = (unknowns >= upper - 1e-9 * width) & (gradient >= 0)
    return below | above


@dataclass(frozen=True)
class _Step:
    """A damped Gauss-Newton step inside the bounds.

    Attributes:
        change: of the unknowns [P].
        slope: rate at which χ² falls along it at its start.
        curvature: the Gauss-Newton model's second-order rise, so that χ² drops by slope − curvature.
        length: in standard errors, jointly: a step along a direction the data hardly see is long but harmless.
    """

    change: Tensor
    slope: float
    curvature: float
    length: float


def _step(problem: Problem, unknowns: Tensor, statistics: Statistics, damping: float) -> _Step:
    information, gradient = statistics.information, statistics.gradient
    change = bounded_step(problem, unknowns, information, gradient, damping)
    curvature = float((change @ information @ change).clamp(min=0))
    return _Step(change, float(2 * gradient @ change), curvature, math.sqrt(curvature / statistics.inflation))


def bounded_step(
    problem: Problem, unknowns: Tensor, information: Tensor, gradient: Tensor, damping: float = 0.0
) -> Tensor:
    """The change of u [P] that minimises the damped quadratic model of χ² inside the bounds (primal active set)."""
    # An unknown without information stays where it is.
    informed = information.diagonal() > 0
    root = information.diagonal().clamp(min=0).sqrt()
    scale = torch.where(informed, 1 / root, 0.0)
    # In units of standard errors without correlation: the damped matrix has diagonal 1 + damping.
    scaled = information * scale[:, None] * scale[None, :] + (damping + 1e-13) * torch.eye(len(scale)).double()
    position, slope = unknowns, gradient * scale
    held = at_bound(problem, position, slope) | ~informed
    for _ in range(4 * problem.size):
        index = (~held).nonzero()[:, 0]
        direction = torch.zeros_like(unknowns)
        if len(index):
            solved = torch.linalg.lstsq(scaled[index][:, index], slope[index][:, None]).solution[:, 0]
            direction[index] = solved * scale[index]
        # As far as the first bound on the way, which that unknown then keeps.
        room = torch.where(direction > 0, problem.upper - position, problem.lower - position)
        share = torch.where(direction != 0, room / direction, math.inf).clamp(min=0)
        reach = float(share.min())
        position = position + min(reach, 1.0) * direction
        position = torch.minimum(torch.maximum(position, problem.lower), problem.upper)
        slope = gradient * scale - scaled @ ((position - unknowns) * root)
        if reach < 1:
            held[int(share.argmin())] = True
            continue
        inward = held & informed & ~at_bound(problem, position, slope)
        if not bool(inward.any()):
            break
        held[int((inward * slope.abs()).argmax())] = False
    return position - unknowns


def seen(problem: Problem, unknowns: Tensor, change: Tensor, length: float) -> bool:
    """Whether the data see where a step leads: it moves no unknown by its whole domain for every standard error.

    One that does goes along a direction in which the model is flat here, and may not be there.
    """
    width = problem.upper - problem.lower
    width = torch.where(torch.isfinite(width), width, 1 + unknowns.abs())
    return bool((change.abs() <= max(length, _ROUNDING_STEP) * width).all())


def minimise(
    problem: Problem,
    start: Tensor,
    evaluate: Evaluate,
    *,
    passes: int,
    tolerance: float,
    first: Statistics | None = None,
) -> Solution:
    """Minimise a sum of squares with fixed weights from `start` (damping after Nielsen 1999).

    Args:
        problem: bounds.
        start: u [P].
        evaluate: a pass over the samples: statistics at u with the same weights every time.
        passes: at most this many.
        tolerance: stop when the next step promises to move u by less than this many standard errors (those of the
            residuals found, which a misfit makes larger than the noise alone would).
        first: the statistics at the start, if a pass has given them already.
    """
    unknowns, statistics = start, evaluate(start) if first is None else first
    damping, growth, share = 1e-6, 2.0, 1.0
    step = _step(problem, unknowns, statistics, damping)
    for iteration in range(1, passes):
        if step.length < (tolerance if growth == 2.0 else min(tolerance, _DAMPED)):
            # The step itself is free: where it leads, the next one would be shorter by its square.
            change = share * step.change
            if not seen(problem, unknowns, step.change, step.length):
                change = torch.zeros_like(unknowns)
            return Solution(problem, unknowns + change, statistics, iteration, step.length, True)
        chi2 = statistics.cost
        promise = share * step.slope - share**2 * step.curvature
        target = unknowns + share * step.change
        tried = evaluate(target)
        drop = chi2 - tried.cost
        if drop > 0:
            # Residuals of a model that does not hold bend χ² more than Gauss-Newton sees; the next step allows for it.
            bend = (share * step.slope - drop) / (share**2 * step.curvature)
            unknowns, statistics = target, tried
            damping, growth, share = damping * max(0.1, 1 - (2 * drop / promise - 1) ** 3), 2.0, 1 / max(bend, 1.0)
        elif promise < _ROUNDING * chi2:
            return Solution(problem, unknowns, statistics, iteration + 1, step.length, step.length < _SHORT)
        else:
            damping, growth, share = max(damping, 1e-3) * growth, growth * 2, 1.0
        step = _step(problem, unknowns, statistics, damping)
    return Solution(problem, unknowns, statistics, passes, step.length, step.length < tolerance)
