"""What the images hardly see where a solution stands: absent lobes, unknowns without effect, and bent valleys."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import torch
from torch import Tensor

from matest.brdf.base import factor_value, named_by
from matest.error_bars import ErrorBars
from matest.estimators import Problem, Solution, accumulate
from matest.estimators.levenberg_marquardt import minimise
from matest.uncertainty import fisher, quantile95, weak_directions

# An amplitude this many standard errors above zero is seen: with a width free to be searched for, and several channels,
# noise alone often looks like two or three.
_VISIBLE = 4.0
# Of an unknown that the images say nothing of where it stands other values are tried, this share of its domain away.
# What has to move by so many standard errors with it, for χ² to stay within its 95 % range, is no better known.
_PLACES, _LOCKED, _COSTS = (0.05, 0.15, 0.45), 3.0, 3.84
# Passes to refit the others there.
_PASSES, _SETTLED = 12, 0.2
# A valley bends if the information along it changes by this factor within its 95 % range; one that leaves the domain
# within this share of that is not looked at.
_BENDS, _ROOM = 2.0, 0.05


def faint(solution: Solution, bars: ErrorBars, name: str) -> bool:
    """Whether a shape parameter belongs to lobes that are not there."""
    problem = solution.problem
    if name not in problem.shapes:
        return False
    values = problem.values(solution.unknowns)
    information = solution.statistics.information / solution.statistics.misfit
    # How much wider honest error bars are than those of the noise alone.
    wider = (bars.open.std / fisher(information, torch.ones(problem.size, dtype=torch.bool)).std).nan_to_num(1.0)

    def seen(factor: str, product: tuple[str, ...]) -> bool:
        """Whether a factor differs from zero in any channel, the other factors of its product and all shapes given."""
        value = factor_value(factor, values).reshape(-1)
        source = problem.ties.get(named_by(factor), named_by(factor))
        if source in problem.gauges or source not in problem.where:
            return source in problem.gauges or bool((value != 0).any())
        others = {problem.ties.get(named_by(other), named_by(other)) for other in product} - {source}
        beside = torch.zeros(problem.size, dtype=torch.bool)
        for name in {*problem.amplitudes} - others:
            beside[problem.where[name]] = True
        std = (fisher(information, beside).std * wider)[problem.where[source]]
        return bool((value > _VISIBLE * std).any())

    # A lobe is a product: it is gone when any one of its factors is.
    products = problem.brdf.carriers(name)
    return not any(all(seen(factor, product) for factor in product) for product in products)


def unseen_amplitudes(solution: Solution, bars: ErrorBars) -> set[str]:
    """Amplitudes of lobes that are not there for all that the images tell."""
    problem = solution.problem
    factors = {
        problem.ties.get(named_by(factor), named_by(factor))
        for shape in problem.shapes
        if faint(solution, bars, shape)
        for product in problem.brdf.carriers(shape)
        for factor in product
    }
    return factors & {*problem.amplitudes}


def locked_with_unseen(solution: Solution, bars: ErrorBars) -> frozenset[int]:
    """Positions of unknowns whose error bars hold only for the value of one without effect there, to first order.

    Of such a one the images say nothing where it stands, or no more than that it may be at its bound (`bars.flat`): a
    conductor's k is one near 0, and n looks well known beside it.
    """
    problem, best = solution.problem, solution.statistics
    width, std = problem.upper - problem.lower, bars.covariance.std
    blind = (best.information.diagonal() / best.misfit * width.square() < 1) & torch.isfinite(width)
    names = {place.start + step: name for name, place in problem.where.items() for step in range(problem.count(name))}
    found: set[int] = set()
    evaluate = partial(accumulate, problem, tiles=solution.tiles, reference=solution.unknowns, misfit=solution.misfit)
    for position in sorted({*blind.nonzero()[:, 0].tolist(), *bars.flat}):
        if faint(solution, bars, names[position]):
            continue
        value, low, high = (float(of[position]) for of in (solution.unknowns, problem.lower, problem.upper))
        end = high if high - value > value - low else low
        places = [value + share * (end - value) for share in _PLACES]
        if position in bars.flat:
            places = [low + bars.flat[position], *([low] if value > low else [])]
        for place in places:
            moved = solution.unknowns.clone()
            moved[position] = place
            pinned = replace(problem, pinned={position: place})
            there = minimise(pinned, moved, evaluate, passes=_PASSES, tolerance=_SETTLED)
            if there.statistics.total("cost") - best.total("cost") < _COSTS * best.misfit:
                change = (there.unknowns - moved).abs()
                found |= {*((change > _LOCKED * std) & (std > 0)).nonzero()[:, 0].tolist()} - {position}
    return frozenset(found)


def bent(
    problem: Problem, unknowns: Tensor, information: Tensor, elsewhere: Callable[[Tensor], Tensor]
) -> frozenset[int]:
    """Positions of unknowns whose error bars, correct to first order, say nothing: a valley bends within them.

    A metal's n and k are such: along a curve all give the same reflectance but for its rise towards grazing angles.

    Args:
        problem: what is estimated.
        unknowns: u [P].
        information: JᵀWJ there [P, P].
        elsewhere: gives it at other u.
    """
    found: set[int] = set()
    for direction, partners in weak_directions(information):
        for step in (quantile95(math.inf) * direction, -quantile95(math.inf) * direction):
            room = torch.where(step > 0, problem.upper, problem.lower) - unknowns
            share = min(float((room / step)[step != 0].min()), 1.0)
            if share < _ROOM:
                continue
            moved = share * step
            ratio = float((moved @ elsewhere(unknowns + moved) @ moved) / (moved @ information @ moved))
            if not 1 / _BENDS < ratio < _BENDS:
                found |= {*partners.nonzero()[:, 0].tolist()}
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
        statistics = accumulate(problem, moved, solution.tiles, solution.unknowns, solution.misfit)
        covariance = fisher(
            statistics.information / solution.statistics.misfit, torch.ones(problem.size, dtype=torch.bool)
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
    plain = fisher(solution.statistics.information / solution.statistics.misfit, everything).std
    return float((bars.open.std / plain).nan_to_num(1.0, posinf=1.0).clamp(min=1.0).max())
