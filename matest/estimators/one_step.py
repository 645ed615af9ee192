"""The likelihood of samples in memory expanded about a solution, and whether one step from there is enough."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from matest.estimators.levenberg_marquardt import Solution, bounded_step, moved, step_is_visible
from matest.estimators.passes import accumulate, radiance_model
from matest.estimators.statistics import Statistics
from matest.estimators.unknowns import Problem
from matest.samples import Tile
from matest.samples.likelihood import TRUSTED
from matest.samples.tiles import in_memory
from matest.workers import single_threaded_torch

# Standard errors. A fit ends where the next step would be shorter: it would change an error bar by less than 0.1 %.
END_TOLERANCE = 0.03
# χ² per value up to which one step over all samples is enough: residuals of the model do not bend the cost then.
_ONE_STEP_CHI2 = 1.05
# Share of the values that may be outliers.
_MAX_OUTLIER_SHARE = 0.1
# Median of |N(0, 1)|.
_MEDIAN_DEVIATION = 0.6745
# Standard deviation of the median of n such values relative to it, times √n.
_MEDIAN_STD = 1.166
# Standard deviations of that median up to which the residuals are the noise.
_CHANCE_DEVIATIONS = 3.0


def expand_likelihood(problem: Problem, tiles: list[Tile], unknowns: Tensor) -> tuple[float, list[Tile]]:
    """The residual scale at u [P], and the tiles with the likelihood expanded there.

    The scale is the median residual in standard deviations of the noise, as a multiple of a Gaussian's; at least 1, and
    large enough for no more than a tenth of the values to be outliers: a model that misses more does not fit.
    """
    model = radiance_model(problem, unknowns)
    with torch.no_grad():
        return expand_about([model(tile) for tile in tiles], tiles)


def expand_about(references: Sequence[Tensor], tiles: Sequence[Tile]) -> tuple[float, list[Tile]]:
    """The residual scale, and the tiles with the likelihood expanded about a radiance [n, C] of each."""
    problems = [tile.about(radiance) for tile, radiance in zip(tiles, references, strict=True)]
    deviations = [
        ((tile.batch.radiance - radiance).abs() / tile.batch.variance(radiance).sqrt())[one.plain]
        for tile, radiance, one in zip(tiles, references, problems, strict=True)
    ]
    residual_scale = _residual_scale(torch.cat(deviations).double())
    if residual_scale > 1:
        problems = [tile.about(radiance, residual_scale) for tile, radiance in zip(tiles, references, strict=True)]
    return residual_scale, [replace(tile, least_squares=one) for tile, one in zip(tiles, problems, strict=True)]


def _residual_scale(deviations: Tensor) -> float:
    """The scale of absolute residuals, in standard deviations of the noise [n]."""
    if not len(deviations):
        return 1.0
    trusted_count = max(int((1 - _MAX_OUTLIER_SHARE) * len(deviations)), 1)
    largest_trusted = float(deviations.kthvalue(trusted_count).values)
    typical = float(deviations.median()) / _MEDIAN_DEVIATION
    # Clipped values count with this scale and others without: one that is chance would move the optimum.
    if typical < 1 + _CHANCE_DEVIATIONS * _MEDIAN_STD / math.sqrt(len(deviations)):
        typical = 1.0
    return max(typical, largest_trusted / TRUSTED, 1.0)


@single_threaded_torch()
def single_step(start: Solution, statistics: Statistics) -> Solution | None:
    """The Gauss-Newton step over all samples, where a second one would be negligible; None where it might not be.

    Two things make one step miss the optimum. The curvature of the model: the pilot's samples show its effect, if their
    measured radiance is replaced by the model's at the step's end, where the step should then lead. The curvature that
    residuals add: where the model holds they are noise, and it falls with the root of the number of samples.

    Args:
        start: the pilot's optimum and samples.
        statistics: of all samples there.
    """
    problem, unknowns = start.problem, start.unknowns
    change = bounded_step(problem, unknowns, statistics.information, statistics.gradient)
    end = statistics.moved(change)
    length = _length(change, statistics, end.inflation)
    if end.reduced_chi2 > _ONE_STEP_CHI2 or not step_is_visible(problem, unknowns, change, length):
        return None
    target = moved(problem, unknowns, change)
    end_radiance = radiance_model(problem, target)
    _, tiles = expand_likelihood(problem, [tile() for group in start.tiles for tile in group], unknowns)
    with torch.no_grad():
        noise_free = [
            replace(tile, least_squares=tile.least_squares._replace(response=end_radiance(tile)))
            for tile in tiles
            if tile.least_squares is not None
        ]
    pilot = accumulate(problem, unknowns, in_memory(noise_free), None)
    if pilot.prior is not None:
        # Priors too lead to the step's end, as if they were about it.
        pilot = replace(pilot, prior=replace(pilot.prior, below=change))
    miss = bounded_step(problem, unknowns, pilot.information, pilot.gradient) - change
    miss_length = _length(miss, statistics, end.inflation)
    if not miss_length < END_TOLERANCE:
        return None
    return Solution(problem, target, end, 1, miss_length, True)


def _length(change: Tensor, statistics: Statistics, inflation: float) -> float:
    """The length of a change of u [P] in standard errors, jointly."""
    return math.sqrt(max(float(change @ statistics.information @ change), 0.0) / inflation)
