"""Errors on many simulated captures against the Cramér-Rao bound, whether 95 % intervals hold, and global optima."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from functools import partial

from rich.console import Group
from rich.table import Table
from rich.text import Text

from matest.benchmark.instruments import pooling
from matest.benchmark.instruments import trial as trials
from matest.benchmark.instruments.photographs import CLEAN, Conditions
from matest.benchmark.instruments.pooling import Targets
from matest.benchmark.instruments.trial import Trial, trial
from matest.benchmark.suite import Effort, Progress, Record, Suite
from matest.benchmark.tables import by_case, case_name, figure, page, ruled
from matest.workers import processes

MODELS = ("lambert", "oren-nayar", "oren-nayar-exact", "cook-torrance", "li-torrance")
CAPTURES = 2000
CAPTURES_QUICK = 4
TARGETS = Targets(error=1.05, lowest_coverage=0.93, highest_coverage=0.97)
again = trials.again


def measure(effort: Effort, progress: Progress) -> Iterator[Record]:
    """Records of every model on clean 16-bit captures."""
    captures = CAPTURES_QUICK if effort.quick else CAPTURES
    yield from pooled("efficiency", CLEAN, TARGETS, captures, effort.seconds, progress)


def pooled(
    suite: str, conditions: Conditions, targets: Targets, captures: int, seconds: float, progress: Progress
) -> Iterator[Record]:
    """Records of every model under some conditions. Optima are compared with a grid where nothing spoils the pixels.

    After so many seconds, of which every model has the same share, no more captures are begun.
    """
    with processes(captures) as pool:
        for expression in MODELS:
            one = partial(trial, expression, conditions=conditions, grid=conditions == CLEAN)
            results: list[Trial] = []
            end = time.perf_counter() + seconds / len(MODELS)
            for result in pool.map(one, range(captures)):
                results.append(result)
                progress(expression, len(results), captures)
                if time.perf_counter() > end:
                    break
            yield from pooling.records(suite, expression, results, targets)


def table(records: Sequence[Record]) -> Group:
    """Pooled errors and coverage with their intervals, optima missed; then parameter by parameter."""
    lowest, highest = TARGETS.lowest_coverage, TARGETS.highest_coverage
    return pooled_table(records, f"16-bit images. Limits: error {TARGETS.error:g}, coverage {lowest:g} to {highest:g}.")


def pooled_table(records: Sequence[Record], conditions: str) -> Group:
    """The same under any conditions."""
    cases = by_case(records)
    counts = sorted({int(metrics["captures"].value or 0) for metrics in cases.values()})
    captures = " to ".join(f"{count:,}" for count in dict.fromkeys((counts[0], counts[-1])))
    about = (
        f"{captures} captures a model, 64×64 pixels: sphere or vase, 1, 3 or 12 lights, one a photograph. {conditions}"
    )
    legend = (
        "Unknowns: those that the samples determine and whose truth lies 3 standard errors from a bound; given: their "
        "share that the estimate names. In brackets the 95 % Monte-Carlo interval."
    )
    return page(about, _over_all(cases), "", Text(legend), "", _by_parameter(cases), records=records)


def _over_all(cases: dict[str, dict[str, Record]]) -> Table:
    columns = ruled("", "un-\nknowns", "given", "rms error\n/ bound", "coverage", "optima\nmissed")
    for case, metrics in cases.items():
        row = [figure(metrics[name]) for name in ("parameters", "given")]
        row += [_with_interval(metrics, name) for name in ("rms error", "coverage")]
        count = int(metrics["captures"].value or 0)
        name = Text.assemble(case_name(case), f"\n  {count:,} captures")
        columns.add_row(name, *row, figure(metrics.get("optimum missed")))
    return columns


def _by_parameter(cases: dict[str, dict[str, Record]]) -> Table:
    columns = ruled("", "rms error\n/ bound", "mean error\n/ bound")
    for case, metrics in cases.items():
        columns.add_row(case_name(case))
        for name in (metric.removesuffix(": rms error") for metric in metrics if metric.endswith(": rms error")):
            row = (_with_interval(metrics, f"{name}: {error}") for error in ("rms error", "mean error"))
            columns.add_row(f"  {name}", *row)
    return columns


def _with_interval(metrics: dict[str, Record], name: str) -> Text:
    if name not in metrics:
        return Text("")
    value, low, high = (metrics[key].value or 0.0 for key in (name, f"{name}, from", f"{name}, to"))
    # Error bars that are too wide miss a limit of their own.
    missed = any(record.misses for metric, record in metrics.items() if metric.partition(",")[0] == name)
    return Text.assemble((f"{value:.3g}", "red" if missed else ""), f" ({low:.2f}, {high:.2f})")


SUITE = Suite(measure, table, share=180)
