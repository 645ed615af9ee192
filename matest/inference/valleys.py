"""Where χ² is far from quadratic: along bent valleys, beside unknowns without effect, and at some bounds."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

import torch

from matest.estimators import Solution, accumulate
from matest.estimators.covariance import PARTICIPATES, quantile95, weak_directions
from matest.inference.error_bars import ErrorBars
from matest.inference.expansion import Expansion
from matest.inference.lobes import LobesNotSeen
from matest.inference.profiles import TWO_SIDED, Surroundings

# Values tried for an unknown without effect, as shares of the way to the far end of its domain: near, middle, far.
_TRIAL_SHARES = (0.05, 0.15, 0.45)
# Standard errors that an unknown may move with another one inside the 95 % range of χ²: beyond, its error bar is wrong.
_LOCKED_SHIFT = 3.0
# A valley bends if χ² at the ends of its 95 % range differs from the quadratic model by this factor.
_BENT_FACTOR = 2.0
# Share of the way to such an end that the domain leaves. With less, the valley does not count as bent there.
_MIN_ROOM = 0.25
# Share of its domain. Along an unknown with a larger standard error χ² is tried too.
_WIDE_ERROR = 0.05
# Share of its domain within which a parameter is near its lower bound.
_NEAR_BOUND = 0.02

Around = Callable[[], Surroundings]


@dataclass(frozen=True)
class Valleys:
    """Unknowns, by position in u, whose standard errors are wrong.

    Attributes:
        flat: unknowns at a lower bound where χ² is flat in them to first order, each with the 95 % reach of the truth
            inside the domain.
        bent: unknowns along a valley that bends within their standard errors.
        locked: unknowns that move with one that has no effect at its present value.
    """

    flat: Mapping[int, float] = field(default_factory=dict)
    bent: frozenset[int] = frozenset()
    locked: frozenset[int] = frozenset()


def valleys_about(solution: Solution, bars: ErrorBars, lobes: LobesNotSeen, around: Around) -> Valleys:
    """The valleys about a solution; `around` gives the likelihood about it."""
    expansion, flat = Expansion.of(solution), flat_at_bound(solution)
    locked = locked_unknowns(expansion, bars, lobes, around, flat)
    return Valleys(flat, bent_valleys(expansion, around), locked)


def flat_at_bound(solution: Solution) -> dict[int, float]:
    """95 % reach inside the domain of unknowns near a lower bound where the model does not change to first order.

    Oren-Nayar depends on σ²: at σ = 0 the information on σ is zero although that on σ² is not. Information on s = σ² is
    that on σ at a small ε divided by 4ε², so that σ < √(1.96 std(s)) with std(s) = 2ε std(σ at ε).
    """
    problem = solution.problem
    reach = {}
    for name in problem.shapes:
        domain, declared, place = problem.domain(name), problem.declared(name), problem.where[name]
        epsilon = _NEAR_BOUND * domain.width
        if declared.log or declared.periodic or float(solution.unknowns[place].max()) > epsilon:
            continue
        inside = solution.unknowns.clone()
        inside[place] = domain.lower + epsilon
        statistics = accumulate(problem, inside, solution.tiles, solution.unknowns, solution.residual_scale)
        covariance = Expansion.about(problem, inside, statistics, solution.statistics.inflation).covariance
        for position in range(place.start, place.stop):
            square = (float(solution.unknowns[position]) - domain.lower) ** 2
            spread = quantile95(math.inf) * 2 * epsilon * float(covariance.std[position])
            # The interval contains the bound: these samples do not tell the parameter from it.
            if square < spread and not bool(covariance.undetermined[position]):
                reach[position] = math.sqrt(square + spread)
    return reach


def bent_valleys(expansion: Expansion, around: Around) -> frozenset[int]:
    """Positions of unknowns along a valley of χ² that bends within their error bars.

    A metal's n and k are an example: along a curve they give the same reflectance, except for its rise towards grazing.
    """
    problem, covariance = expansion.problem, expansion.covariance
    width = problem.upper - problem.lower
    directions = [*weak_directions(expansion.precision)]
    wide = (covariance.std > _WIDE_ERROR * width) & torch.isfinite(width) & ~expansion.gauges
    for position in wide.nonzero()[:, 0].tolist():
        directions.append(torch.eye(problem.size, dtype=torch.float64)[position])
    bent: set[int] = set()
    for direction in directions:
        if bool((direction > PARTICIPATES)[expansion.gauges].any()):
            # The valley ends where the domain of the gauge does: error bars allow for that.
            continue
        position = int(direction.argmax())
        value, std = float(expansion.unknowns[position]), float(covariance.std[position])
        reach, pull = quantile95(math.inf) * std, float(covariance.matrix[position] @ expansion.gradient)
        for end in (value - reach, value + reach):
            trial = min(max(end, float(problem.lower[position])), float(problem.upper[position]))
            # Such a near bound cuts the interval, which `profile_intervals` handles.
            step = trial - value
            if abs(step) < _MIN_ROOM * reach or std == 0:
                continue
            # At a bound the data pull an unknown outward.
            expected = step * (step - 2 * pull) / std**2
            if not expected / _BENT_FACTOR < around().at(position, trial).cost < expected * _BENT_FACTOR:
                bent |= {*(direction > PARTICIPATES).nonzero()[:, 0].tolist()}
                break
    return frozenset(bent)


def locked_unknowns(
    expansion: Expansion, bars: ErrorBars, lobes: LobesNotSeen, around: Around, flat: Collection[int] = ()
) -> frozenset[int]:
    """Positions of unknowns whose error bars are right only for the present value of another unknown.

    To first order the other one has no effect at its present value: a conductor's k at 0, beside which the error bar
    of n looks small. Unknowns at a `flat` bound lock nothing because their profiles widen the intervals of the others,
    gauges because all error bars allow for their domains.
    """
    problem = expansion.problem
    width, std = problem.upper - problem.lower, bars.covariance.std
    without_effect = (expansion.information.diagonal() * width.square() < 1) & torch.isfinite(width)
    without_effect &= ~expansion.gauges
    without_effect[[*flat]] = False
    for name in lobes.shapes:
        without_effect[problem.where[name]] = False
    locked: set[int] = set()
    for position in without_effect.nonzero()[:, 0].tolist():
        value, low, high = (float(of[position]) for of in (expansion.unknowns, problem.lower, problem.upper))
        end = high if high - value > value - low else low
        for trial in (value + share * (end - value) for share in _TRIAL_SHARES):
            rise = around().at(position, trial)
            if rise.cost < TWO_SIDED:
                change = (rise.refit.unknowns - expansion.unknowns).abs()
                locked |= {*((change > _LOCKED_SHIFT * std) & (std > 0)).nonzero()[:, 0].tolist()} - {position}
    return frozenset(locked)
