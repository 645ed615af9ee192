"""Time to 1 % in every parameter against other solvers, on the same samples and noise, preparation included."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from rich.console import Group
from rich.text import Text

import matest
from matest.benchmark.instruments.contest import GLOSSY, IMAGES, Contest, sphere_of
from matest.benchmark.instruments.passes import timed
from matest.benchmark.instruments.task import CLOSE, Trace, Values, distance
from matest.benchmark.rivals import hand_written, renderers
from matest.benchmark.rivals.race import Rules, race, soonest
from matest.benchmark.suite import Effort, Progress, Record, Suite
from matest.benchmark.tables import by_case, case_name, figure, largest, page, ruled

# Runs of matest and of every solver without a learning rate, of which the shortest counts.
ROUNDS = 3
# A peer that goes on for so many times its limit has lost enough: what it needs is more.
_MARGIN = 1.5
# Precision asked of matest, relative: a third of the distance that counts as arrived.
_PRECISION = CLOSE / 3
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
# Adam's learning rates, the best of most runs first.
_RATES = (0.1, 0.3, 0.03, 0.01)


@dataclass(frozen=True)
class Size:
    """How much is measured.

    Attributes:
        pixels: on a side of the images.
        rules: of the race; what the search for the best learning rate costs is not counted.
        patience: seconds after which a run of Adam, L-BFGS or scipy ends.
        models: that are raced.
        judged: whether limits hold.
    """

    pixels: int
    rules: Rules
    patience: float = 60.0
    models: tuple[str, ...] = tuple(hand_written.MODELS)
    judged: bool = True


# Photographs of a megapixel, as those that estimates are timed on; smaller ones in the run of all suites.
FULL = Size(1024, Rules(_RATES, ROUNDS, of_mitsuba=300.0, compiles=True))
SHARED = Size(256, Rules(_RATES, ROUNDS, renderers.PATIENCE, compiles=True))
QUICK = Size(64, Rules(_RATES[:1], ROUNDS, renderers.PATIENCE_QUICK), 1.5, ("oren-nayar", GLOSSY), judged=False)


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
    case = contest.expression
    optimum = hand_written.optimum(contest.task, contest.truth)
    yield Record("peers", case, "samples", len(contest.task.radiance), "1", "higher")
    progress(f"{case}: matest")
    seconds, off = _matest(contest, optimum)
    yield Record("peers", case, "matest", seconds, "s")
    note = "largest relative distance of a parameter from the optimum"
    yield Record("peers", case, "distance", off, "1", limit=CLOSE, note=note)

    def patience(peer: str) -> float:
        return min(size.patience, _MARGIN * (LIMITS[peer] or math.inf) * seconds)

    for peer, runs, missing in race(case, contest, optimum, size.rules, patience, effort, progress):
        yield from figures(case, peer, seconds, runs, optimum, missing, size.judged)


def _matest(contest: Contest, optimum: Values) -> tuple[float, float]:
    """The shortest time of an estimate from the capture, and how far it is from the optimum."""

    def once() -> matest.Estimate:
        return matest.estimate(contest.capture, contest.expression, fix=contest.fixed, precision=_PRECISION)

    _, *runs = (timed(once) for _ in range(ROUNDS + 1))
    return min(seconds for _, seconds in runs), distance(runs[-1][0].material.parameters, optimum)


def figures(
    case: str, peer: str, of_matest: float, runs: Sequence[Trace], optimum: Values, missing: str, judged: bool = True
) -> Iterator[Record]:
    """The shortest time of a peer to the optimum, and as a multiple of matest's; without one, the reason.

    Args:
        case, peer: in the records.
        of_matest: matest's seconds.
        runs: of the peer.
        optimum: of the likelihood.
        missing: why there is no run, if there is none.
        judged: whether the limit holds.
    """
    ratio, limit = None, LIMITS[peer] if judged else None
    # A run that is there when its time is up counts, though it has not shown that it stays.
    if (best := soonest(runs, optimum)) is not None:
        seconds, run = best
        yield Record("peers", case, peer, seconds, "s", note=run.account)
        ratio, note = seconds / of_matest, run.account
    elif not runs:
        yield Record("peers", case, peer, None, "s", note=missing)
        note = missing
    elif peer == "mitsuba, compiling":
        # What compiling adds to never is left out.
        return
    else:
        off, spent = min((distance(run.values[-1], optimum), run.seconds[-1]) for run in runs)
        never = f"never within {CLOSE:.0%} to stay: {off:.2g} off after {spent:.3g} s"
        yield Record("peers", case, peer, None, "s", note=never)
        ratio, note = spent / of_matest, f"at least: {never}"
    yield Record("peers", case, f"{peer} / matest", ratio, "1", "higher", limit, note)


def table(records: Sequence[Record]) -> Group:
    """Seconds of everyone, and how many times as long each peer takes as matest."""
    times = ruled("", "seconds", "times\nmatest's", "limit")
    for case, metrics in by_case(records).items():
        times.add_row(case_name(case))
        times.add_row("  matest", figure(metrics["matest"]))
        for peer in (peer for peer in LIMITS if peer in metrics):
            compared = metrics[f"{peer} / matest"]
            ratio, limit = figure(compared), compared.limit
            if metrics[peer].value is None and ratio.plain:
                ratio = Text("> ").append_text(ratio)
            times.add_row(f"  {peer}", figure(metrics[peer]), ratio, "" if limit is None else f"> {limit:g}")
    about = (
        f"{largest(records, 'samples'):,} samples of {IMAGES} photographs of a sphere: time until every parameter "
        f"stays within {CLOSE:.0%} of the optimum of the likelihood. Peers get the samples with their geometry and "
        "true noise, and start in the middle of the domain; matest starts from the photographs in memory, with "
        f"--precision {_PRECISION:.2g}. Adam: torch's with the best learning rate; l-bfgs: torch's; least_squares: "
        "scipy's; compiled: by torch, before the clock starts. Levenberg-Marquardt: written by hand for the one model, "
        "with its Jacobian; dr.jit: the same as one fused kernel. mitsuba: its tutorials' render and Adam. Compiling: "
        "with what the first run compiles; prepared: without what is computed once."
    )
    return page(about, times, records=records)


SUITE = Suite(measure, table, share=270)
