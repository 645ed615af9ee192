"""How the time of an estimate grows with pixels, images and estimated parameters, on captures in memory."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

import matest
from matest.benchmark.instruments.passes import timed
from matest.benchmark.instruments.photographs import FIX, MATERIALS, Sensor, material_of, ring, sphere, subject
from matest.benchmark.record import Progress, Record
from matest.benchmark.suite import Effort, Suite
from matest.benchmark.suites import limits
from matest.benchmark.tables import by_case, figure, limit, page, ruled
from matest.capture import Capture

MODEL = "oren-nayar"
# Images of the series of pixels, and sides of its square images. The series of images begins at the same number, all of
# the first side; that of parameters has the first side too.
IMAGES = 12
SIDES, SIDES_QUICK = (512, 724, 1024, 1448), (64, 91, 128, 181)
TIMES = (1, 2, 4, 8)
ROUNDS, ROUNDS_QUICK = 2, 1
# A capture so small that only the cost that every estimate has is left.
TINY = 16
# Exponents of pixels and of images, at most.
LIMIT = 1.05
# Cook-Torrance's parameters, fixed at their true values but for more and more of them.
GLOSSY = "cook-torrance"
FREED = (("slope",), ("slope", "diffuse"), ("slope", "diffuse", "specular"))


@dataclass(frozen=True)
class PowerLaw:
    """time ∝ size^exponent, by least squares between the logarithms; `std` is the exponent's standard error."""

    exponent: float
    std: float


def power_law(sizes: Sequence[float], times: Sequence[float]) -> PowerLaw:
    """Fit a power law to three points or more."""
    x, y = np.log(sizes), np.log(times)
    x, y = x - x.mean(), y - y.mean()
    exponent = float(x @ y / (x @ x))
    residual = y - exponent * x
    return PowerLaw(exponent, math.sqrt(float(residual @ residual) / (len(x) - 2) / float(x @ x)))


def measure(effort: Effort, progress: Progress) -> Iterator[Record]:
    """Records of the three series."""
    sides, rounds = (SIDES_QUICK, ROUNDS_QUICK) if effort.quick else (SIDES, ROUNDS)
    least = _shortest(spheres(MODEL, IMAGES, TINY), MODEL, {}, ROUNDS + 1)
    yield from _pixels(sides, rounds, least, progress)
    yield from _images(sides[0], rounds, least, progress)
    yield from _parameters(sides[0], rounds, progress)


def _pixels(sides: Sequence[int], rounds: int, least: float, progress: Progress) -> Iterator[Record]:
    times = {}
    for number, side in enumerate(sides):
        progress("pixels", number, len(sides))
        capture = spheres(MODEL, IMAGES, side)
        times[len(capture.scene.surface)] = _shortest(capture, MODEL, {}, rounds)
    yield from _series("pixels", f"{IMAGES} images", times, least, LIMIT)
    per_value = max(times.values()) / (len(capture.samples()) * capture.channels)
    yield Record("scaling", "pixels", "time per sample", per_value / limits.machine().tiled, "pass")
    # How long the same takes that only copies the stored pixels, two bytes a channel.
    copies = per_value / (2 * limits.machine().copy)
    yield Record("scaling", "pixels", "time / copying the pixels", copies, "1")


def _images(side: int, rounds: int, least: float, progress: Progress) -> Iterator[Record]:
    times, capture = {}, spheres(MODEL, IMAGES * TIMES[-1], side)
    for number, multiple in enumerate(TIMES):
        progress("images", number, len(TIMES))
        times[IMAGES * multiple] = _shortest(every(capture, TIMES[-1] // multiple), MODEL, {}, rounds)
    yield from _series("images", f"{len(capture.scene.surface):,} pixels", times, least, LIMIT)


def _parameters(side: int, rounds: int, progress: Progress) -> Iterator[Record]:
    times, capture, truth = {}, spheres(GLOSSY, IMAGES, side), MATERIALS[GLOSSY]
    least = _shortest(spheres(GLOSSY, IMAGES, TINY), GLOSSY, FIX[GLOSSY], ROUNDS + 1)
    for number, free in enumerate(FREED):
        progress("parameters", number, len(FREED))
        fix = {name: value for name, value in truth.items() if name not in free}
        count = sum(np.size(truth[name]) for name in free)
        times[count] = _shortest(capture, GLOSSY, fix, rounds)
    yield from _series("parameters", f"{IMAGES} images of {len(capture.scene.surface):,} pixels", times, least)


def _series(
    case: str, of: str, times: Mapping[int, float], least: float, most: float | None = None
) -> Iterator[Record]:
    """Times by size, the time of an estimate of next to nothing, and the exponent."""
    law = power_law(list(times), list(times.values()))
    for size, seconds in times.items():
        yield Record("scaling", case, f"time of {size:,}", seconds, "s")
    yield Record("scaling", case, "least time", least, "s")
    note = f"exponent ± {law.std:.2f}, {of}; {TINY}×{TINY} pixels take {least / min(times.values()):.0%} of the first"
    yield Record("scaling", case, "exponent", law.exponent, "1", limit=most, note=note)
    yield Record("scaling", case, "exponent, standard error", law.std, "1")


def spheres(expression: str, images: int, side: int) -> Capture:
    """Photographs in memory, in square images of `side` pixels."""
    return subject(sphere(side), ring(images), material_of(expression), Sensor()).photograph()


def every(capture: Capture, step: int) -> Capture:
    """Every `step`-th photograph of a capture, so that the lights stay on all sides."""
    whole, kept = capture.photographs, slice(None, None, step)
    scene = replace(
        whole.scene,
        lights=whole.scene.lights[kept],
        ambient=whole.scene.ambient[kept],
        shadows=whole.scene.shadows[kept],
        shadow_edge=whole.scene.shadow_edge[kept],
    )
    photographs = replace(
        whole, scene=scene, stored=whole.stored[kept], exposures=whole.exposures[kept], names=whole.names[kept]
    )
    return replace(capture, photographs=photographs)


def _shortest(capture: Capture, expression: str, fix: Mapping[str, Any], rounds: int) -> float:
    """Seconds of the quickest of some estimates."""
    return min(timed(lambda: matest.estimate(capture, expression, fix=dict(fix)))[1] for _ in range(rounds))


def table(found: Sequence[Record]) -> Group:
    """Times of every series, and the exponent of its power law."""
    parts: list[RenderableType] = []
    cases = by_case(found)
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
    return page(about, *parts, Text(legend), records=found)


SUITE = Suite(measure, table)
