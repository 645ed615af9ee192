"""One uniform material: pilot, global search, Levenberg-Marquardt, then all samples."""

from __future__ import annotations

from collections.abc import Callable

import torch

from matest.capture import Samples
from matest.estimators.levenberg_marquardt import Solution, minimise
from matest.estimators.linearise import Statistics, accumulate
from matest.estimators.pilot import pilot
from matest.estimators.problem import Problem
from matest.estimators.search import search

_PILOT, _SEARCH = 24_000, 4_000
_REWEIGHTINGS = 2
_PILOT_PASSES, _FULL_PASSES = 60, 20

Progress = Callable[[str], None]


def fit_pilot(problem: Problem, samples: Samples, seed: int) -> Solution:
    """The global optimum on a stratified subsample: no initial guess is asked for."""
    found = search(problem, pilot(samples, _SEARCH, seed))
    batches = pilot(samples, _PILOT, seed)

    def descend(start: torch.Tensor, reference: torch.Tensor | None) -> Solution:
        def evaluate(unknowns: torch.Tensor) -> Statistics:
            return accumulate(found.problem, unknowns, batches, reference)

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
    found = fit_pilot(problem, samples, seed)
    start = found.unknowns

    def evaluate(unknowns: torch.Tensor) -> Statistics:
        progress("refining over all samples")
        return accumulate(found.problem, unknowns, samples.tiles(), start)

    return minimise(found.problem, start, evaluate, passes=_FULL_PASSES, tolerance=0.03)
