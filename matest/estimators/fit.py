"""One uniform material: pilot, global search, Levenberg-Marquardt, then all samples."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import torch

from matest.capture import Batch, Samples
from matest.estimators.levenberg_marquardt import Solution, minimise
from matest.estimators.linearise import Statistics, accumulate, single_threaded_torch
from matest.estimators.pilot import pilot
from matest.estimators.problem import Problem
from matest.estimators.search import search

_PILOT, _SEARCH = 24_000, 4_000
_REWEIGHTINGS = 2
_PILOT_PASSES, _FULL_PASSES = 60, 20

Progress = Callable[[str], None]


def fit_batches(problem: Problem, batches: list[Batch]) -> Solution:
    """The global optimum on a few thousand samples held in memory: no initial guess is asked for."""
    total = sum(len(batch) for batch in batches)
    thinned = [batch[:: max(total // _SEARCH, 1)] for batch in batches]
    with single_threaded_torch():
        found = search(problem, thinned)
    tiles = [partial(_itself, batch) for batch in batches]

    def descend(start: torch.Tensor, reference: torch.Tensor | None) -> Solution:
        def evaluate(unknowns: torch.Tensor) -> Statistics:
            return accumulate(found.problem, unknowns, tiles, reference)

        return minimise(found.problem, start, evaluate, passes=_PILOT_PASSES, tolerance=0.01)

    solutions = [descend(start, None) for start in found.starts()]
    best = min(solutions, key=lambda solution: solution.statistics.total("chi2"))
    for _ in range(_REWEIGHTINGS):
        best = descend(best.unknowns, best.unknowns)
    return best


def fit(problem: Problem, samples: Samples, seed: int, progress: Progress = lambda _: None) -> Solution:
    """The maximum-likelihood estimate from all samples: from the pilot's optimum, passes over everything.

    From there one Gauss-Newton step has the full efficiency; a second pass proves that it did. Weights stay those of
    the pilot's optimum: they need not be exact, and fixed ones make χ² a cost that can be compared between passes.
    """
    progress("searching")
    found = fit_batches(problem, pilot(samples, _PILOT, seed))
    start = found.unknowns
    tiles = all_tiles(samples)

    def evaluate(unknowns: torch.Tensor) -> Statistics:
        progress("refining over all samples")
        return accumulate(found.problem, unknowns, tiles, start)

    return minimise(found.problem, start, evaluate, passes=_FULL_PASSES, tolerance=0.03)


def all_tiles(samples: Samples) -> list[Callable[[], Batch]]:
    """Every sample, tile by tile, computed when a worker asks for it."""
    return [partial(samples.at, *piece) for piece in samples.pieces()]


def _itself(batch: Batch) -> Batch:
    return batch
