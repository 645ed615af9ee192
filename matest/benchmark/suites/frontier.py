"""Error against time, for every estimator on four scenes; preparation included."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

import torch
from rich.console import Group
from rich.text import Text

import matest
from matest.benchmark.instruments.contest import GLOSSY, IMAGES, Contest, contest_of, sphere_of
from matest.benchmark.instruments.curves import Curve, Yardstick
from matest.benchmark.instruments.passes import timed
from matest.benchmark.instruments.photographs import sphere, vase
from matest.benchmark.instruments.task import CLOSE, Trace, Values
from matest.benchmark.rivals import renderers
from matest.benchmark.rivals.race import Rules, race
from matest.benchmark.suite import Effort, Progress, Record, Suite
from matest.benchmark.tables import by_case, case_name, figure, ruled
from matest.brdf import CookTorrance, OrenNayar, preset

# Pixels on a side of the images.
SIZE = 256
SIZE_QUICK = 48
# `precision` of the estimates that make matest's curve; None reads every pixel.
PRECISIONS = (0.1, 0.03, 0.01, 0.003, 0.001, None)
PRECISIONS_QUICK = (0.01, None)
# Seeds of matest's subsamples, whose errors are pooled.
SEEDS = 3
SEEDS_QUICK = 1
# Adam's learning rates, the most promising first.
RATES = (0.1, 0.03, 0.3)
# Runs of solvers that have none.
ROUNDS = 2
# Seconds after which a run of Adam ends.
PATIENCE = 20.0
PATIENCE_QUICK = 0.5
# Where times are compared: when a quantity of `Step` comes to stay below a limit.
BOUNDS = "to 2 bounds"
EQUAL = {BOUNDS: ("error", 2.0), "to 1 %": ("off", CLOSE)}
# Rivals of `race` without a curve here: what they differ in from another is one time.
UNDRAWN = ("mitsuba, compiling", "dr.jit, prepared", "dr.jit, compiling")
# Peers that take less than this share of matest's time beat it.
SLOWER = 1.0
# What follows a solver's name in the metric of its last error.
_END = ": error at the end"


def _rough_vase(size: int) -> Contest:
    material = OrenNayar(albedo=torch.tensor([0.7, 0.5, 0.3]), sigma=torch.tensor(0.6))
    return contest_of(material, vase(size), [], {"albedo": 0.5, "sigma": math.pi / 4})


def _copper_vase(size: int) -> Contest:
    """The vase of Cook & Torrance, fig. 6b; its colours in numbers, as their source is an optional package."""
    material = CookTorrance(
        diffuse=torch.tensor(0.0), specular=torch.tensor(1.0), slope=torch.tensor(0.2), slope_2=torch.tensor(0.4),
        weight_2=torch.tensor(0.4), f0=torch.tensor([0.95, 0.64, 0.54]), f0_mean=torch.tensor(0.66), lobes="2",
        fresnel="colour-shift",
    )  # fmt: skip
    start = {"f0": 0.5, "slope": 0.1, "slope_2": 0.5, "weight_2": 0.5}
    return contest_of(material, vase(size), ["diffuse", "specular", "f0_mean"], start)


def _paper_sphere(size: int) -> Contest:
    """Sample #73 of Li & Torrance; of forward scattering light from the viewer's side shows nothing."""
    start = {"k_uds": 0.5, "k_dd": 0.5, "correlation_length": 10.0}
    return contest_of(preset("laser-paper"), sphere(size), ["f0", "height_rms", "k_fs"], start)


# Of every scene the contest, from the size of its images.
CASES: dict[str, Callable[[int], Contest]] = {
    "oren-nayar vase": _rough_vase,
    "cook-torrance sphere": partial(sphere_of, GLOSSY),
    "copper vase": _copper_vase,
    "laser-paper sphere": _paper_sphere,
}


def measure(effort: Effort, progress: Progress) -> Iterator[Record]:
    """Records of every scene; of the first alone in a quick run."""
    rules = Rules(
        rates=RATES[:1] if effort.quick else RATES,
        rounds=ROUNDS,
        of_mitsuba=renderers.PATIENCE_QUICK if effort.quick else renderers.PATIENCE,
        close=renderers.STILL,
        hurry=False,
    )

    def patience(solver: str) -> float:
        seconds = PATIENCE_QUICK if effort.quick else PATIENCE
        return seconds if solver.startswith("adam") else math.inf

    for name, make in list(CASES.items())[: 1 if effort.quick else None]:
        contest = make(SIZE_QUICK if effort.quick else SIZE)
        yield Record("frontier", name, "samples", len(contest.task.radiance), "1", "higher")
        progress(f"{name}: matest")
        of_matest, yardstick = _matest(contest, effort.quick)
        yield from figures(name, "matest", of_matest, of_matest)
        for solver, runs, missing in race(name, contest, yardstick.optimum, rules, patience, effort, progress):
            if solver not in UNDRAWN:
                note = "compiled before" if solver in renderers.NAMES else ""
                curve = curve_of(runs, yardstick, note) if runs else Curve(note=missing)
                yield from figures(name, solver, curve, of_matest)


