"""Run time of every model: value, and value with the gradient by its parameters."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from time import perf_counter

import torch
from rich.console import Group
from rich.text import Text

from matest.benchmark.instruments.passes import (
    TILE,
    Evaluate,
    element_wise,
    forward,
    heavy,
    no_compiler,
    product,
    random_directions,
    seconds,
)
from matest.benchmark.suite import Effort, Progress, Record, Suite
from matest.benchmark.suites import table4
from matest.benchmark.tables import by_case, case_name, figure, largest, page, ruled
from matest.brdf import MODELS, model, variants

# Pairs of directions.
PAIRS = 1_000_000
PAIRS_QUICK = 100_000
# Gradient against value, at most.
GRADIENT_LIMIT = 4.0
# A value against the element-wise passes it needs, at most, and the model that is held to it.
PASS_LIMIT = 3.0
PASS_LIMIT_OF = "cook-torrance"
_METRICS = ("forward time", "forward", "forward + backward time", "forward + backward", "gradient")
_PASSES = ("passes", "time per pass", "time of its own passes")


def measure(effort: Effort, progress: Progress) -> Iterator[Record]:
    """Records of every model and every choice of its options, in float32 and with as many threads as torch takes.

    A quick run leaves out other options than the default, and what torch compiles; others compile no model any more
    once their time is over.
    """
    pairs = PAIRS_QUICK if effort.quick else PAIRS
    expressions = [name for name in variants() if not effort.quick or name in MODELS]
    end = perf_counter() + (0.0 if effort.quick else effort.seconds)
    yield Record("models", "all", "threads", torch.get_num_threads(), "1", "higher")
    for number, expression in enumerate(expressions):
        progress(expression, number, len(expressions))
        yield from times_of(expression, pairs, compiled=expression in MODELS and perf_counter() < end)
    yield from table4.measure(pairs, progress)


def times_of(expression: str, pairs: int, compiled: bool) -> Iterator[Record]:
    """Time one model on random directions above the horizon, with scalar parameters that record derivatives.

    Times are given per pair of directions and as a multiple of `product`, cut into the same tiles: once tile by tile,
    once with all pairs in one call, once compiled. `compiled` asks for the last. Sums over many facets are timed on a
    tenth of the pairs, tile by tile only: they hold hundreds of numbers for each pair.
    """
    brdf = model(expression)[0]
    brdf = brdf.replace({name: value.float().requires_grad_() for name, value in brdf.parameters.items()})
    whole = not heavy(brdf)
    n = pairs if whole else pairs // 10
    wi, wo = random_directions(n)

    def timed(mode: str, evaluate: Evaluate, tile: int, limit: float | None = GRADIENT_LIMIT) -> Iterator[Record]:
        """Value, and value with gradient, with all tiles; of the first tile its passes."""
        runs = (forward(evaluate, wi, wo, tile), forward(evaluate, wi, wo, tile, backward=True))
        one_pass, value, both = seconds(product(n, tile), *runs)
        for metric, time in (("forward", value), ("forward + backward", both)):
            yield Record("models", expression, f"{mode} {metric}", time / one_pass, "pass")
            yield Record("models", expression, f"{mode} {metric} time", 1e9 * time / n, "ns")
        yield Record("models", expression, f"{mode} gradient", both / value, "forward", limit=limit)
        if mode == "tiled":
            written, needed = element_wise(lambda: brdf(wi[:tile], wo[:tile]))
            share, passes = len(wi[:tile]) / n, written / len(wi[:tile])
            held = PASS_LIMIT if brdf.name == PASS_LIMIT_OF else None
            yield Record("models", expression, "passes", passes, "1")
            yield Record("models", expression, "time per pass", value / one_pass / passes, "pass", limit=held)
            yield Record("models", expression, "time of its own passes", value * share / needed, "1", limit=held)

    yield Record("models", expression, "pairs", n, "1", "higher")
    yield from timed("tiled", brdf, TILE)
    if whole:
        yield from timed("one call", brdf, n)
    if whole and compiled:
        torch.compiler.reset()
        note = no_compiler()
        try:
            if not note:
                with warnings.catch_warnings(action="ignore"):
                    yield from list(timed("compiled", torch.compile(brdf.__call__), n, limit=None))
        except RuntimeError as error:
            note = f"torch.compile failed: {str(error).splitlines()[0]}"
        if note:
            yield Record("models", expression, "compiled forward", None, "pass", note=note)


def table(records: Sequence[Record]) -> Group:
    """Times of every model: tile by tile, in one call, compiled; then its element-wise passes; then Table 4."""
    cases = by_case([record for record in records if not record.case.startswith((table4.CASE, table4.WITHOUT))])
    threads = cases.pop("all")["threads"].value
    times = ruled("", "forward\nns", "forward\npasses", "+backward\nns", "+backward\npasses", "ratio")
    passes = ruled("", "passes", "time\nper pass", "time /\nown passes")
    for case, metrics in cases.items():
        times.add_row(case_name(case))
        for mode in ("tiled", "one call", "compiled"):
            row = [metrics.get(f"{mode} {metric}") for metric in _METRICS]
            if any(row):
                times.add_row(f"  {mode}", *map(figure, row))
        passes.add_row(case_name(case), *(figure(metrics[metric]) for metric in _PASSES))
    about = (
        f"{largest(records, 'pairs'):,} pairs of directions (a tenth for sums over facets), float32, "
        f"threads: {threads}. Per pair: forward is the value, +backward also its gradient by the "
        f"parameters, ratio the second to the first. A pass is one element-wise product of two tensors, "
        f"in the same tiles of {TILE:,} (tiled) or whole."
    )
    legend = (
        "Passes: numbers that operations write, per pair. Time per pass: tiled forward / (passes × the pass above). "
        "Own passes: the time of the same operations alone."
    )
    return page(about, times, "", Text(legend), "", passes, *table4.tables(records), records=records)


SUITE = Suite(measure, table, share=170)
