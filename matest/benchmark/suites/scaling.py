"""How the time of an estimate grows with pixels, images and estimated parameters, on captures in memory."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from rich.console import Group, RenderableType
from rich.text import Text

import matest
from matest.benchmark.instruments.photographs import MATERIALS, lights
from matest.benchmark.instruments.simulated import CLEAN, IRRADIANCE, Draw
from matest.benchmark.record import Progress, Record
from matest.benchmark.suites import limits
from matest.benchmark.tables import by_case, figure, notes, ruled
from matest.brdf import model
from matest.capture import Capture
from matest.photographs.noise import Noise
from matest.scene import DirectionalLight, Scene
from matest.scene.surface import from_sphere
from matest.shading import render_image

Values = dict[str, Any]

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
# Cook-Torrance's parameters, held at their true values but for more and more of them.
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
    left = y - exponent * x
    return PowerLaw(exponent, math.sqrt(float(left @ left) / (len(x) - 2) / float(x @ x)))


def run(quick: bool, progress: Progress) -> Iterator[Record]:
    """Records of the three series."""
    sides, rounds = (SIDES_QUICK, ROUNDS_QUICK) if quick else (SIDES, ROUNDS)
    truth = MATERIALS[MODEL]
    constant = _shortest(photographs(MODEL, truth, images=IMAGES, side=TINY), MODEL, {}, ROUNDS + 1)[0]
    pixels = {}
    for number, side in enumerate(sides):
        progress("pixels", number, len(sides))
        capture = photographs(MODEL, truth, images=IMAGES, side=side)
        pixels[len(capture.scene.surface)], samples = _shortest(capture, MODEL, {}, rounds)
    yield from _series("pixels", f"{IMAGES} images", pixels, constant, LIMIT)
    # Per sample, in element-wise products of as many numbers as it has channels.
    passes = max(pixels.values()) / (samples * capture.channels * limits.machine().tiled)
    yield Record("scaling", "pixels", "time per sample", passes, "pass")
    # How long the same takes that only copies the stored pixels, two bytes a channel.
    copies = max(pixels.values()) / (samples * capture.channels * 2 * limits.machine().copy)
    yield Record("scaling", "pixels", "time / copying the pixels", copies, "1")

    images = {}
    capture = photographs(MODEL, truth, images=IMAGES * TIMES[-1], side=sides[0])
    for number, times in enumerate(TIMES):
        progress("images", number, len(TIMES))
        images[IMAGES * times], _ = _shortest(every(capture, TIMES[-1] // times), MODEL, {}, rounds)
    yield from _series("images", f"{len(capture.scene.surface):,} pixels", images, constant, LIMIT)

    parameters = {}
    truth = MATERIALS[GLOSSY]
    capture = photographs(GLOSSY, truth, images=IMAGES, side=sides[0])
    constant = _shortest(photographs(GLOSSY, truth, images=IMAGES, side=TINY), GLOSSY, {"f0": 0.04}, ROUNDS + 1)[0]
    for number, free in enumerate(FREED):
        progress("parameters", number, len(FREED))
        held = {name: value for name, value in truth.items() if name not in free}
        count = sum(len(value) if isinstance(value, list) else 1 for value in map(truth.get, free))
        parameters[count], _ = _shortest(capture, GLOSSY, held, rounds)
    yield from _series("parameters", f"{IMAGES} images of {len(capture.scene.surface):,} pixels", parameters, constant)


def _series(
    case: str, of: str, times: Mapping[int, float], constant: float, limit: float | None = None
) -> Iterator[Record]:
    law = power_law(list(times), list(times.values()))
    for size, taken in times.items():
        yield Record("scaling", case, f"time of {size:,}", taken, "s")
    yield Record("scaling", case, "least time", constant, "s")
    note = (
        f"exponent ± {law.std:.2f}, {of}; {TINY}×{TINY} pixels take {constant / min(times.values()):.0%} of the first"
    )
    yield Record("scaling", case, "exponent", law.exponent, "1", limit=limit, note=note)
    yield Record("scaling", case, "exponent, standard error", law.std, "1")


def photographs(expression: str, truth: Values, *, images: int, side: int) -> Capture:
    """A sphere of a known material in memory, as 16-bit RGB with camera noise, one distant light a photograph."""
    values = {name: torch.tensor(value, dtype=torch.float64) for name, value in truth.items()}
    material = model(expression)[0].replace(values)
    surface = from_sphere((side, side), (side / 2, side / 2), 0.46 * side, None)
    irradiance = torch.full((3,), IRRADIANCE, dtype=torch.float64)
    lamps = tuple((DirectionalLight(torch.from_numpy(toward), irradiance),) for toward in lights(images))
    scene = Scene(surface, lamps, torch.zeros(images, 3, dtype=torch.float64))
    radiance = tuple(
        np.ascontiguousarray(render_image(scene, number, material).numpy().reshape(-1, 3)[surface.pixels])
        for number in range(images)
    )
    return Draw(1, material, scene, radiance, Noise(0.002, 2e-4), 0.0, 0.9).photograph(CLEAN)


def every(capture: Capture, step: int) -> Capture:
    """Every `step`-th photograph of a capture, so that the lights stay on all sides."""
    whole = capture.photographs
    photographs = replace(
        whole,
        scene=replace(whole.scene, lights=whole.scene.lights[::step], ambient=whole.scene.ambient[::step]),
        stored=whole.stored[::step],
        exposures=whole.exposures[::step],
        names=whole.names[::step],
    )
    return replace(capture, photographs=photographs)


def _shortest(capture: Capture, expression: str, held: Values, rounds: int) -> tuple[float, int]:
    """The shortest time of an estimate, and its number of samples."""
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        found = matest.estimate(capture, expression, fix=held)
        times.append(time.perf_counter() - start)
    return min(times), found.fit.samples


def scaling_table(found: list[Record]) -> Group:
    """Times of every series, and the exponent of its power law."""
    parts: list[RenderableType] = []
    for case, metrics in by_case(found).items():
        times = {name.removeprefix("time of "): r for name, r in metrics.items() if name.startswith("time of ")}
        table = ruled(case, *times, f"{TINY}×{TINY}\npixels", "exponent", "limit")
        error = metrics["exponent, standard error"].value
        exponent = figure(metrics["exponent"]).append(f" ± {error:.2f}")
        limit = metrics["exponent"].limit
        shown = "" if limit is None else f"{limit:g}"
        table.add_row("seconds", *map(figure, times.values()), figure(metrics["least time"]), exponent, shown)
        parts += [table, ""]
    metrics = by_case(found)["pixels"]
    passes, copies = (metrics[name].value for name in ("time per sample", "time / copying the pixels"))
    about = (
        f"Time of matest.estimate on spheres in memory: {MODEL} with {IMAGES} images of more and more pixels, and more "
        f"and more images of the fewest; {GLOSSY} with the other parameters held. Exponent: time ∝ size to this power. "
        f"{TINY}×{TINY} pixels: what an estimate takes that has next to none, and what keeps exponents low."
    )
    legend = (
        f"The most pixels take {passes:.0f} element-wise passes a value, {copies:.0f} times copying the stored pixels."
    )
    return Group(Text(about), "", *parts, Text(legend), *notes(found))
