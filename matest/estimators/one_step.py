"""The likelihood of samples in memory expanded about a solution, and what that says of a step from there."""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from matest.estimators.levenberg_marquardt import Solution, bounded_step, seen
from matest.estimators.passes import accumulate, radiances
from matest.estimators.statistics import Statistics
from matest.estimators.unknowns import Problem
from matest.samples import Tile
from matest.samples.likelihood import TRUSTED
from matest.samples.tiles import in_memory
from matest.workers import single_threaded_torch

# A fit ends where the next step would be shorter than so many standard errors. One step over all samples is enough if
# χ² per value is below this.
CLOSE, _HOLDS = 0.03, 1.05
# No more of the values than this can be outliers.
_MOST_OUTLIERS = 0.1
# Median of |N(0, 1)|.
_MEDIAN_DEVIATION = 0.6745


def settled(problem: Problem, tiles: list[Tile], unknowns: Tensor) -> tuple[float, list[Tile]]:
    """The residual scale at u [P], and the tiles with the likelihood expanded there.

    The scale is the median residual in standard deviations of the noise, as a multiple of a Gaussian's; at least 1, and
    large enough for no more than a tenth of the values to be outliers: a model that misses more does not fit.
    """
    model = radiances(problem, unknowns)
    with torch.no_grad():
        references = [model(tile) for tile in tiles]
        problems = [tile.about(radiance) for tile, radiance in zip(tiles, references, strict=True)]
        deviations = [
            ((tile.batch.radiance - radiance).abs() / tile.batch.variance(radiance).sqrt())[problem.plain]
            for tile, radiance, problem in zip(tiles, references, problems, strict=True)
        ]
        every, residual_scale = torch.cat(deviations).double(), 1.0
        if len(every):
            most = float(every.kthvalue(max(int((1 - _MOST_OUTLIERS) * len(every)), 1)).values)
            residual_scale = max(float(every.median()) / _MEDIAN_DEVIATION, most / TRUSTED, 1.0)
        if residual_scale > 1:
            problems = [tile.about(radiance, residual_scale) for tile, radiance in zip(tiles, references, strict=True)]
    return residual_scale, [replace(tile, least_squares=one) for tile, one in zip(tiles, problems, strict=True)]


@single_threaded_torch()
def single_step(start: Solution, statistics: Statistics) -> Solution | None:
    """The Gauss-Newton step over all samples, where a second one would be negligible; None where that is not known.

    A model that holds bends the step in two ways: by its own curvature, which the pilot's samples show without their
    noise (how far does one step miss the target if the target's own radiance is photographed?), and by that of its
    residuals, which noise alone makes smaller by the root of the number of samples.

    Args:
        start: the pilot's optimum and samples.
        statistics: of all samples there.
    """
    problem, unknowns = start.problem, start.unknowns
    change = bounded_step(problem, unknowns, statistics.information, statistics.gradient)
    arrived = statistics.moved(change)
    length = math.sqrt(max(float(change @ statistics.information @ change), 0.0) / arrived.inflation)
    if arrived.reduced_chi2 > _HOLDS or not seen(problem, unknowns, change, length):
        return None
    target = radiances(problem, unknowns + change)
    _, tiles = settled(problem, [tile() for group in start.tiles for tile in group], unknowns)
    with torch.no_grad():
        imagined = [
            replace(tile, least_squares=tile.least_squares._replace(response=target(tile)))
            for tile in tiles
            if tile.least_squares is not None
        ]
    again = accumulate(problem, unknowns, in_memory(imagined), None)
    missed = bounded_step(problem, unknowns, again.information, again.gradient) - change
    length = math.sqrt(max(float(missed @ statistics.information @ missed), 0.0) / arrived.inflation)
    return Solution(problem, unknowns + change, arrived, 1, length, True) if length < CLOSE else None
