"""The optimum on the pilot, a few thousand samples in memory: every start is followed, and the best optimum kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from matest.estimators.levenberg_marquardt import MAX_PASSES, Solution, minimise
from matest.estimators.one_step import expand_likelihood
from matest.estimators.passes import passes_over
from matest.estimators.plausibility import (
    EQUAL_CHI2,
    count_at_ends,
    implausibility,
    length_of,
    most_plausible,
    separation,
)
from matest.estimators.starts import initial_solutions, subsample, with_huber_noise
from matest.estimators.unknowns import Problem
from matest.samples import Batch, Tile
from matest.samples.batch import join
from matest.samples.tiles import in_memory
from matest.workers import single_threaded_torch

# The likelihood is expanded about one optimum after the other, at most this many times; most fits need three or four.
_MAX_EXPANSIONS = 40
# The same with errors of the calibration: those of a capture that no such error explains could go on for long.
_CALIBRATED_EXPANSIONS = 8
# Passes for each of these.
_CALIBRATED_PASSES = 20
# Standard errors. An expansion that moves the optimum by less is the last: the rest is far below the error bar.
_LAST_MOVE = 0.05
# Standard errors. A fit that comes this close to another optimum is abandoned, since it would end there.
_SAME_OPTIMUM_DISTANCE = 0.2
# Standard errors. An optimum that the next expansion will move needs no smaller last step than this.
_MIN_TOLERANCE = 0.01
# Standard errors. A step that is taken without evaluating where it leads may be no longer than this.
_MAX_TOLERANCE = 1.0
# Last step of an expansion as a share of what the expansion before moved; at 1 such steps could go round in circles.
_TOLERANCE_SHARE = 0.5
# Share of outliers above which the search is repeated: with fewer they cannot have misled it.
_RESTART_OUTLIER_SHARE = 0.001
# Each repetition starts from a better solution; later ones bring nothing.
_MAX_RESTARTS = 3
# Standard errors. What a repeated search finds closer than this to the best optimum is that optimum.
_NEW_OPTIMUM_DISTANCE = 10.0
# Fits with a corrected limit of the light scale; the limit converges in two or three.
_MAX_LIMIT_ROUNDS = 6
# Relative change of the limit of the light scale that is rounding.
_LIMIT_CHANGE = 1e-6
# Samples times lights. Fewer are one tile: every call of torch costs as much as a thousand samples.
_ONE_TILE_SIZE = 10_000


@single_threaded_torch()
def fit_batches(problem: Problem, batches: list[Batch], start: Tensor | None = None) -> Solution:
    """The optimum on a few thousand samples held in memory.

    Args:
        problem: what is estimated.
        batches: the samples.
        start: u [P] near the optimum; None: searched for globally, no initial guess is needed.
    """
    tiles = _tiles(batches)
    best = most_plausible(_optima(initial_solutions(problem, batches, start), tiles))
    if start is None:
        best = _search_with_less_outliers(best, batches, tiles)
    best = _with_own_limit(best, tiles)
    ordered = best.problem.ordered(best.unknowns)
    if not torch.equal(ordered, best.unknowns):
        best = _descend(best.problem, ordered, ordered, tiles, _MIN_TOLERANCE)
    return replace(best, tiles=in_memory(tiles))


def _tiles(batches: list[Batch]) -> list[Tile]:
    """The samples in one or two tiles: every call costs as much as a thousand samples."""
    size = sum(len(batch) * batch.points.wi.shape[-2] for batch in batches)
    half = len(batches) if size < _ONE_TILE_SIZE else (len(batches) + 1) // 2
    return [Tile(join(group), cache={}) for group in (batches[:half], batches[half:]) if group]


def _descend(problem: Problem, start: Tensor, reference: Tensor, tiles: list[Tile], tolerance: float) -> Solution:
    """The optimum near `start` u [P] of the likelihood expanded about `reference` u [P]."""
    residual_scale, expanded = expand_likelihood(problem, tiles, reference)
    evaluate = passes_over(problem, in_memory(expanded), start, None, residual_scale)
    passes = _CALIBRATED_PASSES if problem.nuisances else MAX_PASSES
    solution = minimise(problem, start, evaluate, passes=passes, tolerance=tolerance)
    return replace(solution, residual_scale=residual_scale)


def _optima(starts: Sequence[Solution], tiles: list[Tile]) -> list[Solution]:
    """The distinct optima of the likelihood that starts lead to."""
    optima: list[Solution] = []
    for start in starts:
        solution = follow(start.problem, start.unknowns, tiles, optima)
        if not _is_among(optima, solution):
            optima.append(solution)
    return optima


def follow(
    problem: Problem,
    start: Tensor,
    tiles: list[Tile],
    optima: Sequence[Solution] = (),
    expansions: int | None = None,
) -> Solution:
    """The optimum of the likelihood that a start u [P] leads to, or a solution near one of the `optima`.

    Args:
        problem: what is estimated.
        start: u [P].
        tiles: the samples.
        optima: that are known.
        expansions: of the likelihood, at most; None: as many as it takes.
    """
    unknowns, move = start, 1.0
    for _ in range(expansions or (_CALIBRATED_EXPANSIONS if problem.nuisances else _MAX_EXPANSIONS)):
        # The next expansion moves the optimum too: no use in knowing this one much better than that.
        tolerance = min(max(_TOLERANCE_SHARE * move, _MIN_TOLERANCE), _MAX_TOLERANCE)
        solution = _descend(problem, unknowns, unknowns, tiles, tolerance)
        move, unknowns = length_of(solution.unknowns - unknowns, solution), solution.unknowns
        if move < _LAST_MOVE or _is_among(optima, solution):
            break
    return solution


def _is_among(optima: Sequence[Solution], solution: Solution) -> bool:
    """Whether a solution is near one of the optima, and that one is at no more ends of domains."""
    return any(
        separation(optimum, solution) < _SAME_OPTIMUM_DISTANCE and count_at_ends(optimum) <= count_at_ends(solution)
        for optimum in optima
    )


def _search_with_less_outliers(best: Solution, batches: list[Batch], tiles: list[Tile]) -> Solution:
    """Repeat the search with less weight for samples far from the best solution, where there are many outliers.

    The first search gave outliers full weight, and they may have misled it.
    """
    if best.statistics.outliers <= _RESTART_OUTLIER_SHARE:
        return best
    for _ in range(_MAX_RESTARTS):
        before = best
        starts = initial_solutions(best.problem, [with_huber_noise(best, subsample(batches))], None)
        new = [start for start in starts if separation(before, start) > _NEW_OPTIMUM_DISTANCE]
        best = most_plausible([before, *_optima(new, tiles)])
        if implausibility(best) > implausibility(before) - EQUAL_CHI2 * before.residual_scale.typical**2:
            break
    return best


def _with_own_limit(best: Solution, tiles: list[Tile]) -> Solution:
    """Fit with the limit of the light scale that the solution itself gives.

    The search takes the limit from a fit without interreflection, whose albedos are too bright and limit too low.
    """
    for _ in range(_MAX_LIMIT_ROUNDS if best.problem.gauges else 0):
        limit = best.problem.limit_of_gauges(best.unknowns)
        if abs(limit / best.problem.light_scale_limit - 1) < _LIMIT_CHANGE:
            break
        problem = best.problem.limited(limit)
        best = _descend(problem, torch.minimum(best.unknowns, problem.upper), best.unknowns, tiles, _MIN_TOLERANCE)
    return best
