"""Valleys of χ² that a covariance says nothing true of: bent ones, locked ones, and bounds where χ² is flat."""

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

# Of an unknown without effect other values are tried, these shares of its domain away.
_PLACES = (0.05, 0.15, 0.45)
# What has to move by so many standard errors with it, for χ² to stay within its 95 % range, is no better known.
_LOCKED = 3.0
# A valley bends if χ² at the ends of its 95 % range is off by this factor.
_BENDS = 2.0
# Such an end is not looked at where the domain leaves less than this share of the way to it.
_ROOM = 0.25
# Along an unknown whose standard error is this share of its domain χ² is looked at too.
_WIDE = 0.05
# χ² may be flat at a lower bound of a parameter that lies within this share of its domain.
_NEAR_BOUND = 0.02

Around = Callable[[], Surroundings]


@dataclass(frozen=True)
class Valleys:
    """Unknowns, by position in u, of which standard errors say nothing true.

    Attributes:
        flat: at a lower bound where the model is flat in them to first order: about how far inside the domain the truth
            may lie.
        bent: along a valley that bends within their standard errors.
        locked: moving with one that the samples say nothing of where it stands.
    """

    flat: Mapping[int, float] = field(default_factory=dict)
    bent: frozenset[int] = frozenset()
    locked: frozenset[int] = frozenset()


def valleys(solution: Solution, bars: ErrorBars, lobes: LobesNotSeen, around: Around) -> Valleys:
    """The valleys about a solution; `around` gives the likelihood there."""
    expansion, flat = Expansion.of(solution), flat_at_bound(solution)
    return Valleys(
        flat=flat,
        bent=bent_valleys(expansion, around),
        locked=locked_unknowns(expansion, bars, lobes, around, flat),
    )


def flat_at_bound(solution: Solution) -> dict[int, float]:
    """95 % reach inside the domain of unknowns near a lower bound where the model does not change to first order.

    Oren-Nayar depends on σ²: at σ = 0 the information on σ is zero although σ² is well known. Information on s = σ² is
    that on σ at a small ε divided by 4ε², so that σ < √(1.96 std(s)) with std(s) = 2ε std(σ at ε).
    """
    problem = solution.problem
    reach = {}
    for name in problem.shapes:
        domain, declared, place = problem.domain(name), problem.declared(name), problem.where[name]
        epsilon = _NEAR_BOUND * domain.width
        if declared.log or declared.periodic or float(solution.unknowns[place].max()) > epsilon:
            continue
        moved = solution.unknowns.clone()
        moved[place] = domain.lower + epsilon
        statistics = accumulate(problem, moved, solution.tiles, solution.unknowns, solution.residual_scale)
        covariance = Expansion.about(problem, moved, statistics, solution.statistics.inflation).covariance
        for position in range(place.start, place.stop):
            square = (float(solution.unknowns[position]) - domain.lower) ** 2
            spread = quantile95(math.inf) * 2 * epsilon * float(covariance.std[position])
            # Zero lies inside the interval: the parameter sits at its bound for all that these samples tell.
            if square < spread and not bool(covariance.undetermined[position]):
                reach[position] = math.sqrt(square + spread)
    return reach


def bent_valleys(expansion: Expansion, around: Around) -> frozenset[int]:
    """Positions of unknowns whose error bars, correct to first order, are wrong: a valley bends within them.

    A metal's n and k are such: along a curve all give the same reflectance but for its rise towards grazing angles.
    """
    problem, covariance = expansion.problem, expansion.covariance
    width = problem.upper - problem.lower
    directions = [*weak_directions(expansion.precision)]
    wide = (covariance.std > _WIDE * width) & torch.isfinite(width) & ~expansion.gauges
    for position in wide.nonzero()[:, 0].tolist():
        directions.append(torch.eye(problem.size, dtype=torch.float64)[position])
    bent: set[int] = set()
    for direction in directions:
        # Of a gauge the domain says more than χ².
        position = int((direction * ~expansion.gauges).argmax())
        value, std = float(expansion.unknowns[position]), float(covariance.std[position])
        reach, pull = quantile95(math.inf) * std, float(covariance.matrix[position] @ expansion.gradient)
        for aim in (value - reach, value + reach):
            place = min(max(aim, float(problem.lower[position])), float(problem.upper[position]))
            # A bound is nearer than what error bars say: that is another matter.
            step = place - value
            if abs(step) < _ROOM * reach or std == 0:
                continue
            # At a bound the data pull an unknown outward.
            expected = step * (step - 2 * pull) / std**2
            if not expected / _BENDS < around().at(position, place).cost < expected * _BENDS:
                bent |= {*(direction > PARTICIPATES).nonzero()[:, 0].tolist()}
                break
    return frozenset(bent)


def locked_unknowns(
    expansion: Expansion,
    bars: ErrorBars,
    lobes: LobesNotSeen,
    around: Around,
    flat: Collection[int] = (),
) -> frozenset[int]:
    """Positions of unknowns whose error bars hold only for the value of one without effect there, to first order.

    Of such a one the samples say nothing where it stands: of a conductor's k at 0, and n looks well known beside it.
    One at a `flat` bound has an interval by its profile, which is wide enough for the others too; what a gauge may do
    is part of all error bars.
    """
    problem = expansion.problem
    width, std = problem.upper - problem.lower, bars.covariance.std
    blind = (expansion.information.diagonal() * width.square() < 1) & torch.isfinite(width)
    blind &= ~expansion.gauges
    blind[[*flat]] = False
    for name in lobes.shapes:
        blind[problem.where[name]] = False
    locked: set[int] = set()
    for position in blind.nonzero()[:, 0].tolist():
        value, low, high = (float(of[position]) for of in (expansion.unknowns, problem.lower, problem.upper))
        end = high if high - value > value - low else low
        for place in (value + share * (end - value) for share in _PLACES):
            there = around().at(position, place)
            if there.cost < TWO_SIDED:
                change = (there.refit.unknowns - expansion.unknowns).abs()
                locked |= {*((change > _LOCKED * std) & (std > 0)).nonzero()[:, 0].tolist()} - {position}
    return frozenset(locked)
