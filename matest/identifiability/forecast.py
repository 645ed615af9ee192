"""The error bars that photographs of a nominal material will give, without taking them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial

import numpy as np
import torch
from torch import Tensor

from matest.estimation.freeing import worth_freeing
from matest.estimation.specification import freed
from matest.estimators import Problem, accumulate
from matest.identifiability.nominal import Nominal
from matest.identifiability.plan import photographs_of
from matest.inference.budget import Budget
from matest.inference.error_bars import expected_error_bars
from matest.inference.expansion import Expansion
from matest.inference.posterior import Posterior, foresee
from matest.inference.profiles import surroundings
from matest.inference.valleys import bent_valleys
from matest.photographs.photographs import Photographs
from matest.photographs.samples import PhotographSamples
from matest.progress import Progress
from matest.samples import Tile

# Samples in one tile: bounds the memory of a pass.
_TILE_SAMPLES = 65_536
# Samples that a forecast reads, spread evenly; information is an integral over the images and needs no more.
_ENOUGH_SAMPLES = 400_000


@dataclass(frozen=True)
class Forecast:
    """What photographs will tell of a problem at given values.

    Attributes:
        problem: what is estimated.
        unknowns: the values u [P] it is predicted for.
        information: JᵀWJ [P, P].
        values: expected number of pixel values.
        budget: how the estimate moves with errors of the calibration; None: error bars are those of the noise alone.
    """

    problem: Problem
    unknowns: Tensor
    information: Tensor
    values: int
    budget: Budget | None = None

    def __add__(self, more: Forecast) -> Forecast:
        """Both sets of photographs together, by the noise alone."""
        information, values = self.information + more.information, self.values + more.values
        return Forecast(self.problem, self.unknowns, information, values)

    @property
    def std(self) -> Tensor:
        """Standard errors [P]; infinite where not determined."""
        covariance = expected_error_bars(self.expansion, self.budget).covariance
        return torch.where(covariance.undetermined, math.inf, covariance.std)

    @property
    def references(self) -> Tensor:
        """What standard errors are compared with [P]."""
        return references(self.problem, self.unknowns)

    @property
    def relative_std(self) -> Tensor:
        return self.std / self.references

    @property
    def worst(self) -> tuple[int, float]:
        """Number of unknowns that are not determined, and the largest relative standard error of the others.

        The stand-in for the unknown light scale is a nuisance and does not count.
        """
        relative = self.relative_std[~self.expansion.gauges]
        determined = relative[torch.isfinite(relative)]
        return len(relative) - len(determined), float(determined.max()) if len(determined) else 0.0

    @cached_property
    def expansion(self) -> Expansion:
        """χ² about these values, which are its minimum."""
        return Expansion(self.problem, self.unknowns, self.information, torch.zeros(self.problem.size).double())

    @cached_property
    def posterior(self) -> Posterior:
        """What `estimate` would report if its solution had exactly these values."""
        return foresee(self.expansion, self.budget)

    @cached_property
    def by_noise(self) -> Forecast:
        """The same without errors of the calibration."""
        return self if self.budget is None else replace(self, budget=None)


def references(problem: Problem, unknowns: Tensor) -> Tensor:
    """What standard errors of u [P] are compared with: the values; where one is zero, the width of its domain."""
    sizes = unknowns.abs().clone()
    for name, place in problem.where.items():
        width = problem.declared(name).domain.width
        sizes[place] = torch.where(sizes[place] > 0, sizes[place], width if math.isfinite(width) else 1.0)
    return sizes


def predicted_samples(photographs: Photographs, problem: Problem, unknowns: Tensor) -> PhotographSamples:
    """The samples that photographs of the material at `unknowns` will give."""
    return photographs_of(problem.material(unknowns), photographs).samples(dtype=torch.float64)


def spread_tiles(samples: PhotographSamples) -> tuple[list[list[Callable[[], Tile]]], dict[int, float]]:
    """Tiles of evenly spread samples, and how many samples each of these stands for, by position of the image."""
    step = max(len(samples) / _ENOUGH_SAMPLES, 1.0)
    tiles: list[list[Callable[[], Tile]]] = []
    weights: dict[int, float] = {}
    for position in range(len(samples.images)):
        index = samples.indices(position)
        subset = index[np.arange(0, len(index), step).astype(int)]
        if not len(subset):
            continue
        weights[position] = len(index) / len(subset)
        chunks = (subset[start : start + _TILE_SAMPLES] for start in range(0, len(subset), _TILE_SAMPLES))
        tiles.append([partial(_tile, samples, position, chunk) for chunk in chunks])
    return tiles, weights


def _tile(samples: PhotographSamples, position: int, index: np.ndarray) -> Tile:
    """Some pixels of an image, in one group: nothing is to be told apart within an image."""
    return Tile(replace(samples.at(position, index), groups=samples.labels(position, index[:1]).expand(len(index))))


def forecast(samples: PhotographSamples, problem: Problem, unknowns: Tensor) -> Forecast:
    """The information of predicted photographs.

    Args:
        samples: of `predicted_samples`.
        problem: what will be estimated; it may have more free parameters than the samples were predicted with.
        unknowns: u [P] of the problem.
    """
    if problem.gauges:
        problem = problem.limited(problem.limit_of_gauges(unknowns))
    tiles, weights = spread_tiles(samples)
    statistics = accumulate(problem, unknowns, tiles, unknowns)
    positions = samples.groups.image[statistics.labels]
    each = torch.tensor([weights[position] for position in positions.tolist()], dtype=torch.float64)
    information = (each[:, None, None] * statistics.informations).sum(0)
    return Forecast(problem, unknowns, information, len(samples) * samples.photographs.channels)


def at_levels(
    photographs: Photographs,
    problem: Problem,
    levels: Sequence[Mapping[str, Tensor]],
    progress: Progress,
    budget: Callable[[Forecast, PhotographSamples], Budget | None] = lambda *_: None,
) -> list[Forecast]:
    """The forecast at other values of the parameters, for each of some levels.

    Args:
        photographs: of which only geometry, lights and camera count.
        problem: what will be estimated.
        levels: values of all parameters.
        progress: called with a word.
        budget: how the estimate moves with errors of the calibration.
    """
    forecasts = []
    for values in levels:
        progress("trying other roughnesses")
        unknowns = problem.unknowns_at(values)
        samples = predicted_samples(photographs, problem, unknowns)
        by_noise = forecast(samples, problem, unknowns)
        forecasts.append(replace(by_noise, budget=budget(by_noise, samples)))
    return forecasts


def bent_names(forecast: Forecast, samples: PhotographSamples) -> tuple[str, ...]:
    """Names of the parameters along a valley of χ² that bends: their standard errors hold near these values only."""
    tiles, weights = spread_tiles(samples)
    share = 1 / max(weights.values(), default=1.0)
    around = cache(partial(surroundings, forecast.problem, forecast.unknowns, tiles, share=share))
    positions = bent_valleys(forecast.expansion, around)
    return tuple(
        name for name, place in forecast.problem.where.items() if positions & {*range(place.start, place.stop)}
    )


def as_estimated(
    samples: PhotographSamples, nominal: Nominal, beside: Callable[[Forecast], Forecast] = lambda alone: alone
) -> tuple[Forecast, Forecast]:
    """The forecast of what `estimate` will free, and the one with everything free that is held by default.

    `estimate` frees a parameter held by default where the photographs determine it.

    Args:
        samples: of `predicted_samples`.
        nominal: the model and its values.
        beside: adds further photographs to a forecast.
    """
    specification, problem = nominal.specification, nominal.problem

    def predict(problem: Problem) -> Forecast:
        return beside(forecast(samples, problem, problem.unknowns_at(nominal.values)))

    usual = predict(problem)
    if not specification.default_held:
        return usual, usual
    all_free = predict(freed(specification, specification.default_held).problem)
    names = worth_freeing(all_free.problem, specification.default_held, all_free.unknowns, all_free.information)
    freer_problem = freed(specification, names).problem
    if freer_problem.free == problem.free:
        return usual, all_free
    freer = predict(freer_problem)
    is_determined = all(estimate.status != "not determined" for estimate in freer.posterior.estimates.values())
    return freer if is_determined else usual, all_free
