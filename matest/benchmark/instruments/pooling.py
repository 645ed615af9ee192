"""Errors of many simulated captures pooled in units of the Cramér-Rao bound, with their Monte-Carlo intervals."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from matest.benchmark.instruments.trial import Trial
from matest.benchmark.suite import Record

# An estimate whose χ² is higher than this above another one's is not the optimum: half a unit of log-likelihood, less
# than a move by one standard error costs.
MISSED = 0.5
# Resamplings of the bootstrap.
_RESAMPLINGS = 1000
# Errors of fewer captures are held to no limit.
ENOUGH = 30
# Captures that a note shows.
_EXAMPLES = 3


class Interval(NamedTuple):
    """A pooled figure and the 95 % interval of its Monte-Carlo error."""

    value: float
    low: float
    high: float


class Targets(NamedTuple):
    """Limits: on the pooled error as a multiple of the bound, and on the share of intervals that hold the truth."""

    error: float
    lowest_coverage: float
    highest_coverage: float | None = None


def rms_error(trials: Sequence[Trial]) -> Interval:
    """Root mean square error in units of the bound over all figures that were given."""
    mean = _resampled([[f.error**2 for f in trial.figures if f.value is not None] for trial in trials])
    return Interval(*(math.sqrt(square) for square in mean))


def coverage(trials: Sequence[Trial]) -> Interval:
    """Share of the 95 % intervals that hold the truth."""
    return _resampled([[float(f.covered) for f in trial.figures if f.interval is not None] for trial in trials])


def mean_error(trials: Sequence[Trial]) -> Interval:
    """Mean error in units of the bound: 0 without bias."""
    return _resampled([[f.error for f in trial.figures if f.value is not None] for trial in trials])


def _resampled(values: list[list[float]]) -> Interval:
    """The mean of all values of all captures, and its interval."""
    return resampled(*(np.array([of(one) for one in values]) for of in (sum, len)))


def resampled(sums: np.ndarray, counts: np.ndarray) -> Interval:
    """The mean of all values of K captures, its interval by the bootstrap: captures are drawn whole, errors depend.

    Args:
        sums: of the values of each capture [K].
        counts: of these values [K].
    """
    if not counts.sum():
        return Interval(math.nan, math.nan, math.nan)
    drawn = np.random.default_rng(0).integers(len(counts), size=(_RESAMPLINGS, len(counts)))
    means = sums[drawn].sum(1) / np.maximum(counts[drawn].sum(1), 1)
    low, high = np.quantile(means, (0.025, 0.975))
    return Interval(float(sums.sum() / counts.sum()), float(low), float(high))


def records(suite: str, case: str, trials: Sequence[Trial], targets: Targets) -> Iterator[Record]:
    """The figures of a suite: pooled over all parameters, with limits where there are enough captures; then of each."""

    def pooled(metric: str, interval: Interval, unit: str, **more: Any) -> Iterator[Record]:
        """A pooled figure, and the ends of its interval."""
        yield Record(suite, case, metric, interval.value, unit, **more)
        for end, value in (("from", interval.low), ("to", interval.high)):
            yield Record(suite, case, f"{metric}, {end}", value, unit)

    figures = [figure for trial in trials for figure in trial.figures]
    given = [figure for figure in figures if figure.value is not None]
    yield Record(suite, case, "captures", len(trials), "1", "higher")
    yield Record(suite, case, "parameters", len(figures), "1", "higher")
    lost = [trial for trial in trials if any(figure.value is None for figure in trial.figures)]
    share = len(given) / len(figures) if figures else None
    yield Record(suite, case, "given", share, "1", "higher", note=_examples(suite, lost))
    if not given:
        return
    enough, covered = len(trials) >= ENOUGH, coverage(trials)
    note = _examples(suite, sorted(trials, key=lambda trial: trial.worst, reverse=True))
    limit = targets.error if enough else None
    yield from pooled("rms error", rms_error(trials), "bound", limit=limit, note=note)
    note = _examples(suite, sorted(trials, key=lambda trial: trial.uncovered, reverse=True))
    limit = targets.lowest_coverage if enough else None
    yield from pooled("coverage", covered, "1", better="higher", limit=limit, note=note)
    if enough and targets.highest_coverage is not None:
        note = f"95 % Monte-Carlo interval {covered.low:.3g} to {covered.high:.3g}"
        yield Record(suite, case, "coverage, not above", covered.value, "1", limit=targets.highest_coverage, note=note)
    if any(trial.excess is not None for trial in trials):
        missed = [trial for trial in trials if (trial.excess or 0.0) > MISSED]
        yield Record(suite, case, "optimum missed", len(missed), "1", limit=0, note=_examples(suite, missed))
    unlike = [trial for trial in trials if trial.errors != "fisher"]
    yield Record(suite, case, "held not to fit", len(unlike) / len(trials), "1", note=_examples(suite, unlike))
    for name in dict.fromkeys(figure.label.partition("[")[0] for figure in given):
        single = [trial.only(name) for trial in trials]
        yield from pooled(f"{name}: rms error", rms_error(single), "bound")
        yield from pooled(f"{name}: mean error", mean_error(single), "bound")


def _examples(suite: str, trials: Sequence[Trial]) -> str:
    """The first few captures, and how to see one of them again."""
    if not trials:
        return ""
    lines = [f"seed {trial.seed} ({trial.about}): {trial.summary}" for trial in trials[:_EXAMPLES]]
    again = (
        f"from matest.benchmark.suites import {suite}; print({suite}.again('{trials[0].expression}', {trials[0].seed}))"
    )
    return "\n".join([*lines, f'again: python -c "{again}"'])
