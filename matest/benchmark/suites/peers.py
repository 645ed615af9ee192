"""Time to 1 % in every parameter against other solvers, on the same samples and noise, preparation included."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

from rich.console import Group
from rich.text import Text

import matest
from matest.benchmark.instruments.contest import GLOSSY, IMAGES, Contest, sphere_of
from matest.benchmark.instruments.passes import timed
from matest.benchmark.instruments.task import CLOSE, Trace, Values, distance
from matest.benchmark.instruments.timing import no_compiler
from matest.benchmark.record import Progress, Record
from matest.benchmark.rivals import hand_written, renderers, solvers
from matest.benchmark.rivals.race import Once, Run, finished, rivals
from matest.benchmark.suite import Effort, Suite
from matest.benchmark.tables import by_case, case_name, figure, largest, page, ruled

ROUNDS = 3
# A peer that goes on for so many times its limit has lost enough: what it needs is more.
_MARGIN = 1.5
# Least times faster than each; None: for information.
LIMITS = {
    "adam": 50.0,
    "adam, compiled": 50.0,
    "adam, mini-batches": 50.0,
    "l-bfgs": 15.0,
    "l-bfgs, compiled": 15.0,
    "least_squares": 15.0,
    "levenberg-marquardt": 2.0,
    "mitsuba": 500.0,
    "mitsuba, compiling": None,
    "dr.jit": 1.0,
    "dr.jit, prepared": None,
    "dr.jit, compiling": None,
}
HAND_WRITTEN = {
    "oren-nayar": hand_written.oren_nayar,
    "cook-torrance": hand_written.cook_torrance,
    GLOSSY: hand_written.cook_torrance_smith,
}
# Adam's learning rates, the best of most runs first.
_RATES = (0.1, 0.3, 0.03, 0.01)


@dataclass(frozen=True)
class Size:
    """How much is measured.

    Attributes:
        pixels: on a side of the images.
        models: that are raced.
        rates: learning rates of Adam that are tried; what the search costs is not counted.
        patience: seconds after which a run of Adam, L-BFGS or scipy ends.
        of_mitsuba: seconds after which a run of Mitsuba ends.
        compiles: whether torch also compiles what Adam and L-BFGS evaluate.
        judged: whether limits hold.
    """

    pixels: int
    models: tuple[str, ...] = tuple(HAND_WRITTEN)
    rates: tuple[float, ...] = _RATES
    patience: float = 60.0
    of_mitsuba: float = renderers.PATIENCE
    compiles: bool = True
    judged: bool = True


# Photographs of a megapixel, as those that estimates are timed on; smaller ones in the run of all suites.
FULL = Size(1024, of_mitsuba=300.0)
SHARED = Size(256)
QUICK = Size(64, ("oren-nayar", GLOSSY), _RATES[:1], 1.5, renderers.PATIENCE_QUICK, compiles=False, judged=False)


class Result(NamedTuple):
    """How a solver fared.

    Attributes:
        seconds: until the optimum; None if it never gets there.
        note: for a person.
        spent: how long it had gone on then.
        rate: its learning rate.
    """

    seconds: float | None
    note: str
    spent: float = 0.0
    rate: float | None = None


def measure(effort: Effort, progress: Progress) -> Iterator[Record]:
    """Records of the models that have a hand-written peer.

    In a run of all suites no run of Adam, L-BFGS or scipy takes more than a fifth of its time.
    """
    size = QUICK if effort.quick else FULL
    if effort.shared:
        size = replace(SHARED, patience=min(SHARED.patience, effort.seconds / 5))
    for expression in size.models:
        yield from compare(sphere_of(expression, size.pixels), size, effort, progress)


def compare(contest: Contest, size: Size, effort: Effort, progress: Progress) -> Iterator[Record]:
    """Times of matest and of every peer, all after a first run that is not counted."""
    expression = contest.expression
    optimum = hand_written.optimum(contest.task, contest.truth, HAND_WRITTEN[expression])
    yield Record("peers", expression, "samples", len(contest.task.radiance), "1", "higher")
    progress(f"{expression}: matest")
    seconds, off = _matest(contest, optimum)
    yield Record("peers", expression, "matest", seconds, "s")
    note = "largest relative distance of a parameter from the optimum"
    yield Record("peers", expression, "distance", off, "1", limit=CLOSE, note=note)
    best: dict[str, Result] = {}
    for peer, once in _solvers(contest, optimum, size, best).items():
        if effort.races(peer):
            progress(f"{expression}: {peer}")
            runs = once(min(size.patience, _MARGIN * (LIMITS[peer] or math.inf) * seconds))
            best[peer] = result_of(runs, optimum, no_compiler())
            yield from _compared(expression, peer, seconds, best[peer], size)
    if expression == GLOSSY and effort.races("mitsuba, dr.jit"):
        progress(f"{expression}: mitsuba, dr.jit")
        for peer, result in of_renderers(renderers.race_of_sphere(size.pixels, size.of_mitsuba), optimum).items():
            yield from _compared(expression, peer, seconds, result, size)


def _matest(contest: Contest, optimum: Values) -> tuple[float, float]:
    """The shortest time of an estimate from the capture, and how far it is from the optimum."""

    def once() -> matest.Estimate:
        return matest.estimate(contest.capture, contest.expression, fix=contest.fixed, precision=CLOSE / 3)

    _, *runs = (timed(once) for _ in range(ROUNDS + 1))
    return min(seconds for _, seconds in runs), distance(runs[-1][0].material.parameters, optimum)


def _solvers(contest: Contest, optimum: Values, size: Size, best: dict[str, Result]) -> dict[str, Once]:
    """Every solver in this process; `best` will hold the results of those that have run."""
    task, prepare = contest.task, HAND_WRITTEN[contest.expression]

    def adam(patience: float) -> list[Run]:
        done = partial(finished, optimum=optimum, close=CLOSE, limit=patience)
        return _compiled(partial(solvers.adam, task, None, best["adam"].rate or size.rates[0], done))

    def lbfgs(patience: float) -> list[Run]:
        return _compiled(partial(solvers.lbfgs, task, patience=patience))

    compiled = {"adam, compiled": adam, "l-bfgs, compiled": lbfgs} if size.compiles else {}
    return rivals(task, optimum, prepare, rates=size.rates, rounds=ROUNDS) | compiled


def _compiled(once: Callable[..., Trace]) -> list[Run]:
    """A run whose code is compiled before it starts; none where there is no compiler."""
    if no_compiler():
        return []
    trace, seconds = timed(lambda: once(compiled=True))
    return [Run(trace, f"after {seconds - trace.seconds[-1]:.3g} s of compiling")]


def of_renderers(race: dict[str, list[Run]], optimum: Values) -> dict[str, Result]:
    """Times of Mitsuba and Dr.Jit; one sentence if they are missing. What compiling adds to never is left out."""
    results = {peer: result_of(runs, optimum) for peer, runs in race.items()}
    if results["mitsuba"].seconds is None:
        results.pop("mitsuba, compiling", None)
    return {peer: results[peer] for peer in LIMITS if peer in results}


def result_of(runs: Sequence[Run], optimum: Values, missing: str = renderers.MISSING) -> Result:
    """The shortest time to the optimum; if none gets there, how far the nearest is from it.

    Args:
        runs: of one solver.
        optimum: of the likelihood.
        missing: why there is no run, if there is none.
    """
    if not runs:
        return Result(None, missing)
    # A run that is there when its time is up counts, though it has not shown that it stays.
    arrivals = [(arrived, run) for run in runs if (arrived := run.trace.arrival(optimum)) is not None]
    if arrivals:
        seconds, run = min(arrivals, key=lambda one: one[0])
        return Result(seconds, run.note, rate=run.rate)
    off, spent = min((distance(run.trace.values[-1], optimum), run.trace.seconds[-1]) for run in runs)
    return Result(None, f"never within {CLOSE:.0%} to stay: {off:.2g} off after {spent:.3g} s", spent)


def _compared(expression: str, peer: str, seconds: float, result: Result, size: Size) -> Iterator[Record]:
    yield Record("peers", expression, peer, result.seconds, "s", note=result.note)
    ratio, note = None, result.note
    if result.seconds is not None:
        ratio = result.seconds / seconds
    elif result.spent:
        ratio, note = result.spent / seconds, f"at least: {note}"
    limit = LIMITS[peer] if size.judged else None
    yield Record("peers", expression, f"{peer} / matest", ratio, "1", "higher", limit, note)


def table(found: Sequence[Record]) -> Group:
    """Seconds of everyone, and how many times as long each peer takes as matest."""
    times = ruled("", "seconds", "times\nmatest's", "limit")
    for case, metrics in by_case(found).items():
        times.add_row(case_name(case))
        times.add_row("  matest", figure(metrics["matest"]))
        for peer in (peer for peer in LIMITS if peer in metrics):
            compared = metrics[f"{peer} / matest"]
            ratio, limit = figure(compared), compared.limit
            if metrics[peer].value is None and ratio.plain:
                ratio = Text("> ").append_text(ratio)
            times.add_row(f"  {peer}", figure(metrics[peer]), ratio, "" if limit is None else f"> {limit:g}")
    about = (
        f"{largest(found, 'samples'):,} samples of {IMAGES} photographs of a sphere: time until every parameter stays "
        f"within {CLOSE:.0%} of the optimum of the likelihood. Peers get the samples with their geometry and true "
        "noise, and start in the middle of the domain; matest starts from the photographs in memory, with --precision "
        f"{CLOSE / 3:.2g}. Adam: torch's with the best learning rate; l-bfgs: torch's; least_squares: scipy's; "
        "compiled: by torch, before the clock starts. Levenberg-Marquardt: written by hand for the one model, with its "
        "Jacobian; dr.jit: the same as one fused kernel. mitsuba: its tutorials' render and Adam. Compiling: with what "
        "the first run compiles; prepared: without what is computed once."
    )
    return page(about, times, records=found)


SUITE = Suite(measure, table, share=300)
