"""Error against time, for every estimator on four scenes; preparation included."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import torch
from rich.console import Group
from rich.text import Text

import matest
from matest.benchmark.instruments.curves import Curve, Yardstick
from matest.benchmark.instruments.simulated import sphere, vase
from matest.benchmark.instruments.subjects import GLOSSY, IMAGES, Subject, sphere_of, subject
from matest.benchmark.instruments.task import CLOSE, Task, Trace, Values
from matest.benchmark.record import Progress, Record
from matest.benchmark.rivals import hand_written, renderers, solvers
from matest.benchmark.rivals.renderers import Race
from matest.benchmark.rivals.solvers import PEERS, raced
from matest.benchmark.tables import by_case, case_name, figure, ruled
from matest.brdf import CookTorrance, OrenNayar, preset
from matest.scene import Points

SIZE, SIZE_QUICK = 256, 48
# `precision` of the estimates that make matest's curve; None reads every pixel.
PRECISIONS = (0.1, 0.03, 0.01, 0.003, 0.001, None)
PRECISIONS_QUICK = (0.01, None)
# Seeds of matest's subsamples, whose errors are pooled.
SEEDS, SEEDS_QUICK = 3, 1
RATES, RATES_QUICK = (0.1, 0.03, 0.3), (0.1,)
BATCH = 16_384
PATIENCE, PATIENCE_QUICK = 20.0, 0.5
# Where times are compared: when a quantity of `Step` comes to stay below a limit.
BOUNDS = "to 2 bounds"
EQUAL = {BOUNDS: ("error", 2.0), "to 1 %": ("off", CLOSE)}
# Peers that take less than this share of matest's time beat it.
SLOWER = 1.0
Prepare = Callable[[Points], hand_written.Model]


@dataclass(frozen=True)
class Case:
    """A scene, as large as asked for.

    Attributes:
        make: the subject, from the size of its images.
        prepare: the model for the Levenberg-Marquardt solver written by hand, if there is one.
    """

    make: Callable[[int], Subject]
    prepare: Prepare | None = None


def _rough_vase(size: int) -> Subject:
    material = OrenNayar(albedo=torch.tensor([0.7, 0.5, 0.3]), sigma=torch.tensor(0.6))
    return subject(material, vase(size), [], {"albedo": 0.5, "sigma": math.pi / 4})


def _copper_vase(size: int) -> Subject:
    """The vase of Cook & Torrance, fig. 6b; its colours in numbers, as their source is an optional package."""
    material = CookTorrance(
        diffuse=torch.tensor(0.0), specular=torch.tensor(1.0), slope=torch.tensor(0.2), slope_2=torch.tensor(0.4),
        weight_2=torch.tensor(0.4), f0=torch.tensor([0.95, 0.64, 0.54]), f0_mean=torch.tensor(0.66), lobes="2",
        fresnel="colour-shift",
    )  # fmt: skip
    start = {"f0": 0.5, "slope": 0.1, "slope_2": 0.5, "weight_2": 0.5}
    return subject(material, vase(size), ["diffuse", "specular", "f0_mean"], start)


def _paper_sphere(size: int) -> Subject:
    """Sample #73 of Li & Torrance; of forward scattering light from the viewer's side shows nothing."""
    start = {"k_uds": 0.5, "k_dd": 0.5, "correlation_length": 10.0}
    return subject(preset("laser-paper"), sphere(size), ["f0", "height_rms", "k_fs"], start)


CASES = {
    "oren-nayar vase": Case(_rough_vase, hand_written.oren_nayar),
    "cook-torrance sphere": Case(partial(sphere_of, GLOSSY), hand_written.cook_torrance_smith),
    "copper vase": Case(_copper_vase),
    "laser-paper sphere": Case(_paper_sphere),
}


