"""Where to start: the distinct optima of a first least-squares problem that a global search leads to."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import torch
from torch import Tensor

from matest.errors import InputError
from matest.estimators.basis import TangentBasis
from matest.estimators.levenberg_marquardt import MAX_PASSES, Solution, minimise
from matest.estimators.passes import accumulate, compress, statistics_at
from matest.estimators.plausibility import implausibility, separation
from matest.estimators.search import search
from matest.estimators.unknowns import Problem
from matest.samples import Batch, Tile
from matest.samples.batch import join
from matest.samples.likelihood import Readout
from matest.samples.tiles import in_memory

# Samples that are enough to find the valley of every optimum; a fourth of them are where each is lit from everywhere.
_SEARCH_SAMPLES, _FEWEST_SEARCHED = 4_000, 1_000
# Those samples times directions of light, at most.
_SEARCH_SHADED = 64 * _SEARCH_SAMPLES
# Standard errors. Starts further apart than this are followed each to its end.
_DISTINCT_SEPARATION = 1.0
# Standard errors. The likelihood moves a start by much more than the last step to it.
_TOLERANCE = 0.01
# Standard deviations of the noise. Huber's cost grows linearly beyond: between his 1.3 and the 4 that are trusted.
_HUBER_DEVIATION = 2.0


def initial_solutions(problem: Problem, batches: list[Batch], start: Tensor | None) -> list[Solution]:
    """Distinct optima of least squares with the weights of `likelihood.first_guess` on a few thousand of the samples.

    Args:
        problem: what is estimated.
        batches: single samples.
        start: u [P] near the optimum; None: searched for globally.

    Raises:
        InputError: the model gives nothing that can be compared with the samples.
    """
    solutions: list[Solution] = []
    for batch in _with_and_without_saturated(subsample(batches)):
        tile = Tile(batch)
        tiles = in_memory([replace(tile, least_squares=tile.first_guess())])
        # One set of moments serves the search and every descent from it, where columns depend on no unknown.
        compressed = compress(problem, tiles, None, None) if problem.separates else None
        starts = [] if start is None else [start]
        if start is None:
            grid = search(problem, [batch], compressed)
            problem, starts = grid.problem, grid.starts()
        for first in starts:
            evaluate = partial(accumulate, problem, tiles=tiles, reference=None)
            if compressed is not None:
                evaluate = partial(statistics_at, problem, compressed)
            solutions.append(minimise(problem, first, evaluate, passes=MAX_PASSES, tolerance=_TOLERANCE))
    solutions = [solution for solution in solutions if math.isfinite(implausibility(solution))]
    if not solutions:
        raise InputError(
            f"{problem.brdf.expression} cannot be compared with the images: the misfit is not finite, whatever its "
            "parameters; check the noise and the images, or try another model."
        )
    distinct: list[Solution] = []
    for solution in sorted(solutions, key=implausibility):
        if all(separation(other, solution) > _DISTINCT_SEPARATION for other in distinct):
            distinct.append(solution)
    return distinct


def subsample(batches: list[Batch]) -> Batch:
    """Every n-th sample, n such that a few thousand remain in all; fewer of those with many directions of light."""
    directions = max(max(batch.points.wi.shape[-2] for batch in batches), 1)
    count = max(min(_SEARCH_SAMPLES, _SEARCH_SHADED // directions), _FEWEST_SEARCHED)
    step = max(sum(len(batch) for batch in batches) // count, 1)
    return join([batch[::step] for batch in batches]).ungrouped


def with_huber_noise(solution: Solution, batch: Batch) -> Batch:
    """The samples with a larger noise the farther they lie from a solution, so that least squares is Huber's (1964).

    Unlike weights that reject what lies far, these still let a highlight that the solution has missed be found.
    """
    with torch.no_grad():
        radiance = TangentBasis(solution.problem, solution.unknowns, derivatives=False).radiance(batch)
        variance = batch.variance(radiance)
        deviation = (batch.radiance - radiance).abs() / variance.sqrt() / solution.residual_scale.at(batch.points)
        variance = variance * (deviation / _HUBER_DEVIATION).clamp(min=1)
    readout = Readout(variance, torch.zeros_like(variance[:1]))
    return replace(batch, noise=replace(batch.noise, readout=readout))


def _with_and_without_saturated(batch: Batch) -> list[Batch]:
    """The samples, clipped values taken as measured, and where any are saturated the samples without clipped ones.

    Without its saturated middle a highlight may not be seen at all; with it, it is taken for flat.
    """
    clipped = batch.noise.clipped
    if clipped is None or not bool((clipped > 0).any()):
        return [batch]
    unclipped = (clipped == 0).all(-1).nonzero()[:, 0]
    return [batch, batch[unclipped]] if len(unclipped) else [batch]
