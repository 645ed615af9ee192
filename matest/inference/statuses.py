"""What error bars, valleys and intervals make of each unknown: a number, a bound, or nothing."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from matest.estimators.covariance import quantile95
from matest.inference.error_bars import ErrorBars
from matest.inference.expansion import Expansion
from matest.inference.intervals import Intervals
from matest.inference.lobes import LobesNotSeen
from matest.inference.quantities import ParameterEstimate
from matest.inference.valleys import Valleys

# A value drawn evenly from a domain has this share of its width as its standard deviation: no better known, nothing is.
_KNOWS_NOTHING = 1 / math.sqrt(12)
# A value at or near a bound is not known if its interval covers this share of the domain.
_ANYWHERE = 0.95
# A parameter that only its logarithm is even in, and one along a bent valley, is not known to more than this of itself.
_FACTOR = 0.5


@dataclass(frozen=True)
class Unknown:
    """One unknown, and what is known of it.

    Attributes:
        value: at the optimum.
        std: standard error.
        interval: of 95 %.
        width: of its domain.
        largest_std: with a larger standard error nothing is known of it.
        lower: end of its domain.
        flat: whether χ² is flat at the lower bound that it is near.
        at_end: whether it lies at a bound for all that the samples tell.
        near_end: whether its interval is by the profile of the likelihood, or it lies at an end.
        undetermined: whether it takes part in a combination that the samples say nothing of.
        locked: whether it moves with another one of which they say nothing where it stands.
        lobe_not_seen: whether it shapes lobes that are not there.
    """

    value: float
    std: float
    interval: tuple[float, float]
    width: float
    largest_std: float
    lower: float
    flat: bool
    at_end: bool
    near_end: bool
    undetermined: bool
    locked: bool
    lobe_not_seen: bool


def _flat(unknown: Unknown) -> bool:
    return unknown.flat


def _in_a_combination(unknown: Unknown) -> bool:
    return unknown.undetermined or unknown.locked


def _of_no_lobe(unknown: Unknown) -> bool:
    return unknown.lobe_not_seen


def _as_if_drawn_from_its_domain(unknown: Unknown) -> bool:
    return unknown.std > unknown.largest_std and not unknown.at_end


def _anywhere(unknown: Unknown) -> bool:
    low, high = unknown.interval
    return unknown.near_end and math.isfinite(unknown.width) and high - low > _ANYWHERE * unknown.width


def _at_end(unknown: Unknown) -> bool:
    return unknown.at_end


# The first rule that holds gives the status of an unknown; if none does it is determined.
RULES: tuple[tuple[Callable[[Unknown], bool], str], ...] = (
    (_flat, "at bound"),
    (_in_a_combination, "not determined"),
    (_of_no_lobe, "not determined"),
    (_as_if_drawn_from_its_domain, "not determined"),
    (_anywhere, "not determined"),
    (_at_end, "at bound"),
)


@dataclass(frozen=True)
class Verdict:
    """What is reported of one unknown.

    Attributes:
        value: None where it is not determined.
        std: None there, and at a bound.
        interval: None where it is not determined.
        status: determined | at bound | not determined.
    """

    value: float | None
    std: float | None
    interval: list[float] | None
    status: str

    @classmethod
    def of(cls, unknown: Unknown) -> Verdict:
        """The verdict on an unknown, by the first of the rules that holds."""
        status = next((status for rule, status in RULES if rule(unknown)), "determined")
        if status == "not determined":
            return cls(None, None, None, status)
        low, high = unknown.interval
        if unknown.flat:
            return cls(unknown.lower, None, [unknown.lower, high], status)
        return cls(unknown.value, unknown.std if status == "determined" else None, [low, high], status)


def verdicts(
    expansion: Expansion, bars: ErrorBars, lobes: LobesNotSeen, valleys: Valleys, intervals: Intervals
) -> list[Verdict]:
    """What is reported of every unknown [P]."""
    problem = expansion.problem
    return [
        Verdict.of(_unknown(expansion, bars, lobes, valleys, intervals, name, position))
        for name, place in problem.where.items()
        for position in range(place.start, place.stop)
    ]


def _unknown(
    expansion: Expansion,
    bars: ErrorBars,
    lobes: LobesNotSeen,
    valleys: Valleys,
    intervals: Intervals,
    name: str,
    position: int,
) -> Unknown:
    problem, place = expansion.problem, expansion.problem.where[name]
    domain, declared = problem.domain(name), problem.declared(name)
    value = float(expansion.unknowns[position])
    flat = position in valleys.flat
    at_end = bool(bars.bound[position]) or flat
    covariance = bars.open if at_end else bars.covariance
    std = float(covariance.std[position])
    reach = quantile95(bars.covariance.degrees)
    # Under an unknown light scale only a value in proportion to the others can be called large.
    width = declared.domain.width if declared.periodic else domain.width
    scale = float(expansion.unknowns[place].max()) if math.isinf(width) else width
    largest = min(_KNOWS_NOTHING * scale, _FACTOR * value if declared.log else math.inf)
    if expansion.prior[position] > 0:
        # The domain is part of the error bar already.
        largest = 1 / math.hypot(1 / largest, math.sqrt(expansion.prior[position]))
    interval = max(domain.lower, value - reach * std), min(domain.upper, value + reach * std)
    interval = intervals.ends.get(position, interval)
    if position in intervals.bent and position in intervals.ends:
        std = (interval[1] - interval[0]) / (2 * reach)
        largest = min(largest, _FACTOR * abs(value))
    return Unknown(
        value=value,
        std=std,
        interval=interval,
        width=width,
        largest_std=largest,
        lower=domain.lower,
        flat=flat,
        at_end=at_end,
        near_end=at_end or position in intervals.ends,
        undetermined=bool(covariance.undetermined[position]),
        locked=position in valleys.locked,
        lobe_not_seen=name in lobes.shapes,
    )


def combined(channels: Sequence[Verdict], unit: str, doc: str) -> ParameterEstimate:
    """The estimate of a parameter from the verdicts on its channels: its status is the worst of theirs."""
    states = {verdict.status for verdict in channels}
    status = next(state for state in ("not determined", "at bound", "determined") if state in states)
    if len(channels) == 1:
        return ParameterEstimate(channels[0].value, channels[0].std, channels[0].interval, unit, status, doc)
    return ParameterEstimate(
        [verdict.value for verdict in channels],
        [verdict.std for verdict in channels],
        [verdict.interval for verdict in channels],
        unit,
        status,
        doc,
    )
