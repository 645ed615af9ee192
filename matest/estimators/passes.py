"""Passes over samples, and the additive statistics that they give."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import torch
from torch import Tensor

from matest.estimators.basis import Basis, SeparatedBasis, TangentBasis, coefficients
from matest.estimators.calibrated import CalibratedModel, accumulate_calibrated
from matest.estimators.column_statistics import ColumnStatistics
from matest.estimators.columns import Columns
from matest.estimators.moments import Moments, empty_moments, moments, sum_moments
from matest.estimators.statistics import Statistics
from matest.estimators.tile_sums import Expanded, over_tiles
from matest.estimators.unknowns import Problem
from matest.samples import Tile, Tiles
from matest.samples.likelihood import LeastSquares
from matest.samples.residual_scale import NOISE_ALONE, ResidualScale

# Statistics at any unknowns.
Evaluate = Callable[[Tensor], Statistics]


def accumulate(
    problem: Problem,
    unknowns: Tensor,
    tiles: Tiles,
    reference: Tensor | None,
    residual_scale: ResidualScale = NOISE_ALONE,
) -> Statistics:
    """One pass: the additive statistics at `unknowns`.

    Tiles are fetched and worked on by one thread per processor, and added up in their order: the result does not
    depend on the number of threads.

    Args:
        problem: what is estimated.
        unknowns: u [P], float64.
        tiles: groups of functions that give a tile each; the tiles of a group are worked on at the same time.
        reference: the likelihood is expanded about the model's radiance for these unknowns (`likelihood.about`); None:
            about the measured radiance, for a first guess.
        residual_scale: by which outliers are judged.
    """
    if problem.nuisances:
        return accumulate_calibrated(problem, unknowns, tiles, reference, residual_scale)
    here = TangentBasis(problem, unknowns)
    same = reference is not None and torch.equal(reference, unknowns)
    there = None if reference is None or same else TangentBasis(problem, reference, derivatives=False)

    def expand(tile: Tile) -> tuple[Columns, Tensor, Tensor | None]:
        columns = here.columns(tile)
        radiance = here.radiance_of(columns, tile.batch)
        if reference is None or tile.least_squares is not None:
            return columns, radiance, None
        return columns, radiance, there.radiance(tile.batch) if there else radiance

    compressed = _sum_columns(tiles, expand, here, residual_scale)
    return compressed.statistics(problem, unknowns, here.coefficients, here.slopes)


def compress(
    problem: Problem,
    tiles: Tiles,
    origin: Tensor | None,
    reference: Tensor | None,
    residual_scale: ResidualScale = NOISE_ALONE,
) -> ColumnStatistics:
    """One pass over the samples of a problem that `separates`; statistics at any unknowns follow from it.

    Args:
        problem: what is estimated.
        tiles: as in `accumulate`.
        origin: u [P] near the optimum, whose radiance is subtracted first, so that small residuals keep their digits.
            Light whose reflectance there is below zero counts as none. None: nothing is subtracted.
        reference: the likelihood is expanded about the model's radiance for these unknowns; None: about the measured.
        residual_scale: by which outliers are judged.
    """
    here = SeparatedBasis(problem, origin)
    there = here
    if reference is not None and (origin is None or not torch.equal(reference, origin)):
        there = SeparatedBasis(problem, reference)

    def expand(tile: Tile) -> tuple[Columns, Tensor, Tensor | None]:
        columns = here.columns(tile)
        radiance = torch.zeros_like(tile.batch.radiance) if origin is None else here.radiance_of(columns, tile.batch)
        if reference is None:
            return columns, radiance, None
        return columns, radiance, radiance if there is here else there.radiance_of(columns, tile.batch)

    return _sum_columns(tiles, expand, here, residual_scale)


def statistics_at(problem: Problem, compressed: ColumnStatistics, unknowns: Tensor) -> Statistics:
    """The statistics that a pass over the samples at u [P] would give."""
    weights = coefficients(problem, unknowns)
    return compressed.statistics(problem, unknowns, weights.total, weights.slopes)


def passes_over(
    problem: Problem, tiles: Tiles, origin: Tensor, reference: Tensor | None, residual_scale: ResidualScale
) -> Evaluate:
    """The function that gives the statistics at any unknowns near `origin`.

    Each call costs a pass over the samples; where the model separates, one pass serves all calls.

    Arguments are those of `compress`.
    """
    if problem.separates:
        return partial(statistics_at, problem, compress(problem, tiles, origin, reference, residual_scale))
    return partial(accumulate, problem, tiles=tiles, reference=reference, residual_scale=residual_scale)


def radiance_model(problem: Problem, unknowns: Tensor) -> Callable[[Tile], Tensor]:
    """The function that gives the radiance [n, C] of a tile at u [P]."""
    if problem.nuisances:
        calibrated = CalibratedModel(problem, unknowns)
        return lambda tile: calibrated.radiance(tile.batch)
    basis: Basis
    if problem.separates:
        basis = SeparatedBasis(problem, unknowns)
    else:
        basis = TangentBasis(problem, unknowns, derivatives=False)
    return lambda tile: basis.radiance_of(basis.columns(tile), tile.batch)


def _sum_columns(
    tiles: Tiles,
    expand: Callable[[Tile], tuple[Columns, Tensor, Tensor | None]],
    basis: Basis,
    residual_scale: ResidualScale,
) -> ColumnStatistics:
    """Sum the moments of all samples.

    Args:
        tiles: as in `accumulate`.
        expand: gives the columns of a tile, the radiance [n, C] that is subtracted for the residuals, and the radiance
            that the likelihood is expanded about (None: the measured).
        basis: gives the subtracted radiance.
        residual_scale: by which outliers are judged.
    """

    def sums(tile: Tile) -> Expanded[Moments]:
        columns, radiance, reference = expand(tile)

        def moments_of(tile: Tile, problem: LeastSquares) -> Moments:
            return moments(columns, problem, problem.response - radiance, tile.batch.groups)

        return Expanded(reference, moments_of)

    total = sum_moments([empty_moments(*basis.coefficients.shape), *over_tiles(tiles, sums, residual_scale)])
    return ColumnStatistics(basis.coefficients, basis.multiplier, total)
