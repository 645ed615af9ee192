"""Run time of every model: value, and value with the gradient by its parameters."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from time import perf_counter

import torch
from torch import Tensor

from matest.benchmark.instruments import table4
from matest.benchmark.instruments.passes import element_wise, heavy, product, seconds
from matest.benchmark.instruments.timing import TILE, forward, forward_and_backward, no_compiler, random_directions
from matest.benchmark.record import Progress, Record
from matest.brdf import MODELS, Brdf, model, variants

PAIRS, PAIRS_QUICK = 1_000_000, 100_000
# Targets: gradient against value, and a value of Cook-Torrance against the element-wise passes it needs.
GRADIENT_LIMIT, PASS_LIMIT, PASS_LIMIT_OF = 4.0, 3.0, "cook-torrance"


def run(quick: bool, progress: Progress) -> Iterator[Record]:
    """Records of every model and every choice of its options, in float32 and with as many threads as torch takes.

    A quick run leaves out other options than the default, and what torch compiles.
    """
    if quick:
        yield from _all([name for name in variants() if name in MODELS], PAIRS_QUICK, 0.0, progress)
    else:
        yield from _all(variants(), PAIRS, math.inf, progress)


def within(seconds: float, progress: Progress) -> Iterator[Record]:
    """The same, but no model is compiled once so many seconds have passed."""
    yield from _all(variants(), PAIRS, seconds, progress)


def _all(expressions: list[str], pairs: int, seconds: float, progress: Progress) -> Iterator[Record]:
    end = perf_counter() + seconds
    yield Record("models", "all", "threads", torch.get_num_threads(), "1", "higher")
    for number, expression in enumerate(expressions):
        progress(expression, number, len(expressions))
        yield from measure(expression, pairs, compiled=expression in MODELS and perf_counter() < end)
    yield from table4.run(pairs, progress)


def measure(expression: str, pairs: int, compiled: bool) -> Iterator[Record]:
    """Time one model on random directions above the horizon, with scalar parameters that record derivatives.

    Times are given per pair of directions and as a multiple of `product`, cut into the same tiles: once tile by tile,
    once with all pairs in one call, once compiled. `compiled` asks for the last. Sums over many facets are timed on a
    tenth of the pairs, tile by tile only: they hold hundreds of numbers for each pair.
    """
    brdf = model(expression)[0]
    leaves = {name: value.float().requires_grad_() for name, value in brdf.parameters.items()}
    brdf = brdf.replace(leaves)
    whole = not heavy(brdf)
    modes = {"tiled": TILE, "one call": pairs} if whole else {"tiled": TILE}
    n = pairs if whole else pairs // 10
    wi, wo = random_directions(n)

    yield Record("models", expression, "pairs", n, "1", "higher")
    for mode, tile in modes.items():
        times = seconds(product(n, tile), forward(brdf, wi, wo, tile), forward_and_backward(brdf, wi, wo, tile))
        yield from _times(expression, mode, times, n, GRADIENT_LIMIT)
        if mode == "tiled":
            yield from _passes(expression, brdf, wi[:TILE], wo[:TILE], times[0] / n, times[1] / n)
    if compiled and whole:
        yield from _compiled(expression, brdf, wi, wo)


def _times(expression: str, mode: str, times: list[float], n: int, limit: float | None) -> Iterator[Record]:
    one_pass, forward, both = times
    for metric, time in (("forward", forward), ("forward + backward", both)):
        yield Record("models", expression, f"{mode} {metric}", time / one_pass, "pass")
        yield Record("models", expression, f"{mode} {metric} time", 1e9 * time / n, "ns")
    yield Record("models", expression, f"{mode} gradient", both / forward, "forward", limit=limit)


def _passes(expression: str, brdf: Brdf, wi: Tensor, wo: Tensor, one_pass: float, forward: float) -> Iterator[Record]:
    """A value against the element-wise passes it needs: counted, and each timed by itself on the same numbers."""
    written, own = element_wise(lambda: brdf(wi, wo))
    passes = written / len(wi)
    limit = PASS_LIMIT if brdf.name == PASS_LIMIT_OF else None
    yield Record("models", expression, "passes", passes, "1")
    yield Record("models", expression, "time per pass", forward / (passes * one_pass), "pass", limit=limit)
    yield Record("models", expression, "time of its own passes", forward * len(wi) / own, "1", limit=limit)


def _compiled(expression: str, brdf: Brdf, wi: Tensor, wo: Tensor) -> Iterator[Record]:
    if not (note := no_compiler()):
        torch.compiler.reset()
        evaluate = torch.compile(brdf.__call__)
        n = len(wi)
        try:
            with warnings.catch_warnings(action="ignore"):
                times = seconds(product(n, n), forward(evaluate, wi, wo, n), forward_and_backward(evaluate, wi, wo, n))
        except RuntimeError as error:
            note = f"torch.compile failed: {str(error).splitlines()[0]}"
        else:
            yield from _times(expression, "compiled", times, n, None)
            return
    yield Record("models", expression, "compiled forward", None, "pass", note=note)
