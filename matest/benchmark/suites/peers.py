"""Time to 1 % in every parameter against other solvers, on the same samples and noise, preparation included."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

from rich.console import Group
from rich.text import Text

import matest
from matest.benchmark.instruments.subjects import GLOSSY, IMAGES, Subject, sphere_of
from matest.benchmark.instruments.task import CLOSE, Task, Trace, Values, distance
from matest.benchmark.instruments.timing import no_compiler
from matest.benchmark.record import Progress, Record
from matest.benchmark.rivals import hand_written, renderers, solvers
from matest.benchmark.rivals.renderers import Prepared, Race
from matest.benchmark.rivals.solvers import PEERS, raced
from matest.benchmark.tables import by_case, case_name, figure, notes, ruled

ROUNDS = 3
# A peer that goes on for so many times its limit has lost enough: what it needs is more.
_MARGIN = 1.5
BATCH = 16_384
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
class Effort:
    """How much is measured.

    Attributes:
        size: of the images.
        models: that are raced.
        rates: learning rates of Adam that are tried; what the search costs is not counted.
        patience: seconds after which a run of Adam, L-BFGS or scipy ends.
        of_mitsuba: seconds after which a run of Mitsuba ends.
        compiles: whether torch also compiles what Adam and L-BFGS evaluate.
        judged: whether limits hold.
    """

    size: int
    models: tuple[str, ...] = tuple(HAND_WRITTEN)
    rates: tuple[float, ...] = _RATES
    patience: float = 60.0
    of_mitsuba: float = renderers.PATIENCE
    compiles: bool = True
    judged: bool = True


# Photographs of a megapixel, as those that estimates are timed on; smaller ones in the run of all suites.
FULL = Effort(1024, of_mitsuba=300.0)
SHARED = Effort(256)
QUICK = Effort(64, ("oren-nayar", GLOSSY), _RATES[:1], 1.5, renderers.PATIENCE_QUICK, compiles=False, judged=False)


class Found(NamedTuple):
    """Seconds until the optimum, None if a solver never gets there; how long it had gone on then; Adam's best rate."""

    seconds: float | None
    note: str
    spent: float = 0.0
    rate: float | None = None


def run(quick: bool, progress: Progress, against: Collection[str] = PEERS) -> Iterator[Record]:
    """Records of the models that have a hand-written peer."""
    yield from race(QUICK if quick else FULL, progress, against)


def within(seconds: float, progress: Progress) -> Iterator[Record]:
    """The same on smaller photographs; no run of Adam, L-BFGS or scipy takes more than a fifth of that."""
    yield from race(replace(SHARED, patience=min(SHARED.patience, seconds / 5)), progress, PEERS)


def race(effort: Effort, progress: Progress, against: Collection[str]) -> Iterator[Record]:
    """Records of every model."""
    for expression in effort.models:
        yield from measure(sphere_of(expression, effort.size), effort, progress, against)


