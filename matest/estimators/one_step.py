"""The likelihood of samples in memory expanded about a solution, and whether one step from there is enough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from matest.estimators.levenberg_marquardt import Solution, bounded_step, moved, step_is_visible, step_length
from matest.estimators.passes import accumulate, radiance_model
from matest.estimators.statistics import Statistics
from matest.estimators.unknowns import Problem
from matest.samples import Tile
from matest.samples.likelihood import Deviations, deviations
from matest.samples.residual_scale import ResidualScale
from matest.samples.tiles import in_memory
from matest.workers import single_threaded_torch

# Standard errors. A fit ends where the next step would be shorter: it would change an error bar by less than 0.1 %.
END_TOLERANCE = 0.03
# Standard errors. A step that misses by less is corrected by what the pilot's samples say of the miss.
_CORRECTABLE = 0.5
# χ² per value up to which one step over all samples is enough: residuals of the model do not bend the cost then.
_ONE_STEP_CHI2 = 1.05


def expand_likelihood(problem: Problem, tiles: list[Tile], unknowns: Tensor) -> tuple[ResidualScale, list[Tile]]:
    """The residual scale at u [P], and the tiles with the likelihood expanded there."""
    model = radiance_model(problem, unknowns)
    with torch.no_grad():
        return expand_about([model(tile) for tile in tiles], tiles)


def expand_about(references: Sequence[Tensor], tiles: Sequence[Tile]) -> tuple[ResidualScale, list[Tile]]:
    """The residual scale, and the tiles with the likelihood expanded about a radiance [n, C] of each."""
    parts = [
        deviations(radiance, tile.batch.radiance, tile.batch.noise)
        for tile, radiance in zip(tiles, references, strict=True)
    ]
    together = Deviations(*(torch.cat(column) for column in zip(*parts, strict=True)))
    residual_scale = ResidualScale.of(torch.cat([tile.half_angles for tile in tiles]), together)
    problems = [tile.about(radiance, residual_scale) for tile, radiance in zip(tiles, references, strict=True)]
    return residual_scale, [replace(tile, least_squares=one) for tile, one in zip(tiles, problems, strict=True)]


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
    length = step_length(problem, change, statistics.information, end.inflation)
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
    miss_length = step_length(problem, miss, statistics.information, end.inflation)
    if problem.nuisances and miss_length < _CORRECTABLE:
        # A pass costs several of those without errors of the calibration: the pilot says how far the step overshoots.
        return Solution(problem, moved(problem, target, -miss), end, 1, miss_length**2, True)
    if not miss_length < END_TOLERANCE:
        return None
    return Solution(problem, target, end, 1, miss_length, True)
