"""Profiles of the likelihood: χ² at given values of one unknown, all others refitted, and the intervals from that."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from torch import Tensor

from matest.estimators import Problem, Solution
from matest.estimators.levenberg_marquardt import bounded_step, minimise
from matest.estimators.passes import Evaluate, passes_over
from matest.samples import Tiles
from matest.samples.residual_scale import NOISE_ALONE, ResidualScale

# Rise of χ² at the ends of a 95 % interval, away from every bound: the 95 % quantile of χ² with one degree of freedom.
TWO_SIDED = 3.841458820694124
# The same at a bound that no estimate can pass: the 90 % quantile.
_ONE_SIDED = 2.705543454095414
# Passes of one refit of the other unknowns: along a bent valley they move far.
_REFIT_PASSES = 12
# Standard errors. A refit ends when its steps are shorter, which is exact enough for the ends of an interval.
_REFIT_TOLERANCE = 0.2
# Values tried for one end of an interval, each of which costs a refit.
_MAX_TRIALS = 16
# Share of the wanted rise of χ² within which the trials end: where χ² is quadratic, the end is right to a twentieth.
_RISE_TOLERANCE = 0.1
# Range of the exponent p in χ² ∝ distanceᵖ; slopes that give another one are wrong.
_MIN_POWER = 1.0
_MAX_POWER = 8.0
# Largest factor by which one trial moves the end away from the optimum, or back.
_MAX_STRIDE = 5.0
# Fraction of the bracket that trials keep away from its ends, because χ² can rise steeply beyond a bend.
_BRACKET_MARGIN = 0.25
# Fraction of the distance to the optimum. The trials end when that margin is smaller.
_NARROW_MARGIN = 0.08
# Multiple of the guessed half-width. A bound further away does not cut an interval.
_FAR_BOUND = 2.0


@dataclass(frozen=True)
class Rise:
    """Profile of χ² at one value of an unknown.

    Attributes:
        value: of the unknown.
        cost: χ² above its minimum, the other unknowns refitted.
        slope: derivative of the cost by the value.
        refit: all unknowns at that value.
    """

    value: float
    cost: float
    slope: float
    refit: Solution


@dataclass(frozen=True)
class Surroundings:
    """The likelihood about an optimum.

    Attributes:
        best: the optimum.
        evaluate: gives the statistics at any unknowns.
        share: share of all samples that the statistics are of.
    """

    best: Solution
    evaluate: Evaluate
    share: float = 1.0

    def at(self, position: int, value: float, near: Solution | None = None) -> Rise:
        """Refit all unknowns but one, beginning at the refit `near`; None: at the optimum.

        Costs are in units of the variance of the residuals.
        """
        near = near or self.best
        pinned = replace(near.problem, pinned={position: value})
        information, gradient = near.statistics.information, near.statistics.gradient
        start = near.unknowns.clone()
        start[position] = value
        # Begin where the quadratic model has the optimum of the others.
        start = start + bounded_step(pinned, start, information, gradient - information @ (start - near.unknowns))
        refit = minimise(pinned, start, self.evaluate, passes=_REFIT_PASSES, tolerance=_REFIT_TOLERANCE)
        unit = self.best.statistics.inflation * self.share
        slope = -2 * float(refit.statistics.gradient[position]) / unit
        return Rise(value, (_lowest_cost(refit) - _lowest_cost(self.best)) / unit, slope, refit)


def surroundings(
    problem: Problem, unknowns: Tensor, tiles: Tiles, residual_scale: ResidualScale = NOISE_ALONE, share: float = 1.0
) -> Surroundings:
    """Expand the likelihood about an optimum.

    Args:
        problem: names what is estimated.
        unknowns: the optimum u [P].
        tiles: of the samples.
        residual_scale: by which outliers are judged.
        share: share of all samples that the tiles hold.
    """
    evaluate = passes_over(problem, tiles, unknowns, unknowns, residual_scale)
    best = minimise(problem, unknowns, evaluate, passes=_REFIT_PASSES, tolerance=_REFIT_TOLERANCE)
    return Surroundings(best, evaluate, share)


@dataclass(frozen=True)
class Profile:
    """The likelihood along one unknown.

    Attributes:
        around: the likelihood about the optimum.
        position: of the unknown in u.
        wider: width of the error bars relative to those by noise and misfit alone.
        flat: whether the model depends on the square of the distance to the nearest bound.
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
        optimum = float(best.unknowns[self.position])
        domain = [float(best.problem.lower[self.position]), float(best.problem.upper[self.position])]
        near_bound, far_bound = sorted(domain, key=lambda bound: abs(bound - optimum))
        inward = 1.0 if far_bound > near_bound else -1.0
        inner, outer = optimum + inward * spread, optimum - inward * spread
        region: list[Tensor] = []
        if abs(optimum - near_bound) < 1e-6 * spread:
            near, far = near_bound, self._end(inner, far_bound, None, region)
        elif abs(optimum - near_bound) > _FAR_BOUND * spread:
            near = self._end(outer, near_bound, TWO_SIDED, region)
            far = self._end(inner, far_bound, TWO_SIDED, region)
        else:
            at_bound = self.at(near_bound)
            distance = math.sqrt(max(at_bound.cost, 0.0))
            near, far = near_bound, self._end(inner, far_bound, TWO_SIDED, region)
            if at_bound.cost > _ONE_SIDED:
                outer = inward * max(inward * outer, inward * near_bound)
                near = self._end(outer, near_bound, lower_threshold(distance), region)
        return min(near, far), max(near, far), region

    def _end(self, guess: float, limit: float, threshold: float | None, region: list[Tensor]) -> float:
        """The end of an interval: the value between optimum and limit at which χ² has risen by a threshold.

        Args:
            guess: of the end.
            limit: the bound on that side.
            threshold: rise of χ²; None: that of an estimate at its bound, which follows from the profile.
            region: takes the refitted unknowns at values inside the interval.
        """
        start = float(self.around.best.unknowns[self.position])
        low, high = min(start, limit), max(start, limit)
        value = min(max(guess, low), high)
        inside, outside, near = start, math.inf, self.around.best
        for trial in range(_MAX_TRIALS):
            rise = self.at(value, near)
            gain = rise.slope * (value - start)
            target = upper_threshold(self._push(rise.cost, gain)) if threshold is None else threshold
            if rise.cost > target:
                outside = value
            else:
                inside, near = value, rise.refit
                region.append(near.unknowns)
                if value == limit:
                    return limit
            factor = _stride(rise.cost, gain, target)
            if trial > 1 and math.isinf(outside):
                # The slope of a refit that has not converged may be far off.
                factor = max(factor, 2.0)
            value = start + (value - start) * min(max(factor, 1 / _MAX_STRIDE), _MAX_STRIDE)
            if abs(rise.cost / target - 1) < _RISE_TOLERANCE:
                break
            if math.isfinite(outside):
                margin = _BRACKET_MARGIN * (outside - inside)
                ends = sorted((inside + margin, outside - margin))
                value = min(max(value, ends[0]), ends[1])
                if abs(margin) < _NARROW_MARGIN * abs(outside - start):
                    break
            value = min(max(value, low), high)
        return min(max(value, low), high)

    def _push(self, cost: float, gain: float) -> float:
        """The push of the data outward on an estimate at its bound, in standard errors, from the profile at one value.

        In a coordinate q in which χ² is quadratic, q in standard errors, cost = q² + 2 q push and gain = q dχ²/dq.
        """
        gain = gain / 2 if self.flat else gain
        distance = math.sqrt(max(gain - cost, 1e-12))
        return max((cost - distance**2) / (2 * distance), 0.0)


