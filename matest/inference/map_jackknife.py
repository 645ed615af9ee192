"""Error bars of maps where the model does not hold: how they move when one photograph is left out."""

from __future__ import annotations

import torch

from matest.estimators.covariance import fisher
from matest.estimators.texels.maps import MapFit
from matest.estimators.texels.small_systems import Factored
from matest.inference.budget import Budget
from matest.inference.map_calibration import MapBudget, at_some_texels
from matest.samples.account import CalibratedSamples
from matest.workers import single_threaded_torch

# Name of what residuals add, among errors of the calibration.
MISFIT = "misfit"
# Photographs that a jackknife needs.
FEWEST_IMAGES = 3
# Least size of a value that errors are relative to.
_TINY = 1e-9


@single_threaded_torch()
@torch.no_grad()
def map_jackknife(fit: MapFit, samples: CalibratedSamples, count: int, seed: int) -> MapBudget:
    """How maps and what is in common scatter with the photographs, by one step without each of them.

    Args:
        fit: of the maps.
        samples: that were fitted, of at least three photographs.
        count: of texels that say so.
        seed: of the choice of these.
    """
    _, here = at_some_texels(fit, samples, count, seed)
    tile, theta = here.tile, here.theta
    size, images = len(theta), tile.images
    by_image = here.problem.by_image(theta, [*fit.texels.rows, *fit.texels.common])
    moves, steps = [], []
    for image in range(images):
        information = by_image.information.sum(2) - by_image.information[:, :, image]
        gradient = by_image.gradient.sum(1) - by_image.gradient[:, image]
        gradient[:size] += here.prior.precision * (here.prior.mean - theta)
        own = information[:size, :size].clone()
        own.diagonal().add_(here.prior.precision.T)
        factored = Factored.of(own)
        first = factored.solve(gradient[:size])
        follow = -factored.solve(information[:size, size:]) if len(gradient) > size else information[:size, size:]
        common = (information[size:, size:] + (information[size:, :size, None] * follow[None]).sum(1)).sum(-1).double()
        score = (gradient[size:] + (follow * gradient[:size, None]).sum(0)).sum(-1).double()
        step = fisher(common, torch.ones(len(score), dtype=torch.bool)).matrix @ score
        steps.append(step)
        moves.append(first + torch.einsum("tsn,s->tn", follow, step.to(follow)))
    factor = (images - 1) / images
    every, common_steps = torch.stack(moves), torch.stack(steps)
    every, common_steps = every - every.mean(0), common_steps - common_steps.mean(0)
    relative = (factor * every.square().sum(0)).sqrt() / theta.abs().clamp(min=_TINY)
    means = (factor * every.double().mean(-1).square().sum(0)).sqrt()
    scatter = fit.information @ (factor * common_steps.T @ common_steps) @ fit.information
    return MapBudget(tile.texels, relative, means, Budget(fit.information, {MISFIT: scatter}))
