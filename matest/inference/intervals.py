"""95 % intervals by the profile of the likelihood, where symmetric intervals are wrong."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import torch
from torch import Tensor

from matest.estimators.covariance import quantile95
from matest.inference.error_bars import ErrorBars
from matest.inference.expansion import Expansion
from matest.inference.lobes import LobesNotSeen
from matest.inference.profiles import Profile
from matest.inference.valleys import Around, Valleys

# Standard errors within which a bound is near enough to cut an interval.
_NEAR_BOUND = 3.0
# Multiple of the 95 % reach of an error bar. A valley bends if the profile of another unknown moves an unknown further.
_STRAY_REACH = 1.2


@dataclass(frozen=True)
class Intervals:
    """Intervals of unknowns, by position in u.

    Attributes:
        ends: of the unknowns at or near a bound and along bent valleys.
        bent: positions of unknowns along bent valleys, also of valleys that only another unknown's profile shows.
    """

    ends: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    bent: frozenset[int] = frozenset()


def profile_intervals(
    expansion: Expansion,
    bars: ErrorBars,
    lobes: LobesNotSeen,
    valleys: Valleys,
    around: Around,
    not_determined: Collection[int],
) -> Intervals:
    """Intervals by the profile of the likelihood near a bound and along a bent valley.

    A symmetric interval is wrong there: a bound cuts the likelihood, which often is far from quadratic.

    Args:
        expansion, bars, lobes: the likelihood to second order.
        valleys: where the second order is wrong.
        around: gives the likelihood about the optimum.
        not_determined: positions of unknowns that are not determined to first order.
    """
    problem = expansion.problem
    # Intervals are wider where the jackknife has few clusters.
    quantile = quantile95(bars.covariance.degrees)
    small_sample = quantile / quantile95(math.inf)
    ends: dict[int, tuple[float, float]] = {}
    region = [expansion.unknowns]
    for position in range(problem.size):
        if position in not_determined and (position not in valleys.bent or position in valleys.locked):
            continue
        guess = _first_guess(expansion, bars, valleys, position, quantile)
        if guess is not None:
            spread, wider = guess
            profile = Profile(around(), position, wider * small_sample, position in valleys.flat)
            low, high, inside = profile.interval(spread)
            if bars.shares:
                # Errors of the calibration move the estimate, whatever the likelihood about it is.
                near = _symmetric(expansion, position, float(bars.open.std[position]))
                low, high = min(low, near[0]), max(high, near[1])
            ends[position] = (low, high)
            region += inside
    reach = quantile * bars.open.std
    strays = _strays(expansion, reach, region) - {*ends}
    ends |= {position: _symmetric(expansion, position, float(reach[position])) for position in strays}
    ends = _covering(ends, region)
    return Intervals(_from_zero(expansion, lobes, ends), valleys.bent | strays)


def _first_guess(
    expansion: Expansion, bars: ErrorBars, valleys: Valleys, position: int, quantile: float
) -> tuple[float, float] | None:
    """Half-width to begin the profile of an unknown with, and widening of its error bars; None: it needs no profile."""
    if position in valleys.flat:
        return valleys.flat[position], bars.largest_widening
    value, std = float(expansion.unknowns[position]), float(bars.open.std[position])
    room = float(min(value - expansion.problem.lower[position], expansion.problem.upper[position] - value))
    if std > 0 and (room < _NEAR_BOUND * std or position in valleys.bent):
        return quantile * std, float(bars.widening[position])
    return None


def _symmetric(expansion: Expansion, position: int, reach: float) -> tuple[float, float]:
    """The interval of an unknown by its error bar, inside its domain."""
    value = float(expansion.unknowns[position])
    lower, upper = float(expansion.problem.lower[position]), float(expansion.problem.upper[position])
    return max(value - reach, lower), min(value + reach, upper)


def _covering(ends: Mapping[int, tuple[float, float]], region: Sequence[Tensor]) -> dict[int, tuple[float, float]]:
    """Intervals widened to all values inside the 95 % region that some profile visited."""
    lowest, highest = torch.stack([*region]).aminmax(dim=0)
    return {
        position: (min(low, float(lowest[position])), max(high, float(highest[position])))
        for position, (low, high) in ends.items()
    }


def _from_zero(
    expansion: Expansion, lobes: LobesNotSeen, ends: Mapping[int, tuple[float, float]]
) -> dict[int, tuple[float, float]]:
    """The intervals, where those of amplitudes of lobes that are not seen begin at zero.

    The search chose the lobe width that fits the noise best, which makes these amplitudes too large.
    """
    problem = expansion.problem
    amplitudes = {
        position for name in lobes.amplitudes for position in range(problem.where[name].start, problem.where[name].stop)
    }
    return {
        position: (float(problem.lower[position]) if position in amplitudes else low, high)
        for position, (low, high) in ends.items()
    }


def _strays(expansion: Expansion, reach: Tensor, region: Sequence[Tensor]) -> set[int]:
    """Positions of unknowns that the profiles of others moved far beyond their error bars.

    Such an unknown has no profile itself, or one that stays on its side of a valley.
    """
    lowest, highest = torch.stack([*region]).aminmax(dim=0)
    distance = torch.maximum(highest - expansion.unknowns, expansion.unknowns - lowest)
    return {*((distance > _STRAY_REACH * reach) & (reach > 0)).nonzero()[:, 0].tolist()}