def run(quick: bool, progress: Progress, against: Collection[str] = PEERS) -> Iterator[Record]:
    """Records of every scene; of the first alone in a quick run."""
    for name, case in list(CASES.items())[: 1 if quick else None]:
        found = case.make(SIZE_QUICK if quick else SIZE)
        yield Record("frontier", name, "samples", len(found.task.radiance), "1", "higher")
        progress(f"{name}: matest")
        own, yardstick = _matest(found, quick)
        yield from figures(name, "matest", own, own)
        for estimator, once in _estimators(found, case.prepare, yardstick, quick).items():
            if raced(estimator, against):
                progress(f"{name}: {estimator}")
                for peer, curve in once().items():
                    yield from figures(name, peer, curve, own)


def _estimators(
    found: Subject, prepare: Prepare | None, yardstick: Yardstick, quick: bool
) -> dict[str, Callable[[], dict[str, Curve]]]:
    """All but matest: each gives its curve, or several."""
    task, patience = found.task, PATIENCE_QUICK if quick else PATIENCE
    rates = RATES_QUICK if quick else RATES

    def second(once: Callable[[], Trace]) -> Curve:
        """The quicker of two runs after one that is not counted."""
        once()
        return Curve([yardstick.run(min((once(), once()), key=lambda trace: trace.seconds[-1]))])

    every: dict[str, Callable[[], dict[str, Curve]]] = {
        "adam": lambda: {"adam": _adam(task, None, rates, yardstick, patience)},
        "adam, mini-batches": lambda: {"adam, mini-batches": _adam(task, BATCH, rates, yardstick, patience)},
        "l-bfgs": lambda: {"l-bfgs": second(lambda: solvers.lbfgs(task))},
        "least_squares": lambda: {"least_squares": second(lambda: solvers.least_squares(task))},
    }
    if prepare is not None:
        solve = partial(hand_written.levenberg_marquardt, task, prepare)
        every["levenberg-marquardt"] = lambda: {"levenberg-marquardt": second(solve)}
    if found.expression == GLOSSY:
        limit = renderers.PATIENCE_QUICK if quick else renderers.PATIENCE
        size = found.capture.scene.surface.shape[0]
        every["mitsuba, dr.jit"] = lambda: of_renderers(renderers.race_of_sphere(size, limit), yardstick)
    return every


def _matest(found: Subject, quick: bool) -> tuple[Curve, Yardstick]:
    """One result a precision, pooled over the seeds, in the shortest time of one; and what to measure all with."""
    precisions, seeds = (PRECISIONS_QUICK, SEEDS_QUICK) if quick else (PRECISIONS, SEEDS)
    results: list[list[Values]] = []
    times: list[float] = []
    # What a process loads and prepares once is not counted, for anyone.
    matest.estimate(found.capture, found.expression, fix=found.fixed)
    for precision in precisions:
        results.append([])
        times.append(math.inf)
        for seed in range(seeds):
            start = time.perf_counter()
            estimate = matest.estimate(found.capture, found.expression, fix=found.fixed, precision=precision, seed=seed)
            times[-1] = min(times[-1], time.perf_counter() - start)
            known = estimate.material.parameters
            results[-1].append({name: known[name].detach() for name in found.task.free})
    # The last has read every pixel.
    yardstick = Yardstick(found.truth, found.bound(), results[-1][0])
    runs = [[yardstick.pooled(*one)] for one in zip(times, results, strict=True)]
    return Curve(runs, f"precisions of {precisions[0]:g} to none asked for, {seeds} seeds each"), yardstick


def _adam(task: Task, batch: int | None, rates: Sequence[float], yardstick: Yardstick, patience: float) -> Curve:
    solvers.adam(task, rates[0], batch, lambda _: True)

    def done(trace: Trace) -> bool:
        return trace.elapsed > patience or trace.settled(yardstick.optimum, solvers.SETTLED, solvers.STILL)

    runs = [yardstick.run(solvers.adam(task, rate, batch, done)) for rate in rates]
    return Curve(runs, f"learning rates {', '.join(f'{rate:g}' for rate in rates)}, the best at every time")


