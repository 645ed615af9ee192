"""Intervals of 95 % by the profile of the likelihood, where symmetric ones say little."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import torch
from torch import Tensor

from matest.estimators.covariance import quantile95
from matest.inference.error_bars import ErrorBars
from matest.inference.expansion import Expansion
from matest.inference.lobes import LobesNotSeen
from matest.inference.profiles import Profile
from matest.inference.valleys import Around, Valleys

# A bound is near within so many standard errors.
_NEAR = 3.0
# What lies this much further off than the 95 % reach of an error bar, on another unknown's profile, belongs to a valley
# that bends.
_BEYOND = 1.2


@dataclass(frozen=True)
class Intervals:
    """Intervals of unknowns, by position in u.

    Attributes:
        ends: of the unknowns at or near a bound and along valleys that bend.
        bent: positions of the latter; those too that only another unknown's profile shows to lie along one.
    """

    ends: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    bent: frozenset[int] = frozenset()


def profile_intervals(
    expansion: Expansion,
    bars: ErrorBars,
    lobes: LobesNotSeen,
    valleys: Valleys,
    around: Around,
    lost: Collection[int],
) -> Intervals:
    """Intervals by the profile of the likelihood near a bound and along a valley that bends.

    A symmetric interval says little there: the likelihood is cut, and often far from quadratic.

    Args:
        expansion, bars, lobes, valleys: what is known to second order, and where that is not true.
        around: gives the likelihood about the optimum.
        lost: positions of unknowns that are not determined to first order.
    """
    problem = expansion.problem
    quantile = quantile95(bars.covariance.degrees)
    ends: dict[int, tuple[float, float]] = {}
    passed = [expansion.unknowns]
    for position in range(problem.size):
        if position in lost and (position not in valleys.bent or position in valleys.locked):
            continue
        value, std = float(expansion.unknowns[position]), float(bars.open.std[position])
        room = float(min(value - problem.lower[position], problem.upper[position] - value))
        if position in valleys.flat:
            spread, wider = valleys.flat[position], bars.largest_widening
        elif std > 0 and (room < _NEAR * std or position in valleys.bent):
            spread, wider = quantile * std, float(bars.widening[position])
        else:
            continue
        wider = wider * quantile / quantile95(math.inf)
        low, high, inside = Profile(around(), position, wider, position in valleys.flat).interval(spread)
        ends[position] = (low, high)
        passed += inside
    reach = quantile * bars.open.std
    strays = _strays(expansion, reach, passed) - {*ends}
    for position in strays:
        # No profile of its own, or one that stays on its side of a valley: another one's led there.
        middle, half = float(expansion.unknowns[position]), float(reach[position])
        ends[position] = (
            max(middle - half, float(problem.lower[position])),
            min(middle + half, float(problem.upper[position])),
        )
    lowest, highest = torch.stack(passed).aminmax(dim=0)
    ends = {
        position: (min(low, float(lowest[position])), max(high, float(highest[position])))
        for position, (low, high) in ends.items()
    }
    for name in lobes.amplitudes:
        place = problem.where[name]
        for position in {*range(place.start, place.stop)} & {*ends}:
            # The width that was searched for made the most of the noise.
            ends[position] = (float(problem.lower[position]), ends[position][1])
    return Intervals(ends, valleys.bent | strays)


def _strays(expansion: Expansion, reach: Tensor, passed: list[Tensor]) -> set[int]:
    """Positions of unknowns that profiles of others have led far beyond their own error bars."""
    lowest, highest = torch.stack(passed).aminmax(dim=0)
    further = (highest - expansion.unknowns > _BEYOND * reach) | (expansion.unknowns - lowest > _BEYOND * reach)
    return {*(further & (reach > 0)).nonzero()[:, 0].tolist()}
