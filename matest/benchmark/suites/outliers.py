"""Errors and coverage where pixels are spoilt: 8-bit images with outliers and saturated highlights."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Group

from matest.benchmark.instruments.pooling import Targets
from matest.benchmark.instruments.simulated import Conditions
from matest.benchmark.instruments.trial import described, trial
from matest.benchmark.record import Progress, Record
from matest.benchmark.suites.efficiency import figures, pooled_table

SPOILT = Conditions(bits=8, outliers=0.02, saturated=0.05)
CAPTURES, CAPTURES_QUICK = 2000, 2
TARGETS = Targets(error=1.3, lowest_coverage=0.90)


def run(quick: bool, progress: Progress) -> Iterator[Record]:
    """Records of every model; the bound is that of the samples that are neither outliers nor saturated."""
    yield from figures("outliers", SPOILT, TARGETS, CAPTURES_QUICK if quick else CAPTURES, progress)


def within(seconds: float, progress: Progress) -> Iterator[Record]:
    """The same of as many captures as so many seconds allow."""
    yield from figures("outliers", SPOILT, TARGETS, CAPTURES, progress, seconds)


def again(expression: str, seed: int) -> str:
    """One of the captures once more, as a sentence: to look into a failure that the suite names by its seed."""
    return described(trial(expression, seed, SPOILT, grid=False))


def outliers_table(found: list[Record]) -> Group:
    """Pooled errors and coverage with their intervals; then parameter by parameter."""
    conditions = (
        f"8-bit images, {SPOILT.outliers:.0%} of the pixels outliers, {SPOILT.saturated:.0%} saturated. Limits: error "
        f"{TARGETS.error:g} (bound of the clean samples), coverage {TARGETS.lowest_coverage:g}."
    )
    return pooled_table(found, conditions)