def of_renderers(race: Race | None, yardstick: Yardstick) -> dict[str, Curve]:
    """Mitsuba and Dr.Jit; empty curves with the reason where they are missing."""
    if race is None:
        return {"mitsuba": Curve(note=renderers.MISSING), "dr.jit": Curve(note=renderers.MISSING)}
    quickest = min(race.drjit, key=lambda one: one.trace.seconds[-1])
    return {
        "mitsuba": Curve([yardstick.run(trace) for trace in race.tutorial.values()], "compiled before"),
        "dr.jit": Curve([yardstick.run(quickest.trace)], "compiled before"),
    }


def figures(case: str, estimator: str, curve: Curve, own: Curve) -> Iterator[Record]:
    """Times to equal errors, the error at the end, and the points of the curve."""
    for what, (quantity, limit) in EQUAL.items():
        taken, of_matest = curve.arrival(quantity, limit), own.arrival(quantity, limit)
        yield Record("frontier", case, f"{estimator}: {what}", taken, "s", note=curve.note)
        if estimator != "matest":
            ratio = None if taken is None or of_matest is None else taken / of_matest
            yield Record("frontier", case, f"{estimator}: {what} / matest", ratio, "1", "higher", SLOWER, curve.note)
    yield Record("frontier", case, f"{estimator}: error at the end", curve.end, "1", note=curve.note)
    for number, (seconds, error) in enumerate(curve.points()):
        yield Record("frontier", case, f"{estimator}: point {number}, seconds", seconds, "s")
        yield Record("frontier", case, f"{estimator}: point {number}, error", error, "1")


def frontier_table(found: list[Record]) -> Group:
    """Seconds to equal errors, times matest's, and errors at the end; then where matest loses."""
    table = ruled("", "to 2 ×\nthe bound", "times\nmatest's", "to 1 %", "times\nmatest's", "error at\nthe end")
    lost, missing = [], {}
    for case, metrics in by_case(found).items():
        table.add_row(case_name(case))
        ends = [name for name in metrics if name.endswith(": error at the end")]
        for estimator in (name.removesuffix(": error at the end") for name in ends):
            if metrics[f"{estimator}: error at the end"].value is None:
                missing[estimator] = metrics[f"{estimator}: error at the end"].note
                continue
            row = []
            for what in EQUAL:
                taken, ratio = metrics[f"{estimator}: {what}"], metrics.get(f"{estimator}: {what} / matest")
                row += [_or_never(taken), figure(ratio)]
                if ratio is not None and ratio.misses:
                    lost.append(f"{case}, {estimator}, {what}: in {ratio.value:.2g} of matest's time")
                elif taken.value is not None and metrics[f"matest: {what}"].value is None:
                    lost.append(f"{case}, {estimator}, {what}: matest never gets there")
            table.add_row(f"  {estimator}", *row, figure(metrics[f"{estimator}: error at the end"]))
    about = (
        f"{IMAGES} photographs. Error: root mean square over the unknowns, in units of the Cramér-Rao bound of all "
        f"samples; seconds until it stays below {EQUAL[BOUNDS][1]:g}, and until every parameter stays within "
        f"{CLOSE:.0%} of the optimum of the likelihood. Peers get the samples with their geometry and true noise and "
        "start in the middle of the domain; matest starts from the photographs in memory, and its curve is made of "
        "estimates to coarser and finer precisions. Adam, mitsuba: the best of several learning rates at every time."
    )
    verdict = Text(
        "matest loses nowhere here." if not lost else "matest loses:\n" + "\n".join(f"  {line}" for line in lost),
        style="red" if lost else "",
    )
    return Group(Text(about), "", table, "", verdict, *(Text(f"{who}: {why}") for who, why in missing.items()))


def _or_never(record: Record) -> Text:
    return Text("never") if record.value is None else figure(record)
