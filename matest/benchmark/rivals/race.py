"""The race on one contest: what each rival would hand over, had it been stopped at any time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

from matest.benchmark.instruments.contest import GLOSSY, Contest
from matest.benchmark.instruments.passes import no_compiler, timed
from matest.benchmark.instruments.task import CLOSE, Trace, Values
from matest.benchmark.rivals import hand_written, renderers, solvers
from matest.benchmark.suite import Effort, Progress

# Samples a step of Adam on mini-batches.
BATCH = 16_384

Once = Callable[[float], list[Trace]]


@dataclass(frozen=True)
class Rules:
    """How a race is run.

    Attributes:
        rates: Adam's learning rates, the most promising first.
        rounds: runs of solvers that have none.
        of_mitsuba: seconds after which a run of Mitsuba ends.
        close: relative distance from the optimum at which Adam has arrived.
        hurry: whether runs of Adam end that take much longer than its best so far.
        compiles: whether torch also compiles what Adam and L-BFGS evaluate.
    """

    rates: tuple[float, ...]
    rounds: int
    of_mitsuba: float
    close: float = CLOSE
    hurry: bool = True
    compiles: bool = False


def race(
    case: str,
    contest: Contest,
    optimum: Values,
    rules: Rules,
    patience: Callable[[str], float],
    effort: Effort,
    progress: Progress,
) -> Iterator[tuple[str, list[Trace], str]]:
    """Every rival that the effort asks for: its name, its runs, and why there are none if there are none.

    A solver runs once before, uncounted: what a process loads and prepares once counts for nobody.

    Args:
        case: for the progress.
        contest, optimum: what they are given, and its likelihood's optimum.
        rules, effort: how, and who races.
        patience: seconds after which a run of a solver in this process ends, by its name.
        progress: called before each.
    """
    task = contest.task
    runs: dict[str, list[Trace]] = {}

    def adam(batch: int | None, patience: float) -> list[Trace]:
        solvers.adam(task, batch, rules.rates[0], lambda _: True)
        once = partial(solvers.adam, task, batch)
        return solvers.tuned(once, rules.rates, optimum, patience, close=rules.close, hurry=rules.hurry)

    def repeated(once: Callable[[], Trace]) -> list[Trace]:
        once()
        return [once() for _ in range(rules.rounds)]

    def compiled_adam(patience: float) -> list[Trace]:
        best = soonest(runs["adam"], optimum)
        rate = best[1].rate if best is not None else None
        until = partial(solvers.finished, optimum=optimum, limit=patience)
        return _compiled(partial(solvers.adam, task, None, rate or rules.rates[0], until))

    every: dict[str, Once] = {
        "adam": partial(adam, None),
        "adam, mini-batches": partial(adam, BATCH),
        "l-bfgs": lambda patience: repeated(partial(solvers.lbfgs, task, patience=patience)),
        "least_squares": lambda patience: repeated(partial(solvers.least_squares, task, patience=patience)),
    }
    if contest.expression in hand_written.MODELS:
        every["levenberg-marquardt"] = lambda _: repeated(partial(hand_written.levenberg_marquardt, task))
    if rules.compiles:
        every["adam, compiled"] = compiled_adam
        every["l-bfgs, compiled"] = lambda patience: _compiled(partial(solvers.lbfgs, task, patience=patience))
    for name, once in every.items():
        if effort.races(name):
            progress(f"{case}: {name}")
            runs[name] = once(patience(name))
            yield name, runs[name], no_compiler()
    if contest.expression == GLOSSY and effort.races("mitsuba, dr.jit"):
        progress(f"{case}: mitsuba, dr.jit")
        rendered = renderers.race_of_sphere(contest.subject.scene.surface.shape[0], rules.of_mitsuba)
        yield from ((name, several, renderers.MISSING) for name, several in rendered.items())


def _compiled(once: Callable[..., Trace]) -> list[Trace]:
    """A run whose code is compiled before it starts; none where there is no compiler."""
    if no_compiler():
        return []
    trace, seconds = timed(lambda: once(compiled=True))
    return [replace(trace, note=f"after {seconds - trace.seconds[-1]:.3g} s of compiling")]


def soonest(runs: Sequence[Trace], optimum: Values) -> tuple[float, Trace] | None:
    """The run that comes to stay at the optimum first, after its seconds; None if none does."""
    arrivals = [(seconds, run) for run in runs if (seconds := run.arrival(optimum)) is not None]
    return min(arrivals, key=lambda one: one[0], default=None)
