"""What stated errors of the calibration add to the error bars of maps, and of the parameters beside them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from matest.brdf import Brdf
from matest.estimators.calibrated import CalibratedModel
from matest.estimators.covariance import fisher
from matest.estimators.texels.elimination import Elimination
from matest.estimators.texels.fit import TexelFitter, TileFit
from matest.estimators.texels.maps import MapFit
from matest.estimators.texels.problem import TexelProblem
from matest.estimators.unknowns import Problem
from matest.inference.budget import Budget
from matest.samples.account import CalibratedSamples
from matest.workers import single_threaded_torch

# Families of errors that a map has no use for: it is what they are instead of, or they need the pixels around each.
BESIDE_MAPS = ("albedo_field", "albedo_noise", "blur")
# Texels whose errors are averaged.
_NEIGHBOURS = 4
# Least size of a value that errors are relative to.
_TINY = 1e-9


@dataclass(frozen=True, eq=False)
class MapBudget:
    """How maps move with errors of the calibration, to first order, at some texels.

    Attributes:
        texels: their places among the N pixels of the object, int64 [m].
        relative: standard deviation of their unknowns relative to the values [T, m].
        means: standard deviation of the mean of each unknown over all texels [T].
        common: the same for the unknowns in common.
    """

    texels: Tensor
    relative: Tensor
    means: Tensor
    common: Budget


@single_threaded_torch()
def map_budget(
    fit: MapFit, problem: Problem, spreads: Mapping[str, float], samples: CalibratedSamples, count: int, seed: int
) -> MapBudget:
    """How maps move with errors of the calibration.

    Where the parameters in common stand still θ moves by H⁻¹ JᵀW ν, for errors ν of the radiance; where these move too
    it follows them.

    Args:
        fit: of the maps.
        problem: of the fit, with families of errors.
        spreads: standard deviation of the errors of these families as a whole, by name.
        samples: that were fitted.
        count: of texels that say so.
        seed: of the choice of these.
    """
    fitter, here = at_some_texels(fit, samples, count, seed)
    tile, theta = here.tile, here.theta
    elimination = Elimination.of(fitter, here)
    inside = elimination.sums()
    inverse = fisher(inside.information, torch.ones(len(inside.scores), dtype=torch.bool)).matrix
    size = len(fit.texels.rows)
    total, means = torch.zeros_like(theta), torch.zeros(size, dtype=torch.float64)
    scatters = {name: torch.zeros_like(inside.information) for name in spreads}
    for name, change in _changes(fit, problem, samples, here, count, seed):
        family = problem.family(name)
        spread = spreads[name] * family.spread
        gradient = _gradient(fit, here, change)
        own = (elimination.covariance * gradient[:size]).sum(1)
        if family.of_pixels:
            # Errors of single pixels leave what is in common alone: there are too many of them.
            total += (spread * own).square()
            continue
        follow = gradient[size:] + (elimination.moves * gradient[:size, None]).sum(0)
        score = follow.sum(-1, dtype=torch.float64)
        move = own + torch.einsum("tsn,s->tn", elimination.moves, (inverse @ score).to(own))
        total += (spread * move).square()
        means += (spread * move.double().mean(-1)).square()
        scatters[name] += spread**2 * score[:, None] * score
    relative = total.sqrt() / theta.abs().clamp(min=_TINY)
    # As if all texels had said so.
    turn = fit.information @ inverse
    scatters = {name: turn @ scatter @ turn.T for name, scatter in scatters.items()}
    return MapBudget(tile.texels, relative, means.sqrt(), Budget(fit.information, scatters))


def at_some_texels(fit: MapFit, samples: CalibratedSamples, count: int, seed: int) -> tuple[TexelFitter, TileFit]:
    """The maps at about `count` random texels that photographs show, with their samples, and what regions say."""
    tile = samples.some_texels(count, seed)
    tile = tile.some((~fit.theta[0, tile.texels].isnan()).nonzero()[:, 0])
    fitter = TexelFitter(fit.texels, fit.unknowns, fit.residual_scale)
    theta = fit.theta[:, tile.texels]
    prior = fit.regions.prior(fit.regions.labels(theta), fit.own[:, tile.texels], fit.inflation)
    return fitter, fitter.at(tile, theta, prior)


def _gradient(fit: MapFit, here: TileFit, change: Tensor) -> Tensor:
    """JᵀW times a change of the radiance [I·m, C], for the unknowns of texels and those in common [T + S, m]."""
    squares = here.problem.squares._replace(response=here.radiance + change)
    rows = [*fit.texels.rows, *fit.texels.common]
    return TexelProblem.of(here.problem, squares, here.theta).normal(here.theta, rows).gradient


def _changes(
    fit: MapFit, problem: Problem, samples: CalibratedSamples, here: TileFit, count: int, seed: int
) -> Iterator[tuple[str, Tensor]]:
    """How the radiance of a tile changes with each error, by the family of it [I·m, C]."""
    tile = here.tile
    batch, _ = samples.of_pixels(count, seed)
    assert batch.pixels is not None
    batch = batch[torch.isin(batch.pixels, tile.texels)]
    assert batch.pixels is not None
    texel = torch.searchsorted(tile.texels, batch.pixels)
    unknowns = problem.anywhere.clone()
    unknowns[: fit.texels.problem.size] = fit.unknowns
    model = CalibratedModel(problem, unknowns, _material(fit, unknowns, here.theta[:, texel]))
    slopes = model.by_errors(batch)
    groups = problem.groups.group_of(batch)
    rows = problem.groups.image[groups] * len(tile) + texel
    column = 0
    for block in problem.nuisances:
        family = problem.family(block.name)
        places = family.places[groups]
        for unknown in range(family.count):
            change = torch.zeros_like(here.radiance)
            for k in range(family.width):
                touched = (places[:, k] == unknown).nonzero()[:, 0]
                change[rows[touched]] += slopes[:, column + k, touched].T
            yield block.name, change
        column += family.width


def _material(fit: MapFit, unknowns: Tensor, theta: Tensor) -> Brdf:
    """The material with the values θ [T, n] of the texels of n samples."""
    problem = fit.texels.problem
    material = problem.material(unknowns[: problem.size])
    values = {name: theta[fit.texels.at(name)].T for name in fit.texels.mapped}
    values |= {name: values[source] for name, source in problem.ties.items() if source in values}
    return material.replace(values)


def over_all(budget: MapBudget, places: np.ndarray) -> Tensor:
    """Relative standard deviations at all N texels [T, N]: those of the nearest texels that say so, on average.

    Light and shape vary smoothly over an object, and errors with them.

    Args:
        budget: at some texels.
        places: row and column of every texel [N, 2].
    """
    known = places[budget.texels.numpy()]
    _, nearest = cKDTree(known).query(places, k=min(_NEIGHBOURS, len(known)))
    squares = budget.relative.square()[:, torch.from_numpy(np.atleast_2d(nearest.T).T.copy())]
    return squares.mean(-1).sqrt()
