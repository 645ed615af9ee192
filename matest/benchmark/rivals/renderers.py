"""Mitsuba 3 and Dr.Jit on the photographs of a glossy sphere, in a process of their own."""

from __future__ import annotations

import os
import pickle
import tempfile
from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool
from functools import lru_cache, partial

import numpy as np
import torch

from matest.benchmark.instruments.contest import GLOSSY, Contest, sphere_of
from matest.benchmark.instruments.task import CLOSE, Task, Trace, Values
from matest.benchmark.rivals import drjit_solver, mitsuba_tutorial
from matest.benchmark.rivals.hand_written import optimum
from matest.benchmark.rivals.solvers import tuned
from matest.workers import processes

MISSING = (
    'not measured: Mitsuba 3 or LLVM is missing; pip install "matest-brdf[peers]", install LLVM (Debian: apt-get '
    "install libllvm19) and, if it is not found, set DRJIT_LIBLLVM_PATH to its libLLVM.so"
)
NAMES = ("mitsuba", "mitsuba, compiling", "dr.jit", "dr.jit, prepared", "dr.jit, compiling")
# Adam's learning rates that are tried in Mitsuba, the most promising first.
RATES = (0.1, 0.03, 0.3)
# Runs of the Dr.Jit solver after the one that compiles.
ROUNDS = 3
# Relative distance from the optimum at which Adam ends: where errors at the end count, nearer than "arrived".
STILL = 1e-3
# Seconds after which a run of Mitsuba ends.
PATIENCE = 120.0
PATIENCE_QUICK = 2.0

Runs = dict[str, list[Trace]]


@lru_cache(maxsize=1)
def race_of_sphere(size: int, patience: float) -> Runs:
    """`race` on a glossy sphere, which takes minutes: run once for all suites that show it."""
    contest = sphere_of(GLOSSY, size)
    return race(contest, optimum(contest.task, contest.truth), patience, STILL)


def race(contest: Contest, best: Values, patience: float, close: float = CLOSE) -> Runs:
    """Runs of both from the task's start, by name; none if Mitsuba, Dr.Jit or LLVM is missing or unusable.

    `mitsuba` is its tutorial with every learning rate, `dr.jit` the hand-written solver, both compiled before;
    `…, compiling` counts the compiling too, `dr.jit, prepared` leaves out what is computed once. Compiled kernels are
    kept in the home directory: an empty one makes the first run compile. LLVM may end the process that it does not
    suit: that shall not be this one.

    Args:
        contest: a sphere of `cook-torrance(masking=smith)`.
        best: optimum of the likelihood.
        patience: seconds after which a run of Adam ends.
        close: relative distance from the optimum, of every parameter, at which it may end earlier.
    """
    with tempfile.TemporaryDirectory() as home, processes(1, _at_home, home) as pool:
        try:
            return pickle.loads(pool.submit(_race, contest.task, contest.images(), best, patience, close).result())
        except (ImportError, BrokenProcessPool):
            return {"mitsuba": [], "dr.jit": []}


def _at_home(home: str) -> None:
    os.environ["HOME"] = home


def _race(task: Task, images: np.ndarray, best: Values, patience: float, close: float) -> bytes:
    runs: Runs = {name: [] for name in NAMES}
    for name, trace in _runs(task, images, best, patience, close):
        runs[name].append(trace)
    # As bytes: between processes, torch sends every tensor through a file of its own.
    return pickle.dumps(runs)


def _runs(task: Task, images: np.ndarray, best: Values, patience: float, close: float) -> Iterator[tuple[str, Trace]]:
    # Before anything of matest takes a core: both spread over all of them.
    yield "dr.jit, compiling", drjit_solver.levenberg_marquardt(task)[0]
    for _ in range(ROUNDS):
        trace, preparation = drjit_solver.levenberg_marquardt(task)
        yield "dr.jit", trace
        yield "dr.jit, prepared", trace.shifted(-preparation)
    channels = images.shape[-1]
    start = {name: torch.atleast_1d(task.start.parameters[name]) for name in ("diffuse", "specular")}
    start = {name: value.expand(channels) for name, value in start.items()} | {"slope": task.start.parameters["slope"]}
    once = partial(mitsuba_tutorial.tutorial, images, start)
    cold, warm = (once(RATES[0], lambda trace: len(trace.values) == 1).seconds[0] for _ in range(2))
    for trace in tuned(once, RATES, best, patience, close=close):
        yield "mitsuba", trace
        yield "mitsuba, compiling", trace.shifted(cold - warm)
