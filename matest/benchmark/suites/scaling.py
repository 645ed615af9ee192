"""How the time of an estimate grows with pixels, images and estimated parameters, on captures in memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text
from scipy.stats import linregress

import matest
from matest.benchmark.instruments.passes import timed
from matest.benchmark.instruments.photographs import FIX, MATERIALS, Sensor, material_of, ring, sphere, subject
from matest.benchmark.suite import Effort, Progress, Record, Suite
from matest.benchmark.suites import limits
from matest.benchmark.tables import by_case, figure, limit, page, ruled
from matest.capture import Capture

MODEL = "oren-nayar"
# Images of the series of pixels and of parameters; that of images begins with as many.
IMAGES = 12
# Pixels on a side of the images of the first series, each twice as many in all; the other series have the first side.
SIDES = (512, 724, 1024, 1448)
SIDES_QUICK = (64, 91, 128, 181)
# Numbers of images, as multiples of the first.
TIMES = (1, 2, 4, 8)
# Estimates, of which the shortest counts.
ROUNDS = 2
ROUNDS_QUICK = 1
# Pixels on a side of images so small that only the cost that every estimate has is left.
TINY = 16
# Exponents of pixels and of images, at most.
LIMIT = 1.05
# Cook-Torrance's parameters, fixed at their true values but for more and more of them.
GLOSSY = "cook-torrance"
FREED = (("slope",), ("slope", "diffuse"), ("slope", "diffuse", "specular"))

# The size of a workload, its photographs, and the parameters that are fixed.
Workload = tuple[int, Capture, Mapping[str, Any]]


def power_law(sizes: Sequence[float], times: Sequence[float]) -> Any:
    """time ∝ size^`slope`, by least squares between the logarithms; `stderr` is the exponent's standard error."""
    return linregress(np.log(sizes), np.log(times))


def measure(effort: Effort, progress: Progress) -> Iterator[Record]:
    """Records of the three series."""
    sides, rounds = (SIDES_QUICK, ROUNDS_QUICK) if effort.quick else (SIDES, ROUNDS)
    least = _shortest(spheres(MODEL, IMAGES, TINY), MODEL, {}, ROUNDS + 1)

    captures = (spheres(MODEL, IMAGES, side) for side in sides)
    growing: Iterator[Workload] = ((len(capture.scene.surface), capture, {}) for capture in captures)
    times, capture = _times("pixels", MODEL, growing, len(sides), rounds, progress)
    yield from _series("pixels", f"{IMAGES} images", times, least, LIMIT)
    per_value = max(times.values()) / (len(capture.samples()) * capture.channels)
    yield Record("scaling", "pixels", "time per sample", per_value / limits.machine().tiled, "pass")
    # How long the same takes that only copies the stored pixels, two bytes a channel.
    copies = per_value / (2 * limits.machine().copy)
    yield Record("scaling", "pixels", "time / copying the pixels", copies, "1")

    # Of all lights every so many, so that they stay on all sides.
    steps = (TIMES[-1] // multiple for multiple in TIMES)
    captures = (spheres(MODEL, IMAGES * TIMES[-1], sides[0], step) for step in steps)
    times, capture = _times("images", MODEL, ((len(one), one, {}) for one in captures), len(TIMES), rounds, progress)
    pixels = f"{len(capture.scene.surface):,} pixels"
    yield from _series("images", pixels, times, least, LIMIT)

    least = _shortest(spheres(GLOSSY, IMAGES, TINY), GLOSSY, FIX[GLOSSY], ROUNDS + 1)
    capture, truth = spheres(GLOSSY, IMAGES, sides[0]), MATERIALS[GLOSSY]
    fewer = (
        (sum(np.size(truth[name]) for name in free), capture, {name: truth[name] for name in truth if name not in free})
        for free in FREED
    )
    times, _ = _times("parameters", GLOSSY, fewer, len(FREED), rounds, progress)
    yield from _series("parameters", f"{IMAGES} images of {pixels}", times, least)


def _times(
    case: str, expression: str, workloads: Iterable[Workload], count: int, rounds: int, progress: Progress
) -> tuple[dict[int, float], Capture]:
    """Seconds of every size, and the last photographs."""
    times = {}
    for number, (size, capture, fix) in enumerate(workloads):
        progress(case, number, count)
        times[size] = _shortest(capture, expression, fix, rounds)
    return times, capture


def _series(
    case: str, of: str, times: Mapping[int, float], least: float, most: float | None = None
) -> Iterator[Record]:
    """Times by size, the time of an estimate of next to nothing, and the exponent."""
    law = power_law(list(times), list(times.values()))
    for size, seconds in times.items():
        yield Record("scaling", case, f"time of {size:,}", seconds, "s")
    yield Record("scaling", case, "least time", least, "s")
    note = (
        f"exponent ± {law.stderr:.2f}, {of}; {TINY}×{TINY} pixels take {least / min(times.values()):.0%} of the first"
    )
    yield Record("scaling", case, "exponent", float(law.slope), "1", limit=most, note=note)
    yield Record("scaling", case, "exponent, standard error", float(law.stderr), "1")


def spheres(expression: str, images: int, side: int, step: int = 1) -> Capture:
    """Every `step`-th of some photographs in memory, in square images of `side` pixels."""
    return subject(sphere(side), ring(images)[::step], material_of(expression), Sensor()).photograph()


def _shortest(capture: Capture, expression: str, fix: Mapping[str, Any], rounds: int) -> float:
    """Seconds of the quickest of some estimates."""
    return min(timed(lambda: matest.estimate(capture, expression, fix=dict(fix)))[1] for _ in range(rounds))


def table(records: Sequence[Record]) -> Group:
    """Times of every series, and the exponent of its power law."""
    parts: list[RenderableType] = []
    cases = by_case(records)
    for case, metrics in cases.items():
        times = {name.removeprefix("time of "): r for name, r in metrics.items() if name.startswith("time of ")}
        series = ruled(case, *times, f"{TINY}×{TINY}\npixels", "exponent", "limit")
        error = metrics["exponent, standard error"].value
        exponent = figure(metrics["exponent"]).append(f" ± {error:.2f}")
        seconds = [*map(figure, times.values()), figure(metrics["least time"])]
        series.add_row("seconds", *seconds, exponent, limit(metrics["exponent"]))
        parts += [series, ""]
    passes, copies = (cases["pixels"][name].value for name in ("time per sample", "time / copying the pixels"))
    about = (
        f"Time of matest.estimate on spheres in memory: {MODEL} with {IMAGES} images of more and more pixels, and more "
        f"and more images of the fewest; {GLOSSY} with the other parameters held. Exponent: time ∝ size to this power. "
        f"{TINY}×{TINY} pixels: what an estimate takes that has next to none, and what keeps exponents low."
    )
    legend = (
        f"The most pixels take {passes:.0f} element-wise passes a value, {copies:.0f} times copying the stored pixels."
    )
    return page(about, *parts, Text(legend), records=records)


SUITE = Suite(measure, table)
