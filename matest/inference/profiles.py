"""Intervals of unknowns near a bound or in a bent valley: by the profile of the likelihood, all others refitted."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from torch import Tensor

from matest.estimators import Problem, Solution
from matest.estimators.levenberg_marquardt import bounded_step, minimise
from matest.estimators.passes import Evaluate, passes_over
from matest.samples import Tiles

# χ² that a value may cost inside a 95 % interval: away from every bound, and at a bound that no estimate can pass.
TWO_SIDED, _ONE_SIDED = 3.841458820694124, 2.705543454095414
# Passes to refit the others, along a bent valley, until they move by less than so many standard errors.
_PASSES, _SETTLED = 12, 0.2
# Values tried for an end of an interval, until their cost is within this share of the one that is looked for.
_TRIALS, _CLOSE = 16, 0.1
# The cost rises with the distance to a power between these; one trial moves the end by no more than this factor.
_POWERS, _STRIDE = (1.0, 8.0), 5.0
# Beyond a bend it is a wall: between a value that costs too little and one that costs too much no trial comes nearer to
# either than this share, until that is so small a share of the interval.
_MARGIN, _NARROW = 0.25, 0.08
# A bound further than so many guesses of the half-width does not cut an interval.
_FAR = 2.0


@dataclass(frozen=True)
class Rise:
    """Profile of χ² at one value of an unknown.

    Attributes:
        value: of the unknown.
        cost: χ² above its minimum, the other unknowns refitted.
        slope: its derivative by the value.
        refit: the other unknowns there.
    """

    value: float
    cost: float
    slope: float
    refit: Solution


@dataclass(frozen=True)
class Surroundings:
    """The likelihood about a solution, expanded there.

    Attributes:
        best: its optimum.
        evaluate: statistics at any unknowns.
        share: of all samples that these are of.
    """

    best: Solution
    evaluate: Evaluate
    share: float = 1.0

    def at(self, position: int, value: float, near: Solution | None = None) -> Rise:
        """Refit all unknowns but one, starting from a refit near it; None: from the optimum. Costs allow for misfit."""
        near = near or self.best
        pinned = replace(near.problem, pinned={position: value})
        information, gradient = near.statistics.information, near.statistics.gradient
        start = near.unknowns.clone()
        start[position] = value
        # Where the quadratic model expects them.
        start = start + bounded_step(pinned, start, information, gradient - information @ (start - near.unknowns))
        found = minimise(pinned, start, self.evaluate, passes=_PASSES, tolerance=_SETTLED)
        unit = self.best.statistics.inflation * self.share
        slope = -2 * float(found.statistics.gradient[position]) / unit
        return Rise(value, (_lowest(found) - _lowest(self.best)) / unit, slope, found)


def surroundings(
    problem: Problem, unknowns: Tensor, tiles: Tiles, residual_scale: float = 1.0, share: float = 1.0
) -> Surroundings:
    """Expand the likelihood about an optimum.

    Args:
        problem: what is estimated.
        unknowns: u [P] there.
        tiles: samples.
        residual_scale: see `likelihood.about`.
        share: of all samples that these are of.
    """
    evaluate = passes_over(problem, tiles, unknowns, unknowns, residual_scale)
    best = minimise(problem, unknowns, evaluate, passes=_PASSES, tolerance=_SETTLED)
    return Surroundings(best, evaluate, share)


@dataclass(frozen=True)
class Profile:
    """The likelihood along one unknown.

    Attributes:
        around: the likelihood about the optimum, from which values are tried.
        position: of the unknown in u.
        wider: how many times wider than by the noise and the misfit alone error bars are.
        flat: whether the model depends on the square of the distance to the bound that is near.
    """

    around: Surroundings
    position: int
    wider: float
    flat: bool

    def at(self, value: float, near: Solution | None = None) -> Rise:
        """The rise to `value`, in units of the error bars."""
        rise = self.around.at(self.position, value, near)
        return replace(rise, cost=rise.cost / self.wider**2, slope=rise.slope / self.wider**2)

    def interval(self, spread: float) -> tuple[float, float, list[Tensor]]:
        """Both ends of the 95 % interval, and unknowns u [P] inside; `spread` is a guess of its half-width."""
        best = self.around.best
        start = float(best.unknowns[self.position])
        ends = [float(best.problem.lower[self.position]), float(best.problem.upper[self.position])]
        bound, other = sorted(ends, key=lambda end: abs(end - start))
        inward = 1.0 if other > bound else -1.0
        first, back = start + inward * spread, start - inward * spread
        inside: list[Tensor] = []
        if abs(start - bound) < 1e-6 * spread:
            near, far = bound, self._end(start, first, other, None, inside)
        elif abs(start - bound) > _FAR * spread:
            near, far = (self._end(start, *towards, TWO_SIDED, inside) for towards in ((back, bound), (first, other)))
        else:
            at_bound = self.at(bound)
            pulls = math.sqrt(max(at_bound.cost, 0.0))
            near, far = bound, self._end(start, first, other, TWO_SIDED, inside)
            if at_bound.cost > _ONE_SIDED:
                back = inward * max(inward * back, inward * bound)
                near = self._end(start, back, bound, lower_threshold(pulls), inside)
        return min(near, far), max(near, far), inside

    def _end(self, start: float, first: float, limit: float, threshold: float | None, passed: list[Tensor]) -> float:
        """The value between `start` and `limit` at which χ² has risen by `threshold`; None: as for one at its bound.

        Refits on the way there that have risen by less go to `passed`.
        """
        low, high = min(start, limit), max(start, limit)
        value = min(max(first, low), high)
        inside, outside, near = start, math.inf, self.around.best
        for trial in range(_TRIALS):
            rise = self.at(value, near)
            gain = rise.slope * (value - start)
            wanted = upper_threshold(self._push(rise.cost, gain)) if threshold is None else threshold
            if rise.cost > wanted:
                outside = value
            else:
                inside, near = value, rise.refit
                passed.append(near.unknowns)
                if value == limit:
                    return limit
            # χ² = a · distance^power with the value and the slope found here.
            power = min(max(gain / rise.cost, _POWERS[0]), _POWERS[1]) if rise.cost > 0 else _POWERS[1]
            factor = (wanted / max(rise.cost, 1e-12)) ** (1 / power)
            if trial > 1 and math.isinf(outside):
                factor = max(factor, 2.0)  # the slope of a refit that is not quite settled may be far off
            value = start + (value - start) * min(max(factor, 1 / _STRIDE), _STRIDE)
            if abs(rise.cost / wanted - 1) < _CLOSE:
                break
            if math.isfinite(outside):
                margin = _MARGIN * (outside - inside)
                ends = sorted((inside + margin, outside - margin))
                value = min(max(value, ends[0]), ends[1])
                if abs(margin) < _NARROW * abs(outside - start):
                    break
            value = min(max(value, low), high)
        return min(max(value, low), high)

    def _push(self, cost: float, gain: float) -> float:
        """By how many standard errors the data push an estimate at its bound outward, from the profile at one value.

        In a coordinate q in which χ² is quadratic, q in standard errors, cost = q² + 2 q push and gain = q dχ²/dq.
        """
        gain = gain / 2 if self.flat else gain
        distance = math.sqrt(max(gain - cost, 1e-12))
        return max((cost - distance**2) / (2 * distance), 0.0)


def _lowest(found: Solution) -> float:
    """Cost where the last step leads."""
    cost = found.statistics.cost
    return cost - found.last_step**2 * found.statistics.inflation if found.converged else cost


def lower_threshold(estimate: float) -> float:
    """Rise of χ² at the lower end of a 95 % interval, for an estimate so many standard errors above its bound."""
    end = _root(lambda truth: (estimate - truth) ** 2 - threshold(truth), estimate, 0.0)
    return (estimate - end) ** 2


def upper_threshold(push: float) -> float:
    """Rise of χ² at the upper end, for an estimate at its bound that the data push outward by so many standard errors.

    The unified intervals of Feldman & Cousins (1998), which hold the truth 19 times in 20 at every distance from the
    bound: without a push 3.84, with a strong one 2.71.
    """
    end = _root(lambda truth: truth**2 + 2 * push * truth - threshold(truth), 0.0, 2.0)
    return end**2 + 2 * push * end


def threshold(truth: float) -> float:
    """The likelihood ratio χ² that 1 estimate in 20 exceeds, of a truth so many standard errors inside its bound.

    The estimate x is normal about the truth t; χ² is (x − t)² where x is inside, and t² − 2 x t, the rise from the
    bound, where it is not.
    """
    if truth >= math.sqrt(TWO_SIDED):
        return TWO_SIDED

    def excess(critical: float) -> float:
        below = (truth**2 + critical) / (2 * truth) if truth > 0 else math.inf
        return _normal(math.sqrt(critical)) - _normal(-max(below, math.sqrt(critical))) - 0.95

    return _root(excess, _ONE_SIDED, TWO_SIDED)


def _normal(x: float) -> float:
    return 0.5 * math.erfc(-x / math.sqrt(2))


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Zero of a function that is negative at `low` and positive at `high`, by bisection."""
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if function(middle) < 0 else (low, middle)
    return (low + high) / 2