def _stride(cost: float, gain: float, target: float) -> float:
    """Factor on the distance from the optimum that takes the cost to the target.

    χ² = a · distance^power, with the cost and the gain = distance · dχ²/d(distance) at one value.
    """
    power = min(max(gain / cost, _MIN_POWER), _MAX_POWER) if cost > 0 else _MAX_POWER
    return (target / max(cost, 1e-12)) ** (1 / power)


def _lowest_cost(solution: Solution) -> float:
    """The cost that the last step of a solution leads to."""
    cost = solution.statistics.cost
    return cost - solution.last_step**2 * solution.statistics.inflation if solution.converged else cost


def lower_threshold(estimate: float) -> float:
    """Rise of χ² at the lower end of a 95 % interval, for an estimate `estimate` standard errors above its bound."""
    end = _root(lambda truth: (estimate - truth) ** 2 - threshold(truth), estimate, 0.0)
    return (estimate - end) ** 2


def upper_threshold(push: float) -> float:
    """Rise of χ² at the upper end, for an estimate at its bound that the data push outward by `push` standard errors.

    These are the unified intervals of Feldman & Cousins (1998), which hold the truth 19 times in 20 at every distance
    from the bound. The rise is 3.84 without a push and 2.71 with a strong one.
    """
    end = _root(lambda truth: truth**2 + 2 * push * truth - threshold(truth), 0.0, 2.0)
    return end**2 + 2 * push * end


def threshold(truth: float) -> float:
    """The likelihood ratio χ² that 1 estimate in 20 exceeds, for a truth `truth` standard errors inside its bound.

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
    """Root of a function that is negative at `low` and positive at `high`, by bisection."""
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if function(middle) < 0 else (low, middle)
    return (low + high) / 2
