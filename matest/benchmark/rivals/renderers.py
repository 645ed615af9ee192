"""Mitsuba 3 and Dr.Jit on a task, in a process of their own."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import NamedTuple

import torch

from matest.benchmark.instruments.subjects import GLOSSY, sphere_of
from matest.benchmark.instruments.task import CLOSE, Task, Trace, Values
from matest.benchmark.rivals import drjit_solver, mitsuba_tutorial
from matest.benchmark.rivals.hand_written import cook_torrance_smith
from matest.benchmark.rivals.mitsuba_tutorial import Photographs
from matest.benchmark.rivals.solvers import SETTLED, STILL
from matest.workers import processes

MISSING = (
    'not measured: Mitsuba 3 or LLVM is missing; pip install "matest-brdf[peers]", install LLVM (Debian: apt-get '
    "install libllvm19) and, if it is not found, set DRJIT_LIBLLVM_PATH to its libLLVM.so"
)
# Adam's learning rates that are tried in Mitsuba; the most promising first, others end when they take twice as long.
RATES = (0.1, 0.03, 0.3)
ROUNDS = 3
# A run of Mitsuba ends after so many seconds.
PATIENCE, PATIENCE_QUICK = 120.0, 2.0


class Prepared(NamedTuple):
    """A run of the Dr.Jit solver, and the seconds until its first iteration."""

    trace: Trace
    preparation: float


@dataclass(frozen=True)
class Race:
    """Runs of both.

    Attributes:
        tutorial: Mitsuba and Adam, a run for every learning rate, its code compiled before.
        compiling: seconds that compiling adds to the first step.
        drjit: the hand-written solver, compiled before.
        drjit_first: the same when its code is yet to be compiled.
    """

    tutorial: dict[float, Trace]
    compiling: float
    drjit: list[Prepared]
    drjit_first: Prepared

    @classmethod
    def from_plain(cls, plain: dict) -> Race:
        """From what the other process hands over."""
        return cls(
            {rate: _trace(one) for rate, one in plain["tutorial"].items()},
            plain["compiling"],
            [Prepared(_trace(one), before) for one, before in plain["drjit"]],
            Prepared(_trace(plain["drjit_first"][0]), plain["drjit_first"][1]),
        )


@lru_cache(maxsize=1)
def race_of_sphere(size: int, patience: float) -> Race | None:
    """`race` on the photographs of a glossy sphere, which take minutes: run once for all suites that show it."""
    found = sphere_of(GLOSSY, size)
    return race(found.task, found.photographs(), found.optimum(cook_torrance_smith), patience, STILL)


def race(task: Task, photographs: Photographs, optimum: Values, patience: float, close: float = CLOSE) -> Race | None:
    """Run both from the task's start; None if Mitsuba, Dr.Jit or LLVM is missing or unusable.

    Compiled kernels are kept in the home directory: an empty one makes the first run compile. LLVM may end the process
    that it does not suit: that shall not be this one.

    Args:
        task: samples of the photographs, for `cook-torrance(masking=smith)`.
        photographs: the same as images.
        optimum: of the likelihood; of `task`.
        patience: seconds after which a run of Adam ends.
        close: relative distance from the optimum, of every parameter, at which it may end earlier.
    """
    with tempfile.TemporaryDirectory() as home, processes(1, _at_home, home) as pool:
        try:
            return Race.from_plain(pool.submit(_race, task, photographs, optimum, patience, close).result())
        except (ImportError, BrokenProcessPool):
            return None


def _at_home(home: str) -> None:
    os.environ["HOME"] = home


def _race(task: Task, photographs: Photographs, optimum: Values, patience: float, close: float) -> dict:
    # Before anything of matest takes a core: both spread over all of them.
    first = drjit_solver.levenberg_marquardt(task)
    again = [drjit_solver.levenberg_marquardt(task) for _ in range(ROUNDS)]
    channels = photographs.radiance.shape[-1]
    start = {name: torch.atleast_1d(task.start.parameters[name]) for name in ("diffuse", "specular")}
    start = {name: value.expand(channels) for name, value in start.items()} | {"slope": task.start.parameters["slope"]}
    run = partial(mitsuba_tutorial.tutorial, photographs, start)
    cold, warm = (run(RATES[0], lambda trace: len(trace.values) == 1).seconds[0] for _ in range(2))
    found, shortest = {}, patience
    for rate in RATES:
        trace = run(rate, _settled_or(optimum, close, min(patience, 2 * shortest)))
        arrived = trace.arrival(optimum) if trace.settled(optimum, SETTLED) else None
        shortest = shortest if arrived is None else min(shortest, arrived)
        found[rate] = _plain(trace)
    return {
        "tutorial": found,
        "compiling": cold - warm,
        "drjit": [(_plain(trace), before) for trace, before in again],
        "drjit_first": (_plain(first[0]), first[1]),
    }


def _settled_or(optimum: Values, close: float, limit: float) -> Callable[[Trace], bool]:
    return lambda trace: trace.settled(optimum, SETTLED, close) or trace.elapsed > limit


def _plain(trace: Trace) -> tuple[list[float], list[dict[str, list[float]]]]:
    """Without tensors: each would be sent through a file of its own."""
    return trace.seconds, [{name: value.tolist() for name, value in values.items()} for values in trace.values]


def _trace(plain: tuple[list[float], list[dict[str, list[float]]]]) -> Trace:
    seconds, values = plain
    return Trace(seconds=seconds, values=[{name: torch.tensor(v) for name, v in one.items()} for one in values])
