"""Time to 1 % in every parameter against other solvers, on the same samples and noise, preparation included."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import torch
from rich.console import Group
from rich.text import Text

import matest
from matest.benchmark import hand_written, solvers
from matest.benchmark.photographs import MATERIALS, lights
from matest.benchmark.record import Progress, Record
from matest.benchmark.simulated import CLEAN, IRRADIANCE, Draw
from matest.benchmark.tables import by_case, case_name, figure, notes, ruled
from matest.benchmark.task import CLOSE, Task, Trace, Values, distance
from matest.brdf import model
from matest.capture import Capture
from matest.capture.photometry import Noise
from matest.scene import DirectionalLight, Points, Scene
from matest.scene.surface import from_sphere
from matest.shader import render_image, shade

IMAGES = 12
SIZE, SIZE_QUICK = 256, 64
ROUNDS = 3
# Adam's learning rates that are tried; what the search costs is not counted.
RATES = (0.01, 0.03, 0.1, 0.3)
BATCH = 16_384
# A run of Adam ends after so many seconds.
PATIENCE, PATIENCE_QUICK = 60.0, 3.0
# Least times faster than each.
LIMITS = {"adam": 50.0, "adam, mini-batches": 50.0, "l-bfgs": 15.0, "least_squares": 15.0, "levenberg-marquardt": 2.0}
HAND_WRITTEN = {"oren-nayar": hand_written.oren_nayar, "cook-torrance": hand_written.cook_torrance}


def run(quick: bool, progress: Progress) -> Iterator[Record]:
    """Records of the models that have a hand-written peer."""
    for expression in HAND_WRITTEN:
        capture, task = samples(expression, SIZE_QUICK if quick else SIZE)
        yield from measure(expression, capture, task, PATIENCE_QUICK if quick else PATIENCE, progress)


def samples(expression: str, size: int) -> tuple[Capture, Task]:
    """A sphere in 12 photographs in memory, for matest; the same samples as tensors, for its peers."""
    values = {name: torch.tensor(value, dtype=torch.float64) for name, value in MATERIALS[expression].items()}
    material = model(expression)[0].replace(values)
    surface = from_sphere((size, size), (size / 2, size / 2), 0.46 * size, None)
    irradiance = torch.full((3,), IRRADIANCE, dtype=torch.float64)
    lamps = tuple((DirectionalLight(torch.from_numpy(toward), irradiance),) for toward in lights(IMAGES))
    scene = Scene(surface, lamps, torch.zeros(IMAGES, 3, dtype=torch.float64))
    images = [render_image(scene, k, material, dtype=torch.float64).numpy().reshape(-1, 3) for k in range(IMAGES)]
    radiance = tuple(np.ascontiguousarray(image[surface.pixels]) for image in images)
    capture = Draw(1, material, scene, radiance, Noise(0.002, 2e-4), 0.0, 0.9).photograph(CLEAN)
    found = capture.samples()
    batch = next(found.batches(len(found)))
    # The peers know the true noise, and start in the middle of the domain.
    weight = batch.weight(shade(material, batch.points))
    free = tuple(name for name in material.declared if name in values and name != "f0")
    middle = {name: (d.domain.lower + d.domain.upper) / 2 for name in free if (d := material.declared[name])}
    return capture, Task(model(expression)[0].replace(middle), free, batch.points, batch.radiance, weight)


def measure(expression: str, capture: Capture, task: Task, patience: float, progress: Progress) -> Iterator[Record]:
    """Times of matest and of every peer, all after a first run that is not counted."""
    prepare = HAND_WRITTEN[expression]
    optimum = best(task, prepare)
    yield Record("peers", expression, "samples", len(task.radiance), "1", "higher")
    progress(f"{expression}: matest")
    seconds, off = _matest(expression, capture, optimum)
    yield Record("peers", expression, "matest", seconds, "s")
    note = "largest relative distance of a parameter from the optimum"
    yield Record("peers", expression, "distance", off, "1", limit=CLOSE, note=note)
    runs: dict[str, Callable[[], tuple[float | None, str]]] = {
        "adam": lambda: _adam(task, optimum, None, patience),
        "adam, mini-batches": lambda: _adam(task, optimum, BATCH, patience),
        "l-bfgs": lambda: _shortest(lambda: solvers.lbfgs(task), optimum),
        "least_squares": lambda: _shortest(lambda: solvers.least_squares(task), optimum),
        "levenberg-marquardt": lambda: _shortest(lambda: hand_written.levenberg_marquardt(task, prepare), optimum),
    }
    for peer, once in runs.items():
        progress(f"{expression}: {peer}")
        taken, note = once()
        yield Record("peers", expression, peer, taken, "s", note=note)
        ratio = None if taken is None else taken / seconds
        yield Record("peers", expression, f"{peer} / matest", ratio, "1", "higher", LIMITS[peer], note)


def best(task: Task, prepare: Callable[[Points], hand_written.Model]) -> Values:
    """The optimum of the likelihood, in double precision, from the truth."""
    known = {name: torch.tensor(value) for name, value in MATERIALS[task.start.expression].items()}
    exact = replace(task.double(), start=task.start.replace(known))
    return hand_written.levenberg_marquardt(exact, prepare).values[-1]


def _matest(expression: str, capture: Capture, optimum: Values) -> tuple[float, float]:
    """The shortest time of an estimate from the capture, and how far it is from the optimum."""
    held = {"f0": 0.04} if expression == "cook-torrance" else {}
    times = []
    for _ in range(ROUNDS + 1):
        start = time.perf_counter()
        found = matest.estimate(capture, expression, fix=held)
        times.append(time.perf_counter() - start)
    return min(times[1:]), distance(found.material.parameters, optimum)


def _shortest(once: Callable[[], Trace], optimum: Values) -> tuple[float | None, str]:
    """The shortest time to the optimum; None if the solver never gets there."""
    once()
    traces = [once() for _ in range(ROUNDS)]
    found = [arrived for trace in traces if (arrived := trace.arrival(optimum)) is not None]
    if found:
        return min(found), f"{len(traces[0].values)} iterations in all"
    return None, f"never within {CLOSE:.0%}: ends {distance(traces[0].values[-1], optimum):.2g} from the optimum"


def _adam(task: Task, optimum: Values, batch: int | None, patience: float) -> tuple[float | None, str]:
    """The shortest time over learning rates; None if none gets there."""
    solvers.adam(task, optimum, RATES[0], batch, 0.0)
    shortest, note = math.inf, f"never within {CLOSE:.0%} in {patience:g} s at any learning rate"
    for rate in RATES:
        # No use in going on for much longer than the best so far has taken.
        trace = solvers.adam(task, optimum, rate, batch, min(patience, 2 * shortest))
        arrived = trace.arrival(optimum) if trace.settled(optimum, solvers.SETTLED) else None
        if arrived is not None and arrived < shortest:
            size = "all samples" if batch is None else f"{batch:,} samples"
            shortest, note = arrived, f"learning rate {rate:g}, {size} a step"
    return (shortest, note) if math.isfinite(shortest) else (None, note)


def peers_table(found: list[Record]) -> Group:
    """Seconds of everyone, and how many times as long each peer takes as matest."""
    table = ruled("", "seconds", "times\nmatest's", "at\nleast")
    for case, metrics in by_case(found).items():
        table.add_row(case_name(case))
        table.add_row("  matest", figure(metrics["matest"]))
        for peer, limit in LIMITS.items():
            table.add_row(f"  {peer}", figure(metrics[peer]), figure(metrics[f"{peer} / matest"]), f"{limit:g}")
    count = max(int(record.value or 0) for record in found if record.metric == "samples")
    about = (
        f"{count:,} samples of {IMAGES} photographs of a sphere: time until every parameter stays within {CLOSE:.0%} "
        "of the optimum of the likelihood. Peers get the samples with their geometry and true noise, and start in the "
        "middle of the domain; matest starts from the photographs in memory. Adam: the best learning rate. "
        "Levenberg-Marquardt: written by hand for the one model, with its Jacobian."
    )
    return Group(Text(about), "", table, *notes(found))
