"""The verdict on every unknown, from error bars, valleys and intervals: determined, at bound or not determined."""

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

# Standard deviation of an even distribution over a domain, as a share of its width: samples that say nothing.
_STD_OF_EVEN = 1 / math.sqrt(12)
# Share of the domain that the interval of a value near a bound covers if the samples say nothing of it.
_WHOLE_DOMAIN = 0.95
# Relative standard error above which parameters that range over decades, or along a bent valley, are not determined.
_LARGEST_RELATIVE_STD = 0.5
# Share of the information of the domain. A smaller difference from it is rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Unknown:
    """One unknown, as the rules read it.

    Attributes:
        value: at the optimum.
        std: standard error.
        interval: of 95 %.
        width: of its domain.
        largest_std: with a larger standard error it is not determined.
        lower: end of its domain.
        flat: whether it is near a lower bound where χ² is flat in it.
        at_end: whether the samples hold it at a bound, or do not tell it from one that it lies near.
        end: the bound that its value lies on, held there or not; NaN: none.
        near_end: whether it lies at a bound, or has an interval by the profile of the likelihood.
        undetermined: whether it takes part in a combination that the samples do not determine.
        locked: whether it moves with another unknown that has no effect at its present value.
        lobe_not_seen: whether all lobes that it shapes are not seen.
    """

    value: float
    std: float
    interval: tuple[float, float]
    width: float
    largest_std: float
    lower: float
    flat: bool
    at_end: bool
    end: float
    near_end: bool
    undetermined: bool
    locked: bool
    lobe_not_seen: bool


def _no_better_than_its_domain(unknown: Unknown) -> bool:
    return unknown.std > unknown.largest_std and not unknown.at_end


def _over_the_whole_domain(unknown: Unknown) -> bool:
    low, high = unknown.interval
    return unknown.near_end and math.isfinite(unknown.width) and high - low > _WHOLE_DOMAIN * unknown.width


# The first rule that holds gives the status of an unknown; if no rule holds, it is determined.
RULES: tuple[tuple[Callable[[Unknown], bool], str], ...] = (
    (lambda unknown: unknown.flat, "at bound"),
    (lambda unknown: unknown.undetermined or unknown.locked, "not determined"),
    (lambda unknown: unknown.lobe_not_seen, "not determined"),
    (_no_better_than_its_domain, "not determined"),
    (_over_the_whole_domain, "not determined"),
    (lambda unknown: unknown.at_end or not math.isnan(unknown.end), "at bound"),
)


@dataclass(frozen=True)
class Verdict:
    """The value of one unknown as it is reported.

    Attributes:
        value: None where it is not determined.
        std: None where it is not determined or at a bound.
        interval: None where it is not determined.
        status: determined | at bound | not determined.
    """

    value: float | None
    std: float | None
    interval: list[float] | None
    status: str

    @classmethod
    def of(cls, unknown: Unknown) -> Verdict:
        """The verdict on an unknown, by the first rule that holds."""
        status = next((status for rule, status in RULES if rule(unknown)), "determined")
        if status == "not determined":
            return cls(None, None, None, status)
        low, high = unknown.interval
        if unknown.flat:
            return cls(unknown.lower, None, [unknown.lower, high], status)
        if not math.isnan(unknown.end):
            return cls(unknown.end, None, [min(low, unknown.end), max(high, unknown.end)], status)
        return cls(unknown.value, unknown.std if status == "determined" else None, [low, high], status)


def verdicts_on(
    expansion: Expansion, bars: ErrorBars, lobes: LobesNotSeen, valleys: Valleys, intervals: Intervals
) -> list[Verdict]:
    """The verdict on every unknown [P]."""
    problem = expansion.problem
    return [
        Verdict.of(_unknown(name, position, expansion, bars, lobes, valleys, intervals))
        for name, place in problem.where.items()
        for position in range(place.start, place.stop)
    ]


def _unknown(
    name: str,
    position: int,
    expansion: Expansion,
    bars: ErrorBars,
    lobes: LobesNotSeen,
    valleys: Valleys,
    intervals: Intervals,
) -> Unknown:
    """What the rules ask of an unknown, by its parameter and its position in u."""
    domain = expansion.problem.domain(name)
    value = float(expansion.unknowns[position])
    flat = position in valleys.flat
    at_end = bool(bars.bound[position]) or flat
    covariance = bars.open if at_end else bars.covariance
    std = _by_the_samples(float(covariance.std[position]), float(expansion.prior[position]))
    reach = quantile95(bars.covariance.degrees)
    symmetric = max(domain.lower, value - reach * std), min(domain.upper, value + reach * std)
    interval = intervals.ends.get(position, symmetric)
    largest_std = _largest_std(expansion, name, position)
    if position in intervals.bent and position in intervals.ends:
        std = (interval[1] - interval[0]) / (2 * reach)
        largest_std = min(largest_std, _LARGEST_RELATIVE_STD * abs(value))
    return Unknown(
        value=value,
        std=std,
        interval=interval,
        width=_width(expansion, name),
        largest_std=largest_std,
        lower=domain.lower,
        flat=flat,
        at_end=at_end,
        end=float(bars.ends[position]),
        near_end=at_end or position in intervals.ends,
        undetermined=bool(covariance.undetermined[position]),
        locked=position in valleys.locked,
        lobe_not_seen=name in lobes.shapes,
    )


def _width(expansion: Expansion, name: str) -> float:
    """Width of the domain of an unknown: for a periodic one the period, as its search has no ends."""
    declared = expansion.problem.declared(name)
    return declared.domain.width if declared.periodic else expansion.problem.domain(name).width


def _largest_std(expansion: Expansion, name: str, position: int) -> float:
    """The standard error above which the samples say nothing of an unknown."""
    problem, width, value = expansion.problem, _width(expansion, name), float(expansion.unknowns[position])
    # Under an unknown light scale the domain has no end: the largest channel serves as its width.
    scale = float(expansion.unknowns[problem.where[name]].max()) if math.isinf(width) else width
    return min(_STD_OF_EVEN * scale, _LARGEST_RELATIVE_STD * value if problem.declared(name).log else math.inf)


def _by_the_samples(std: float, prior: float) -> float:
    """A standard error by the samples alone, without the precision that the domain of the unknown adds."""
    if prior == 0:
        return std
    information = std**-2 - prior
    return information**-0.5 if information > _ROUNDING * prior else math.inf


def combined(channels: Sequence[Verdict], unit: str, doc: str) -> ParameterEstimate:
    """The estimate of a parameter from the verdicts on its channels: its status is the worst of theirs."""
    states = {verdict.status for verdict in channels}
    status = next(state for state in ("not determined", "at bound", "determined") if state in states)
    if len(channels) == 1:
        return ParameterEstimate(channels[0].value, channels[0].std, channels[0].interval, unit, status, doc)
    values, stds = [verdict.value for verdict in channels], [verdict.std for verdict in channels]
    return ParameterEstimate(values, stds, [verdict.interval for verdict in channels], unit, status, doc)