def measure(subject: Subject, effort: Effort, progress: Progress, against: Collection[str]) -> Iterator[Record]:
    """Times of matest and of every peer, all after a first run that is not counted."""
    expression, task = subject.expression, subject.task
    prepare = HAND_WRITTEN[expression]
    optimum = subject.optimum(prepare)
    yield Record("peers", expression, "samples", len(task.radiance), "1", "higher")
    progress(f"{expression}: matest")
    seconds, off = _matest(subject, optimum)
    yield Record("peers", expression, "matest", seconds, "s")
    note = "largest relative distance of a parameter from the optimum"
    yield Record("peers", expression, "distance", off, "1", limit=CLOSE, note=note)
    runs: dict[str, Callable[[float], Found]] = {
        "adam": lambda patience: _adam(task, optimum, None, effort.rates, patience),
        "adam, mini-batches": lambda patience: _adam(task, optimum, BATCH, effort.rates, patience),
        "l-bfgs": lambda patience: _shortest(partial(solvers.lbfgs, task, patience=patience), optimum),
        "least_squares": lambda patience: _shortest(partial(solvers.least_squares, task, patience=patience), optimum),
        "levenberg-marquardt": lambda _: _shortest(partial(hand_written.levenberg_marquardt, task, prepare), optimum),
    }
    if effort.compiles:
        runs["adam, compiled"] = lambda patience: _adam_compiled(
            task, optimum, results["adam"].rate or effort.rates[0], patience
        )
        runs["l-bfgs, compiled"] = lambda patience: _compiled(
            partial(solvers.lbfgs, task, compiled=True, patience=patience), optimum
        )
    results: dict[str, Found] = {}
    for peer, once in runs.items():
        if raced(peer, against):
            progress(f"{expression}: {peer}")
            results[peer] = once(min(effort.patience, _MARGIN * (LIMITS[peer] or math.inf) * seconds))
            yield from _compared(expression, peer, seconds, results[peer], effort)
    if expression == GLOSSY and raced("mitsuba, dr.jit", against):
        progress(f"{expression}: mitsuba, dr.jit")
        renderings = renderers.race_of_sphere(effort.size, effort.of_mitsuba)
        for peer, found in against_renderers(renderings, optimum).items():
            yield from _compared(expression, peer, seconds, found, effort)


def _compared(expression: str, peer: str, seconds: float, found: Found, effort: Effort) -> Iterator[Record]:
    yield Record("peers", expression, peer, found.seconds, "s", note=found.note)
    ratio, note = None, found.note
    if found.seconds is not None:
        ratio = found.seconds / seconds
    elif found.spent:
        ratio, note = found.spent / seconds, f"at least: {note}"
    limit = LIMITS[peer] if effort.judged else None
    yield Record("peers", expression, f"{peer} / matest", ratio, "1", "higher", limit, note)


def against_renderers(race: Race | None, optimum: Values) -> dict[str, Found]:
    """Times of Mitsuba and Dr.Jit; one sentence if they are missing."""
    if race is None:
        return {"mitsuba": Found(None, renderers.MISSING), "dr.jit": Found(None, renderers.MISSING)}
    tutorials = {
        rate: arrived for rate, trace in race.tutorial.items() if (arrived := trace.arrival(optimum)) is not None
    }
    found: dict[str, Found] = {}
    if tutorials:
        rate = min(tutorials, key=tutorials.__getitem__)
        note = f"learning rate {rate:g}"
        found["mitsuba"] = Found(tutorials[rate], note)
        found["mitsuba, compiling"] = Found(tutorials[rate] + race.compiling, note)
    else:
        found["mitsuba"] = _never(min(race.tutorial.values(), key=lambda trace: _end(trace, optimum)), optimum)
    runs = sorted(race.drjit, key=lambda one: one.trace.arrival(optimum) or math.inf)
    found["dr.jit"] = _arrival(runs[0], optimum)
    found["dr.jit, prepared"] = _arrival(runs[0], optimum, prepared=True)
    found["dr.jit, compiling"] = _arrival(race.drjit_first, optimum)
    return found


def _arrival(run: Prepared, optimum: Values, prepared: bool = False) -> Found:
    arrived = run.trace.arrival(optimum)
    if arrived is None:
        return _never(run.trace, optimum)
    return Found(arrived - (run.preparation if prepared else 0.0), f"{len(run.trace.values)} iterations in all")


def _end(trace: Trace, optimum: Values) -> float:
    return distance(trace.values[-1], optimum)


def _never(trace: Trace, optimum: Values) -> Found:
    spent = trace.seconds[-1]
    note = f"never within {CLOSE:.0%} to stay: {_end(trace, optimum):.2g} off after {spent:.3g} s"
    return Found(None, note, spent)


def _matest(subject: Subject, optimum: Values) -> tuple[float, float]:
    """The shortest time of an estimate from the capture, and how far it is from the optimum."""
    times = []
    for _ in range(ROUNDS + 1):
        start = time.perf_counter()
        found = matest.estimate(subject.capture, subject.expression, fix=subject.fixed, precision=CLOSE / 3)
        times.append(time.perf_counter() - start)
    return min(times[1:]), distance(found.material.parameters, optimum)