def _matest(contest: Contest, quick: bool) -> tuple[Curve, Yardstick]:
    """One result a precision, pooled over the seeds, in the shortest time of one; and what to measure all with."""
    precisions, seeds = (PRECISIONS_QUICK, SEEDS_QUICK) if quick else (PRECISIONS, SEEDS)

    def once(precision: float | None, seed: int) -> Values:
        estimate = matest.estimate(
            contest.capture, contest.expression, fix=contest.fixed, precision=precision, seed=seed
        )
        return {name: estimate.material.parameters[name].detach() for name in contest.task.free}

    # What a process loads and prepares once is not counted, for anyone.
    once(None, 0)
    runs = [[timed(partial(once, precision, seed)) for seed in range(seeds)] for precision in precisions]
    # The last has read every pixel.
    yardstick = Yardstick(contest.truth, contest.bound(), runs[-1][0][0])
    steps = [[yardstick.step(min(times), *values)] for values, times in (zip(*run, strict=True) for run in runs)]
    return Curve(steps, f"precisions of {precisions[0]:g} to none asked for, {seeds} seeds each"), yardstick


def curve_of(runs: Sequence[Trace], yardstick: Yardstick, note: str = "") -> Curve:
    """All learning rates of a solver that has some, else its quickest run."""
    if runs[0].rate is None:
        return Curve([yardstick.run(min(runs, key=lambda run: run.seconds[-1]))], note)
    rates = ", ".join(f"{run.rate:g}" for run in runs)
    return Curve([yardstick.run(run) for run in runs], note or f"learning rates {rates}, the best at every time")


def figures(case: str, estimator: str, curve: Curve, of_matest: Curve) -> Iterator[Record]:
    """Times to equal errors, the error at the end, and the points of the curve."""
    for what, (quantity, limit) in EQUAL.items():
        taken, reference = curve.arrival(quantity, limit), of_matest.arrival(quantity, limit)
        yield Record("frontier", case, f"{estimator}: {what}", taken, "s", note=curve.note)
        if estimator != "matest":
            ratio = None if taken is None or reference is None else taken / reference
            yield Record("frontier", case, f"{estimator}: {what} / matest", ratio, "1", "higher", SLOWER, curve.note)
    yield Record("frontier", case, f"{estimator}{_END}", curve.end, "1", note=curve.note)
    for number, (seconds, error) in enumerate(curve.points()):
        yield Record("frontier", case, f"{estimator}: point {number}, seconds", seconds, "s")
        yield Record("frontier", case, f"{estimator}: point {number}, error", error, "1")


def table(records: Sequence[Record]) -> Group:
    """Seconds to equal errors, times matest's, and errors at the end; then where matest loses."""
    times = ruled("", "to 2 ×\nthe bound", "times\nmatest's", "to 1 %", "times\nmatest's", "error at\nthe end")
    losses, missing = [], {}
    for case, metrics in by_case(records).items():
        times.add_row(case_name(case))
        for solver in (name.removesuffix(_END) for name in metrics if name.endswith(_END)):
            end = metrics[f"{solver}{_END}"]
            if end.value is None:
                missing[solver] = end.note
                continue
            row = []
            for what in EQUAL:
                row += [_or_never(metrics[f"{solver}: {what}"]), figure(metrics.get(f"{solver}: {what} / matest"))]
                if loss := _loss(metrics, solver, what):
                    losses.append(f"  {case}, {solver}, {what}: {loss}")
            times.add_row(f"  {solver}", *row, figure(end))
    about = (
        f"{IMAGES} photographs. Error: root mean square over the unknowns, in units of the Cramér-Rao bound of all "
        f"samples; seconds until it stays below {EQUAL[BOUNDS][1]:g}, and until every parameter stays within "
        f"{CLOSE:.0%} of the optimum of the likelihood. Peers get the samples with their geometry and true noise and "
        "start in the middle of the domain; matest starts from the photographs in memory, and its curve is made of "
        "estimates to coarser and finer precisions. Adam, mitsuba: the best of several learning rates at every time."
    )
    verdict = Text("\n".join(["matest loses:", *losses]), style="red") if losses else Text("matest loses nowhere here.")
    return Group(Text(about), "", times, "", verdict, *(Text(f"{solver}: {why}") for solver, why in missing.items()))


def _loss(metrics: Mapping[str, Record], solver: str, what: str) -> str:
    """How matest is slower than a solver, if it is."""
    ratio = metrics.get(f"{solver}: {what} / matest")
    if ratio is not None and ratio.misses:
        return f"in {ratio.value:.2g} of matest's time"
    never = metrics[f"{solver}: {what}"].value is not None and metrics[f"matest: {what}"].value is None
    return "matest never gets there" if never else ""


def _or_never(record: Record) -> Text:
    return Text("never") if record.value is None else figure(record)


SUITE = Suite(measure, table)
