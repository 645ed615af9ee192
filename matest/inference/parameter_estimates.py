"""What error bars make of each parameter: a number, a bound, or nothing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import torch

from matest.estimators import Problem, Solution
from matest.estimators.covariance import error_of, fisher, quantile95
from matest.inference.error_bars import ErrorBars
from matest.inference.profiles import Profile, Surroundings, surroundings
from matest.inference.quantities import ParameterEstimate
from matest.inference.unseen import bent, faint, flat_at_bound, locked_with_unseen, unseen_amplitudes, widening
from matest.parameters import Role

# No better known than a value drawn evenly from the domain (its std is width/√12): not determined.
_KNOWS_NOTHING = 1 / math.sqrt(12)
# Likewise a derived quantity with a larger relative standard error than this.
_DERIVED_UNKNOWN = 0.5
# A bound is near within so many standard errors.
_NEAR = 3.0
# Likewise a value at or near a bound whose interval covers this share of the domain.
_ANYWHERE = 0.95
# What lies this much further off than the 95 % reach of an error bar, on another unknown's profile, belongs to a valley
# that bends.
_BEYOND = 1.2


def with_profiles(solution: Solution, bars: ErrorBars) -> ErrorBars:
    """The same error bars with intervals by the profile of the likelihood near a bound and along a valley that bends.

    A symmetric interval says little there: the likelihood is cut, and often far from quadratic.
    """

    @cache
    def around() -> Surroundings:
        return surroundings(solution)

    problem, scale = solution.problem, solution.statistics.misfit
    bars = replace(bars, flat=flat_at_bound(solution), bent=bent(solution, around))
    bars = replace(bars, locked=locked_with_unseen(solution, bars, around))
    plain = fisher(solution.statistics.information / scale, torch.ones_like(bars.bound)).std
    quantile = quantile95(bars.covariance.degrees)
    intervals: dict[int, tuple[float, float]] = {}
    passed = [solution.unknowns]
    for name, place in problem.where.items():
        found = parameter_estimate(solution, bars, name)
        told = found.value if isinstance(found.value, list) else [found.value]
        for position, told_of in zip(range(place.start, place.stop), told, strict=False):
            value, std = float(solution.unknowns[position]), float(bars.open.std[position])
            if told_of is None and (position not in bars.bent or position in bars.locked):
                continue
            room = float(min(value - problem.lower[position], problem.upper[position] - value))
            if position in bars.flat:
                spread, wider = bars.flat[position], widening(solution, bars)
            elif std > 0 and (room < _NEAR * std or position in bars.bent):
                spread, wider = quantile * std, std / float(plain[position])
            else:
                continue
            wider = wider * quantile / quantile95(math.inf)
            low, high, inside = Profile(around(), position, wider, position in bars.flat).interval(spread)
            intervals[position] = (low, high)
            passed += inside
    lowest, highest = torch.stack(passed).aminmax(dim=0)
    reach = quantile * bars.open.std
    further = (highest - solution.unknowns > _BEYOND * reach) | (solution.unknowns - lowest > _BEYOND * reach)
    strays = {*(further & (reach > 0)).nonzero()[:, 0].tolist()} - {*intervals}
    for position in strays:
        # No profile of its own, or one that stays on its side of a valley: another one's led there.
        middle, half = float(solution.unknowns[position]), float(reach[position])
        low, high = float(problem.lower[position]), float(problem.upper[position])
        intervals[position] = (max(middle - half, low), min(middle + half, high))
    intervals = {
        position: (min(low, float(lowest[position])), max(high, float(highest[position])))
        for position, (low, high) in intervals.items()
    }
    for name in unseen_amplitudes(solution, bars):
        place = problem.where[name]
        for position in {*range(place.start, place.stop)} & {*intervals}:
            # The width that was searched for made the most of the noise.
            intervals[position] = (float(problem.lower[position]), intervals[position][1])
    return replace(bars, intervals=intervals, bent=bars.bent | strays)


def parameter_estimates(solution: Solution, bars: ErrorBars) -> dict[str, ParameterEstimate]:
    """Every parameter of the model: estimated, tied or fixed."""
    problem = solution.problem
    values = problem.values(solution.unknowns)
    out = {}
    for name, declared in problem.brdf.declared.items():
        source = problem.ties.get(name, name)
        value = values[name]
        if source in problem.where:
            found = parameter_estimate(solution, bars, source)
            status = "tied" if source != name else found.status
            out[name] = replace(found, status=status, unit=declared.unit, doc=declared.doc)
        elif declared.role is not Role.GAUGE or float(value) != 1:
            out[name] = ParameterEstimate(value.tolist(), None, None, declared.unit, "fixed", declared.doc)
    derived = {label: _derived(solution, bars, label, out) for label in problem.brdf.derived}
    for names in problem.brdf.structure.derived.values():
        if {*names} & {*problem.arbitrary} and {*names} & {*problem.where}:
            for name in names:
                out[name] = replace(out[name], value=None, std=None, interval95=None, status="not determined")
    return out | derived


def parameter_estimate(solution: Solution, bars: ErrorBars, name: str) -> ParameterEstimate:
    """Value, error bar and interval of a free parameter, channel by channel."""
    problem, place = solution.problem, solution.problem.where[name]
    domain, declared = problem.domain(name), problem.declared(name)
    reach = quantile95(bars.covariance.degrees)
    values: list[float | None] = []
    stds: list[float | None] = []
    intervals: list[list[float] | None] = []
    states = []
    absent = faint(solution, bars, name)
    for position in range(place.start, place.stop):
        value = float(solution.unknowns[position])
        flat = position in bars.flat
        at_end = bool(bars.bound[position]) or flat
        covariance = bars.open if at_end else bars.covariance
        std = float(covariance.std[position])
        # Under an unknown light scale only a value in proportion to the others can be called large.
        width = declared.domain.width if declared.periodic else domain.width
        scale = float(solution.unknowns[place].max()) if math.isinf(width) else width
        largest = min(_KNOWS_NOTHING * scale, 0.5 * value if declared.log else math.inf)
        interval = [max(domain.lower, value - reach * std), min(domain.upper, value + reach * std)]
        if position in bars.intervals:
            interval = list(bars.intervals[position])
        if position in bars.bent & bars.intervals.keys():
            std = (interval[1] - interval[0]) / (2 * reach)
            largest = min(largest, 0.5 * abs(value))
        if flat:
            values.append(domain.lower)
            stds.append(None)
            intervals.append([domain.lower, interval[1]])
            states.append("at bound")
            continue
        near_end = at_end or position in bars.intervals
        anywhere = near_end and math.isfinite(width) and interval[1] - interval[0] > _ANYWHERE * width
        lost = bool(covariance.undetermined[position]) or position in bars.locked
        if lost or absent or (std > largest and not at_end) or anywhere:
            values.append(None)
            stds.append(None)
            intervals.append(None)
            states.append("not determined")
            continue
        values.append(value)
        stds.append(None if at_end else std)
        intervals.append(interval)
        states.append("at bound" if at_end else "determined")
    status = next(state for state in ("not determined", "at bound", "determined") if state in states)
    single = len(values) == 1
    return ParameterEstimate(
        values[0] if single else values,
        stds[0] if single else stds,
        intervals[0] if single else intervals,
        declared.unit,
        status,
        declared.doc,
    )


def _derived(
    solution: Solution, bars: ErrorBars, label: str, estimates: Mapping[str, ParameterEstimate]
) -> ParameterEstimate:
    """A derived quantity, with its error bar to first order in the unknowns that it depends on."""
    problem, quantity = solution.problem, solution.problem.brdf.derived[label]
    names = problem.brdf.structure.derived[label]
    everything = problem.values(solution.unknowns)
    values = {name: everything[name] for name in names}
    value, slopes = float(quantity.value(values)), quantity.slopes(values)
    sources = {name: problem.ties.get(name, name) for name in names}
    free = {source for source in sources.values() if source in problem.where}
    if not free:
        return ParameterEstimate(value, None, None, quantity.unit, "fixed", quantity.doc)
    if len(free) == 1:
        moving = [name for name in names if sources[name] in free]
        found = estimates[moving[0]]
        if found.value is None:
            return ParameterEstimate(None, None, None, quantity.unit, found.status, quantity.doc)
        std = None if found.std is None else abs(sum(slopes[name] for name in moving)) * float(found.std)  # type: ignore[arg-type]
        # A function of one unknown takes the ends of its interval along.
        at_ends = [
            values | {name: torch.tensor(end, dtype=torch.float64) for name in moving} for end in found.interval95
        ]
        ends = sorted(float(quantity.value(there)) for there in at_ends)
        return ParameterEstimate(value, std, ends, quantity.unit, found.status, quantity.doc)
    relative = torch.zeros(problem.size, dtype=torch.float64)
    for name, source in sources.items():
        if source in problem.where:
            relative[problem.where[source].start] += slopes[name] / value
    spread = error_of(solution.statistics.information / solution.statistics.misfit, relative)
    if spread is None or spread > _DERIVED_UNKNOWN:
        return ParameterEstimate(None, None, None, quantity.unit, "not determined", quantity.doc)
    std = abs(value) * spread * widening(solution, bars)
    reach = quantile95(bars.covariance.degrees) * std
    interval = [max(value - reach, 0.0), value + reach]
    return ParameterEstimate(value, std, interval, quantity.unit, "determined", quantity.doc)


def reported_labels(problem: Problem) -> list[str]:
    """A name for every row of `reported_correlation`."""
    return [reported_name(problem, label) for label in problem.labels]


def reported_correlation(solution: Solution, bars: ErrorBars) -> list[list[float]]:
    """Correlation of the estimates; a parameter of which only a derived quantity is known stands for that."""
    sign = torch.tensor([_direction(solution, label) for label in solution.problem.labels])
    return (bars.covariance.correlation * sign[:, None] * sign[None, :]).tolist()


def _direction(solution: Solution, name: str) -> float:
    """Whether what is reported of a parameter grows (1) or falls (−1) with it."""
    quantity = solution.problem.quantity(name)
    if quantity is None:
        return 1.0
    values = solution.problem.values(solution.unknowns)
    names = solution.problem.brdf.structure.derived[quantity.name]
    return math.copysign(1.0, quantity.slopes({key: values[key] for key in names})[name])


def reported_name(problem: Problem, name: str) -> str:
    """The name under which what is known of a parameter is reported: its own, or that of a derived quantity."""
    quantity = problem.quantity(name)
    return name if quantity is None else quantity.name


def known_by_ratio(problem: Problem, name: str) -> bool:
    """Whether only a quantity derived from a parameter and others has an effect."""
    return name in problem.arbitrary or problem.quantity(name) is not None


def seen_together(solution: Solution, bars: ErrorBars) -> set[str]:
    """Names under which parameters are reported of which the images see only combinations."""
    problem, told = solution.problem, solution.statistics.information.diagonal() > 0
    locked = bars.covariance.undetermined & told
    locked[[*bars.bent, *bars.locked]] = True
    return {reported_name(problem, name) for name, place in problem.where.items() if bool(locked[place].any())}
