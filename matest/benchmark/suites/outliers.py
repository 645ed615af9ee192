"""Errors and coverage where pixels are spoilt: 8-bit images with outliers and saturated highlights."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.console import Group

from matest.benchmark.instruments import trial
from matest.benchmark.instruments.photographs import Conditions
from matest.benchmark.instruments.pooling import Targets
from matest.benchmark.suite import Effort, Progress, Record, Suite
from matest.benchmark.suites.efficiency import pooled, pooled_table

SPOILT = Conditions(bits=8, outliers=0.02, saturated=0.05)
CAPTURES = 2000
CAPTURES_QUICK = 2
TARGETS = Targets(error=1.3, lowest_coverage=0.90)


def measure(effort: Effort, progress: Progress) -> Iterator[Record]:
    """Records of every model; the bound is that of the samples that are neither outliers nor saturated."""
    captures = CAPTURES_QUICK if effort.quick else CAPTURES
    yield from pooled("outliers", SPOILT, TARGETS, captures, effort.seconds, progress)


def again(expression: str, seed: int) -> str:
    """One of the captures once more, as a sentence."""
    return trial.again(expression, seed, SPOILT, grid=False)


def table(records: Sequence[Record]) -> Group:
    """Pooled errors and coverage with their intervals; then parameter by parameter."""
    conditions = (
        f"8-bit images, {SPOILT.outliers:.0%} of the pixels outliers, {SPOILT.saturated:.0%} saturated. Limits: error "
        f"{TARGETS.error:g} (bound of the clean samples), coverage {TARGETS.lowest_coverage:g}."
    )
    return pooled_table(records, conditions)


SUITE = Suite(measure, table, share=90)
