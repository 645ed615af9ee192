"""Errors on many simulated captures against the Cramér-Rao bound, whether 95 % intervals hold, and global optima."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from functools import partial

from rich.console import Group
from rich.text import Text

from matest.benchmark.instruments.pooling import Targets, records
from matest.benchmark.instruments.simulated import CLEAN, Conditions
from matest.benchmark.instruments.trial import Trial, described, trial
from matest.benchmark.record import Progress, Record
from matest.benchmark.tables import by_case, case_name, figure, notes, ruled
from matest.workers import processes

MODELS = ("lambert", "oren-nayar", "oren-nayar-exact", "cook-torrance", "li-torrance")
CAPTURES, CAPTURES_QUICK = 2000, 4
TARGETS = Targets(error=1.05, lowest_coverage=0.93, highest_coverage=0.97)


def run(quick: bool, progress: Progress) -> Iterator[Record]:
    """Records of every model on clean 16-bit captures."""
    yield from figures("efficiency", CLEAN, TARGETS, CAPTURES_QUICK if quick else CAPTURES, progress)


def within(seconds: float, progress: Progress) -> Iterator[Record]:
    """The same of as many captures as so many seconds allow."""
    yield from figures("efficiency", CLEAN, TARGETS, CAPTURES, progress, seconds)


def figures(
    suite: str,
    conditions: Conditions,
    targets: Targets,
    captures: int,
    progress: Progress,
    seconds: float = math.inf,
) -> Iterator[Record]:
    """Records of every model under some conditions. Optima are compared with a grid where nothing spoils the pixels.

    Args:
        suite: name in the records.
        conditions: of the camera.
        targets: limits of the figures.
        captures: of every model.
        progress: called after each.
        seconds: after which no more are begun; every model has the same share.
    """
    with processes(captures) as pool:
        for expression in MODELS:
            one = partial(trial, expression, conditions=conditions, grid=conditions == CLEAN)
            found: list[Trial] = []
            end = time.perf_counter() + seconds / len(MODELS)
            for result in pool.map(one, range(captures)):
                found.append(result)
                progress(expression, len(found), captures)
                if time.perf_counter() > end:
                    break
            yield from records(suite, expression, found, targets)


def again(expression: str, seed: int) -> str:
    """One of the captures once more, as a sentence: to look into a failure that the suite names by its seed."""
    return described(trial(expression, seed))


def efficiency_table(found: list[Record]) -> Group:
    """Pooled errors and coverage with their intervals, optima missed; then parameter by parameter."""
    limits = (TARGETS.lowest_coverage, TARGETS.highest_coverage)
    spoilt = "16-bit images. Limits: error {:g}, coverage {:g} to {:g}.".format(TARGETS.error, *limits)
    return pooled_table(found, spoilt)


def pooled_table(found: list[Record], conditions: str) -> Group:
    """The same under any conditions."""
    pooled = ruled("", "un-\nknowns", "given", "rms error\n/ bound", "coverage", "optima\nmissed")
    single = ruled("", "rms error\n/ bound", "mean error\n/ bound")
    cases = by_case(found)
    for case, metrics in cases.items():
        row = [figure(metrics[name]) for name in ("parameters", "given")]
        row += [_with_interval(metrics, name) for name in ("rms error", "coverage")]
        count = int(metrics["captures"].value or 0)
        pooled.add_row(
            Text.assemble(case_name(case), f"\n  {count:,} captures"), *row, figure(metrics.get("optimum missed"))
        )
        single.add_row(case_name(case))
        for metric in metrics:
            name, _, rest = metric.partition(": ")
            if rest == "rms error":
                row = [_with_interval(metrics, metric), _with_interval(metrics, f"{name}: mean error")]
                single.add_row(f"  {name}", *row)
    counts = sorted({int(metrics["captures"].value or 0) for metrics in cases.values()})
    captures = " to ".join(f"{count:,}" for count in dict.fromkeys((counts[0], counts[-1])))
    about = (
        f"{captures} captures a model, 64×64 pixels: sphere or vase, 1, 3 or 12 lights, one a photograph. {conditions}"
    )
    legend = (
        "Unknowns: those that the samples determine and whose truth lies 3 standard errors from a bound; given: their "
        "share that the estimate names. In brackets the 95 % Monte-Carlo interval."
    )
    return Group(Text(about), "", pooled, "", Text(legend), "", single, *notes(found))


def _with_interval(metrics: dict[str, Record], name: str) -> Text:
    if name not in metrics:
        return Text("")
    value, low, high = (metrics[key].value or 0.0 for key in (name, f"{name}, from", f"{name}, to"))
    # Error bars that are too wide miss a limit of their own.
    missed = any(record.misses for metric, record in metrics.items() if metric.partition(",")[0] == name)
    return Text.assemble((f"{value:.3g}", "red" if missed else ""), f" ({low:.2f}, {high:.2f})")
