"""Errors of many simulated captures pooled in units of the Cramér-Rao bound, with their Monte-Carlo intervals."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from matest.benchmark.instruments.trial import Trial
from matest.benchmark.record import Record

# An estimate whose χ² is higher than this above another one's is not the optimum: half a unit of log-likelihood, less
# than a move by one standard error costs.
MISSED = 0.5
_RESAMPLINGS = 1000
# Errors of fewer captures are held to no limit.
_ENOUGH = 30


@dataclass(frozen=True)
class Interval:
    """A pooled figure and the 95 % interval of its Monte-Carlo error."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Targets:
    """Limits: on the pooled error as a multiple of the bound, and on the share of intervals that hold the truth."""

    error: float
    lowest_coverage: float
    highest_coverage: float | None = None


def rms_error(trials: Sequence[Trial]) -> Interval:
    """Root mean square error in units of the bound over all figures that were given."""
    squares = [[f.error**2 for f in trial.figures if f.value is not None] for trial in trials]
    mean = _resampled(squares)
    return Interval(math.sqrt(mean.value), math.sqrt(mean.low), math.sqrt(mean.high))


def coverage(trials: Sequence[Trial]) -> Interval:
    """Share of the 95 % intervals that hold the truth."""
    return _resampled([[float(f.covered) for f in trial.figures if f.interval is not None] for trial in trials])


def mean_error(trials: Sequence[Trial]) -> Interval:
    """Mean error in units of the bound: 0 without bias."""
    return _resampled([[f.error for f in trial.figures if f.value is not None] for trial in trials])


def _resampled(values: list[list[float]]) -> Interval:
    """The mean of all values, its interval by the bootstrap: captures are drawn whole, their errors depend."""
    sums = np.array([sum(own) for own in values])
    counts = np.array([len(own) for own in values])
    if not counts.sum():
        return Interval(math.nan, math.nan, math.nan)
    drawn = np.random.default_rng(0).integers(len(values), size=(_RESAMPLINGS, len(values)))
    means = sums[drawn].sum(1) / np.maximum(counts[drawn].sum(1), 1)
    low, high = np.quantile(means, (0.025, 0.975))
    return Interval(float(sums.sum() / counts.sum()), float(low), float(high))


def records(suite: str, case: str, trials: Sequence[Trial], targets: Targets) -> Iterator[Record]:
    """The figures of a suite: pooled over all parameters, then parameter by parameter."""
    figures = [figure for trial in trials for figure in trial.figures]
    given = [figure for figure in figures if figure.value is not None]
    yield Record(suite, case, "captures", len(trials), "1", "higher")
    yield Record(suite, case, "parameters", len(figures), "1", "higher")
    lost = [trial for trial in trials if any(figure.value is None for figure in trial.figures)]
    share = len(given) / len(figures) if figures else None
    yield Record(suite, case, "given", share, "1", "higher", note=_example(suite, lost))
    if not given:
        return
    yield from _pooled(suite, case, trials, targets)
    checked = [trial for trial in trials if trial.excess is not None]
    if checked:
        missed = [trial for trial in checked if (trial.excess or 0.0) > MISSED]
        yield Record(suite, case, "optimum missed", len(missed), "1", limit=0, note=_example(suite, missed))
    unlike = [trial for trial in trials if trial.errors != "fisher"]
    yield Record(suite, case, "held not to fit", len(unlike) / len(trials), "1", note=_example(suite, unlike))
    for name in dict.fromkeys(figure.label.partition("[")[0] for figure in given):
        single = [trial.only(name) for trial in trials]
        yield from _with_ends(Record(suite, case, f"{name}: rms error", None, "bound"), rms_error(single))
        yield from _with_ends(Record(suite, case, f"{name}: mean error", None, "bound"), mean_error(single))


def _pooled(suite: str, case: str, trials: Sequence[Trial], targets: Targets) -> Iterator[Record]:
    """Error and coverage over all parameters, with their limits where there are enough captures."""
    covered, judged = coverage(trials), len(trials) >= _ENOUGH
    worst = sorted(trials, key=lambda trial: trial.worst, reverse=True)
    limit, note = targets.error if judged else None, _example(suite, worst)
    yield from _with_ends(Record(suite, case, "rms error", None, "bound", limit=limit, note=note), rms_error(trials))
    uncovered = sorted(trials, key=lambda trial: trial.uncovered, reverse=True)
    limit, note = targets.lowest_coverage if judged else None, _example(suite, uncovered)
    yield from _with_ends(Record(suite, case, "coverage", None, "1", "higher", limit, note), covered)
    if judged and targets.highest_coverage is not None:
        note = f"95 % Monte-Carlo interval {covered.low:.3g} to {covered.high:.3g}"
        yield Record(suite, case, "coverage, not above", covered.value, "1", limit=targets.highest_coverage, note=note)


def _with_ends(record: Record, interval: Interval) -> Iterator[Record]:
    """A record with its value, and two with the ends of its interval."""
    yield replace(record, value=interval.value)
    for end, value in (("from", interval.low), ("to", interval.high)):
        yield Record(record.suite, record.case, f"{record.metric}, {end}", value, record.unit)


def _example(suite: str, trials: Sequence[Trial], count: int = 3) -> str:
    """The first few captures, and how to see one of them again."""
    if not trials:
        return ""
    lines = [f"seed {trial.seed} ({trial.about}): {trial.summary}" for trial in trials[:count]]
    again = (
        f"from matest.benchmark.suites import {suite}; print({suite}.again('{trials[0].expression}', {trials[0].seed}))"
    )
    return "\n".join([*lines, f'again: python -c "{again}"'])
