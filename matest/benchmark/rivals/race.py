"""Rivals of matest on one task: what each would hand over, had it been stopped at any time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from matest.benchmark.instruments.task import CLOSE, Task, Trace, Values
from matest.benchmark.rivals import hand_written, solvers
from matest.benchmark.rivals.hand_written import Prepare

# Samples a step of Adam on mini-batches.
BATCH = 16_384
# Adam ends after this many steps within reach of the optimum,
SETTLED = 30
# or, where its error at the end counts, within this relative distance of it.
STILL = 1e-3
# A learning rate that takes so many times as long as the best so far has lost.
_LOST = 2.0


class Run(NamedTuple):
    """One run of a solver.

    Attributes:
        trace: its results.
        note: what it was, for a person.
        rate: its learning rate, if it has one.
    """

    trace: Trace
    note: str
    rate: float | None = None


Once = Callable[[float], list[Run]]
Done = Callable[[Trace], bool]


def rivals(
    task: Task,
    optimum: Values,
    prepare: Prepare | None,
    *,
    rates: Sequence[float],
    rounds: int,
    close: float = CLOSE,
    hurry: bool = True,
) -> dict[str, Once]:
    """Solvers on the torch shader, and the one written by hand where there is a model for it.

    Each takes the seconds after which a run ends, and runs once before, uncounted: what a process loads and prepares
    once counts for nobody.

    Args:
        task: what they are given.
        optimum: of the likelihood.
        prepare: the model for the solver written by hand, if there is one.
        rates: Adam's learning rates, the most promising first.
        rounds: runs of solvers that have none.
        close, hurry: as of `tuned`.
    """

    def adam(batch: int | None, patience: float) -> list[Run]:
        solvers.adam(task, batch, rates[0], lambda _: True)
        runs = tuned(partial(solvers.adam, task, batch), rates, optimum, patience, close=close, hurry=hurry)
        size = "all samples" if batch is None else f"{batch:,} samples"
        return [run._replace(note=f"{run.note}, {size} a step") for run in runs]

    def repeated(once: Callable[[], Trace]) -> list[Run]:
        once()
        return [iterated(once()) for _ in range(rounds)]

    every: dict[str, Once] = {
        "adam": lambda patience: adam(None, patience),
        "adam, mini-batches": lambda patience: adam(BATCH, patience),
        "l-bfgs": lambda patience: repeated(partial(solvers.lbfgs, task, patience=patience)),
        "least_squares": lambda patience: repeated(partial(solvers.least_squares, task, patience=patience)),
    }
    if prepare is not None:
        every["levenberg-marquardt"] = lambda _: repeated(partial(hand_written.levenberg_marquardt, task, prepare))
    return every


def tuned(
    once: Callable[[float, Done], Trace],
    rates: Sequence[float],
    optimum: Values,
    patience: float,
    *,
    close: float = CLOSE,
    hurry: bool = True,
) -> list[Run]:
    """A run for every learning rate.

    Args:
        once: a run, from the learning rate and whether to stop, asked after every step.
        rates: the most promising first.
        optimum: of the likelihood.
        patience: seconds after which a run ends.
        close: relative distance from the optimum at which it has arrived.
        hurry: whether runs end that take much longer than the best so far.
    """
    runs: list[Run] = []
    limit = patience
    for rate in rates:
        trace = once(rate, partial(finished, optimum=optimum, close=close, limit=limit))
        runs.append(Run(trace, f"learning rate {rate:g}", rate))
        arrived = trace.arrival(optimum)
        if hurry and arrived is not None:
            limit = min(limit, _LOST * arrived)
    return runs


def finished(trace: Trace, optimum: Values, close: float, limit: float) -> bool:
    """Whether Adam has come to stay near the optimum, or its time is up."""
    return trace.settled(optimum, SETTLED, close) or trace.elapsed > limit


def iterated(trace: Trace) -> Run:
    """A run of a solver that has no learning rate."""
    return Run(trace, f"{len(trace.values)} iterations in all")