def _shortest(once: Callable[[], Trace], optimum: Values) -> Found:
    """The shortest time to the optimum; None if the solver never gets there."""
    once()
    times = []
    for _ in range(ROUNDS):
        trace = once()
        arrived = trace.arrival(optimum)
        if arrived is None:
            return _never(trace, optimum)
        times.append(arrived)
    return Found(min(times), f"{len(trace.values)} iterations in all")


def _adam(task: Task, optimum: Values, batch: int | None, rates: Sequence[float], patience: float) -> Found:
    """The shortest time over learning rates; None if none gets there."""
    solvers.adam(task, rates[0], batch, lambda _: True)
    best, shortest, note = None, math.inf, f"never within {CLOSE:.0%} in {patience:.3g} s at any learning rate"
    for rate in rates:
        # No use in going on for much longer than the best so far has taken.
        limit = min(patience, 2 * shortest)
        trace = solvers.adam(task, rate, batch, _settled_or(optimum, limit))
        # One that is there when its time is up counts, though it has not shown that it stays.
        arrived = trace.arrival(optimum)
        if arrived is not None and arrived < shortest:
            size = "all samples" if batch is None else f"{batch:,} samples"
            best, shortest, note = rate, arrived, f"learning rate {rate:g}, {size} a step"
    return Found(None, note, patience) if best is None else Found(shortest, note, rate=best)


def _adam_compiled(task: Task, optimum: Values, rate: float, patience: float) -> Found:
    done = _settled_or(optimum, patience)
    return _compiled(lambda: solvers.adam(task, rate, None, done, compiled=True), optimum)


def _compiled(once: Callable[[], Trace], optimum: Values) -> Found:
    """The time to the optimum of a run whose code is compiled before it starts."""
    note = no_compiler()
    if note:
        return Found(None, note)
    start = time.perf_counter()
    trace = once()
    arrived = trace.arrival(optimum)
    if arrived is None:
        return _never(trace, optimum)
    return Found(arrived, f"after {time.perf_counter() - start - trace.seconds[-1]:.3g} s of compiling")


def _settled_or(optimum: Values, limit: float) -> Callable[[Trace], bool]:
    return lambda trace: trace.settled(optimum, solvers.SETTLED) or trace.elapsed > limit


def peers_table(found: list[Record]) -> Group:
    """Seconds of everyone, and how many times as long each peer takes as matest."""
    table = ruled("", "seconds", "times\nmatest's", "limit")
    for case, metrics in by_case(found).items():
        table.add_row(case_name(case))
        table.add_row("  matest", figure(metrics["matest"]))
        for peer in (peer for peer in LIMITS if peer in metrics):
            compared = metrics[f"{peer} / matest"]
            ratio, limit = figure(compared), compared.limit
            if metrics[peer].value is None and ratio.plain:
                ratio = Text("> ").append_text(ratio)
            table.add_row(f"  {peer}", figure(metrics[peer]), ratio, "" if limit is None else f"> {limit:g}")
    count = max(int(record.value or 0) for record in found if record.metric == "samples")
    about = (
        f"{count:,} samples of {IMAGES} photographs of a sphere: time until every parameter stays within {CLOSE:.0%} "
        "of the optimum of the likelihood. Peers get the samples with their geometry and true noise, and start in the "
        f"middle of the domain; matest starts from the photographs in memory, with --precision {CLOSE / 3:.2g}. Adam: "
        "torch's with the best learning rate; l-bfgs: torch's; least_squares: scipy's; compiled: by torch, before the "
        "clock starts. Levenberg-Marquardt: written by hand for the one model, with its Jacobian; dr.jit: the same as "
        "one fused kernel. mitsuba: its tutorials' render and Adam. Compiling: with what the first run compiles; "
        "prepared: without what is computed once."
    )
    return Group(Text(about), "", table, *notes(found))
