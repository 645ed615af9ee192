"""What the images hardly see where a solution stands: absent lobes, unknowns without effect, and bent valleys."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch

from matest.brdf.terms import Factor, Product
from matest.estimators import Solution, accumulate
from matest.estimators.covariance import PARTICIPATES, fisher, quantile95, weak_directions
from matest.inference.error_bars import ErrorBars
from matest.inference.profiles import TWO_SIDED, Surroundings

# An amplitude this many standard errors above zero is seen: with a width free to be searched for, and several channels,
# noise alone often looks like two or three.
_VISIBLE = 4.0
# Of an unknown that the images say nothing of where it stands other values are tried, this share of its domain away.
# What has to move by so many standard errors with it, for χ² to stay within its 95 % range, is no better known.
_PLACES, _LOCKED = (0.05, 0.15, 0.45), 3.0
# A valley bends if χ² at the ends of its 95 % range is off by this factor; an end is not looked at where the domain
# leaves less than this share of the way to it. Standard errors of this share of a domain are looked at too.
_BENDS, _ROOM, _WIDE = 2.0, 0.25, 0.05


def faint(solution: Solution, bars: ErrorBars, name: str) -> bool:
    """Whether a shape parameter belongs to lobes that are not there."""
    problem = solution.problem
    if name not in problem.shapes:
        return False
    values = problem.values(solution.unknowns)
    information = solution.statistics.information / solution.statistics.inflation
    # How much wider honest error bars are than those of the noise alone.
    wider = (bars.open.std / fisher(information, torch.ones(problem.size, dtype=torch.bool)).std).nan_to_num(1.0)

    def seen(factor: Factor, product: Product) -> bool:
        """Whether a factor differs from zero in any channel, the other factors of its product and all shapes given."""
        value = factor.value(values).reshape(-1)
        source = problem.ties.get(factor.name, factor.name)
        if source in problem.gauges or source not in problem.where:
            return source in problem.gauges or bool((value != 0).any())
        others = {problem.ties.get(other.name, other.name) for other in product} - {source}
        beside = torch.zeros(problem.size, dtype=torch.bool)
        for name in {*problem.amplitudes} - others:
            beside[problem.where[name]] = True
        std = (fisher(information, beside).std * wider)[problem.where[source]]
        return bool((value > _VISIBLE * std).any())

    # A lobe is a product: it is gone when any one of its factors is.
    products = problem.brdf.structure.carriers(name)
    return not any(all(seen(factor, product) for factor in product) for product in products)


def unseen_amplitudes(solution: Solution, bars: ErrorBars) -> set[str]:
    """Amplitudes of lobes that are not there for all that the images tell."""
    problem = solution.problem
    factors = {
        problem.ties.get(factor.name, factor.name)
        for shape in problem.shapes
        if faint(solution, bars, shape)
        for product in problem.brdf.structure.carriers(shape)
        for factor in product
    }
    return factors & {*problem.amplitudes}


def locked_with_unseen(solution: Solution, bars: ErrorBars, around: Callable[[], Surroundings]) -> frozenset[int]:
    """Positions of unknowns whose error bars hold only for the value of one without effect there, to first order.

    Of such a one the images say nothing where it stands: of a conductor's k at 0, and n looks well known beside it.

    Args:
        solution: the optimum.
        bars: its error bars.
        around: gives the likelihood about it.
    """
    problem, statistics = solution.problem, solution.statistics
    width, std = problem.upper - problem.lower, bars.covariance.std
    blind = (statistics.information.diagonal() / statistics.inflation * width.square() < 1) & torch.isfinite(width)
    names = {place.start + step: name for name, place in problem.where.items() for step in range(problem.count(name))}
    found: set[int] = set()
    for position in blind.nonzero()[:, 0].tolist():
        if faint(solution, bars, names[position]):
            continue
        value, low, high = (float(of[position]) for of in (solution.unknowns, problem.lower, problem.upper))
        end = high if high - value > value - low else low
        for place in (value + share * (end - value) for share in _PLACES):
            there = around().at(position, place)
            if there.cost < TWO_SIDED:
                change = (there.refit.unknowns - solution.unknowns).abs()
                found |= {*((change > _LOCKED * std) & (std > 0)).nonzero()[:, 0].tolist()} - {position}
    return frozenset(found)


def bent(solution: Solution, around: Callable[[], Surroundings]) -> frozenset[int]:
    """Positions of unknowns whose error bars, correct to first order, are wrong: a valley bends within them.

    A metal's n and k are such: along a curve all give the same reflectance but for its rise towards grazing angles.

    Args:
        solution: the optimum.
        around: gives the likelihood about it.
    """
    problem, unit = solution.problem, solution.statistics.inflation
    information, gradient = solution.statistics.information / unit, solution.statistics.gradient / unit
    covariance, width = fisher(information, torch.ones(problem.size, dtype=torch.bool)), problem.upper - problem.lower
    valleys = [*weak_directions(information)]
    for position in ((covariance.std > _WIDE * width) & torch.isfinite(width)).nonzero()[:, 0].tolist():
        valleys.append(torch.eye(problem.size, dtype=torch.float64)[position])
    found: set[int] = set()
    for valley in valleys:
        position = int(valley.argmax())
        value, std = float(solution.unknowns[position]), float(covariance.std[position])
        reach, pull = quantile95(math.inf) * std, float(covariance.matrix[position] @ gradient)
        for aim in (value - reach, value + reach):
            place = min(max(aim, float(problem.lower[position])), float(problem.upper[position]))
            # A bound is nearer than what error bars say: that is another matter.
            step = place - value
            if abs(step) < _ROOM * reach or std == 0:
                continue
            # At a bound the data pull an unknown outward.
            expected = step * (step - 2 * pull) / std**2
            if not expected / _BENDS < around().at(position, place).cost < expected * _BENDS:
                found |= {*(valley > PARTICIPATES).nonzero()[:, 0].tolist()}
                break
    return frozenset(found)


def flat_at_bound(solution: Solution) -> dict[int, float]:
    """95 % reach inside the domain of unknowns near a lower bound where the model does not change to first order.

    Oren-Nayar depends on σ²: at σ = 0 the information on σ is zero although σ² is well known. Information on s = σ² is
    that on σ at a small ε divided by 4ε², so that σ < √(1.96 std(s)) with std(s) = 2ε std(σ at ε).
    """
    problem = solution.problem
    reach = {}
    for name in problem.shapes:
        domain, place = problem.domain(name), problem.where[name]
        epsilon = 0.02 * domain.width
        if (
            problem.declared(name).log
            or problem.declared(name).periodic
            or float(solution.unknowns[place].max()) > epsilon
        ):
            continue
        moved = solution.unknowns.clone()
        moved[place] = domain.lower + epsilon
        statistics = accumulate(problem, moved, solution.tiles, solution.unknowns, solution.residual_scale)
        covariance = fisher(
            statistics.information / solution.statistics.inflation, torch.ones(problem.size, dtype=torch.bool)
        )
        for position in range(place.start, place.stop):
            square = (float(solution.unknowns[position]) - domain.lower) ** 2
            spread = quantile95(math.inf) * 2 * epsilon * float(covariance.std[position])
            # Zero lies inside the interval: the parameter sits at its bound for all that these images tell.
            if square < spread and not bool(covariance.undetermined[position]):
                reach[position] = math.sqrt(square + spread)
    return reach


def widening(solution: Solution, bars: ErrorBars) -> float:
    """How much wider honest error bars are than those of the noise alone: the largest factor."""
    problem = solution.problem
    everything = torch.ones(problem.size, dtype=torch.bool)
    plain = fisher(solution.statistics.information / solution.statistics.inflation, everything).std
    return float((bars.open.std / plain).nan_to_num(1.0, posinf=1.0).clamp(min=1.0).max())
