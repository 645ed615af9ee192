"""Time to 1 % in every parameter against other solvers, on the same samples and noise, preparation included."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from typing import NamedTuple

from rich.console import Group
from rich.text import Text

import matest
from matest.benchmark import hand_written, renderers, solvers
from matest.benchmark.record import Progress, Record
from matest.benchmark.renderers import Prepared, Race
from matest.benchmark.solvers import PEERS, raced
from matest.benchmark.subjects import GLOSSY, IMAGES, Subject, sphere_of
from matest.benchmark.tables import by_case, case_name, figure, notes, ruled
from matest.benchmark.task import CLOSE, Task, Trace, Values, distance

SIZE, SIZE_QUICK = 256, 64
ROUNDS = 3
# Adam's learning rates that are tried, the best of most runs first; what the search costs is not counted.
RATES, RATES_QUICK = (0.3, 0.1, 0.03, 0.01), (0.3,)
BATCH = 16_384
# A run of Adam ends after so many seconds.
PATIENCE, PATIENCE_QUICK = 60.0, 1.5
# Least times faster than each, in a full run; None: for information.
LIMITS = {
    "adam": 50.0,
    "adam, mini-batches": 50.0,
    "l-bfgs": 15.0,
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
QUICK = ("oren-nayar", GLOSSY)


class Found(NamedTuple):
    """Seconds until the optimum, None if a solver never gets there; and how long it had gone on then."""

    seconds: float | None
    note: str
    spent: float = 0.0


def run(quick: bool, progress: Progress, against: Collection[str] = PEERS) -> Iterator[Record]:
    """Records of the models that have a hand-written peer."""
    for expression in QUICK if quick else HAND_WRITTEN:
        yield from measure(sphere_of(expression, SIZE_QUICK if quick else SIZE), quick, progress, against)


def measure(subject: Subject, quick: bool, progress: Progress, against: Collection[str] = PEERS) -> Iterator[Record]:
    """Times of matest and of every peer, all after a first run that is not counted."""
    expression, task = subject.expression, subject.task
    prepare = HAND_WRITTEN[expression]
    optimum = subject.optimum(prepare)
    patience, rates = (PATIENCE_QUICK, RATES_QUICK) if quick else (PATIENCE, RATES)
    yield Record("peers", expression, "samples", len(task.radiance), "1", "higher")
    progress(f"{expression}: matest")
    seconds, off = _matest(subject, optimum)
    yield Record("peers", expression, "matest", seconds, "s")
    note = "largest relative distance of a parameter from the optimum"
    yield Record("peers", expression, "distance", off, "1", limit=CLOSE, note=note)
    runs: dict[str, Callable[[], Found]] = {
        "adam": lambda: _adam(task, optimum, None, rates, patience),
        "adam, mini-batches": lambda: _adam(task, optimum, BATCH, rates, patience),
        "l-bfgs": lambda: _shortest(lambda: solvers.lbfgs(task), optimum),
        "least_squares": lambda: _shortest(lambda: solvers.least_squares(task), optimum),
        "levenberg-marquardt": lambda: _shortest(lambda: hand_written.levenberg_marquardt(task, prepare), optimum),
    }
    for peer, once in runs.items():
        if not raced(peer, against):
            continue
        progress(f"{expression}: {peer}")
        yield from _compared(expression, peer, seconds, once(), quick)
    if expression == GLOSSY and raced("mitsuba, dr.jit", against):
        progress(f"{expression}: mitsuba, dr.jit")
        limit = renderers.PATIENCE_QUICK if quick else renderers.PATIENCE
        race = renderers.race_of_sphere(SIZE_QUICK if quick else SIZE, limit)
        for peer, found in against_renderers(race, optimum).items():
            yield from _compared(expression, peer, seconds, found, quick)


def _compared(expression: str, peer: str, seconds: float, found: Found, quick: bool) -> Iterator[Record]:
    yield Record("peers", expression, peer, found.seconds, "s", note=found.note)
    ratio, note = None, found.note
    if found.seconds is not None:
        ratio = found.seconds / seconds
    elif found.spent:
        ratio, note = found.spent / seconds, f"at least: {note}"
    yield Record("peers", expression, f"{peer} / matest", ratio, "1", "higher", None if quick else LIMITS[peer], note)


def against_renderers(race: Race | None, optimum: Values) -> dict[str, Found]:
    """Times of Mitsuba and Dr.Jit; one sentence if they are missing."""
    if race is None:
        return {"mitsuba": Found(None, renderers.MISSING), "dr.jit": Found(None, renderers.MISSING)}
    tutorials = {
        rate: arrived
        for rate, trace in race.tutorial.items()
        if trace.settled(optimum, solvers.SETTLED) and (arrived := trace.arrival(optimum)) is not None
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
    traces = [once() for _ in range(ROUNDS)]
    found = [arrived for trace in traces if (arrived := trace.arrival(optimum)) is not None]
    if found:
        return Found(min(found), f"{len(traces[0].values)} iterations in all")
    return _never(traces[0], optimum)


def _adam(task: Task, optimum: Values, batch: int | None, rates: Sequence[float], patience: float) -> Found:
    """The shortest time over learning rates; None if none gets there."""
    solvers.adam(task, rates[0], batch, lambda _: True)
    shortest, note = math.inf, f"never within {CLOSE:.0%} in {patience:g} s at any learning rate"
    for rate in rates:
        # No use in going on for much longer than the best so far has taken.
        limit = min(patience, 2 * shortest)
        trace = solvers.adam(task, rate, batch, _settled_or(optimum, limit))
        arrived = trace.arrival(optimum) if trace.settled(optimum, solvers.SETTLED) else None
        if arrived is not None and arrived < shortest:
            size = "all samples" if batch is None else f"{batch:,} samples"
            shortest, note = arrived, f"learning rate {rate:g}, {size} a step"
    return Found(shortest, note) if math.isfinite(shortest) else Found(None, note, patience)


def _settled_or(optimum: Values, limit: float) -> Callable[[Trace], bool]:
    return lambda trace: trace.settled(optimum, solvers.SETTLED) or trace.elapsed > limit


def peers_table(found: list[Record]) -> Group:
    """Seconds of everyone, and how many times as long each peer takes as matest."""
    table = ruled("", "seconds", "times\nmatest's", "at\nleast")
    for case, metrics in by_case(found).items():
        table.add_row(case_name(case))
        table.add_row("  matest", figure(metrics["matest"]))
        for peer, limit in LIMITS.items():
            if peer in metrics:
                ratio = figure(metrics[f"{peer} / matest"])
                if metrics[peer].value is None and ratio.plain:
                    ratio = Text("> ").append_text(ratio)
                table.add_row(f"  {peer}", figure(metrics[peer]), ratio, "" if limit is None else f"{limit:g}")
    count = max(int(record.value or 0) for record in found if record.metric == "samples")
    about = (
        f"{count:,} samples of {IMAGES} photographs of a sphere: time until every parameter stays within {CLOSE:.0%} "
        "of the optimum of the likelihood. Peers get the samples with their geometry and true noise, and start in the "
        f"middle of the domain; matest starts from the photographs in memory, with --precision {CLOSE / 3:.2g}. Adam: "
        "the best learning rate. Levenberg-Marquardt: written by hand for the one model, with its Jacobian; dr.jit: "
        "the same as one fused kernel. mitsuba: its tutorials' render and Adam. Compiling: with what the first run "
        "compiles; prepared: without what is computed once."
    )
    return Group(Text(about), "", table, *notes(found))
