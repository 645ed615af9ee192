"""The error bars that photographs of a nominal material will give, without taking them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial

import numpy as np
import torch
from torch import Tensor

from matest.estimation.freeing import worth_freeing
from matest.estimation.specification import Specification, freed
from matest.estimators import Problem, accumulate
from matest.identifiability.plan import photographed
from matest.inference.expansion import Expansion
from matest.inference.posterior import foresee
from matest.inference.profiles import surroundings
from matest.inference.quantities import ParameterEstimate
from matest.inference.valleys import bent_valleys
from matest.photographs.photographs import Photographs
from matest.photographs.samples import PhotographSamples
from matest.samples import Tile

# PhotographSamples of a tile.
_TILE = 65_536
# More samples than this are thinned evenly: information is an integral over the images, and needs no more.
_ENOUGH = 400_000


@dataclass(frozen=True)
class Forecast:
    """What photographs will tell of a problem at given values.

    Attributes:
        problem: what is estimated.
        unknowns: the values u [P] it is predicted for.
        information: JᵀWJ [P, P].
        values: expected number of pixel values.
    """

    problem: Problem
    unknowns: Tensor
    information: Tensor
    values: int

    def __add__(self, more: Forecast) -> Forecast:
        """Both sets of photographs together."""
        return replace(self, information=self.information + more.information, values=self.values + more.values)

    @property
    def std(self) -> Tensor:
        """Standard errors [P]; infinite where not determined."""
        covariance = self.expansion.covariance
        return torch.where(covariance.undetermined, math.inf, covariance.std)

    @property
    def references(self) -> Tensor:
        """What standard errors are compared with [P]: the values; where one is zero, the width of its domain."""
        sizes = self.unknowns.abs().clone()
        for name, place in self.problem.where.items():
            width = self.problem.declared(name).domain.width
            sizes[place] = torch.where(sizes[place] > 0, sizes[place], width if math.isfinite(width) else 1.0)
        return sizes

    @property
    def relative_std(self) -> Tensor:
        return self.std / self.references

    @property
    def worst(self) -> tuple[int, float]:
        """Number of unknowns that are not determined, and the largest relative standard error of the others.

        The stand-in for the unknown light scale is a nuisance and does not count.
        """
        counted = torch.ones(self.problem.size, dtype=torch.bool)
        for name in self.problem.gauges:
            counted[self.problem.where[name]] = False
        relative = self.relative_std[counted]
        lost = ~torch.isfinite(relative)
        return int(lost.sum()), float(relative[~lost].max()) if bool((~lost).any()) else 0.0

    def estimates(self) -> Mapping[str, ParameterEstimate]:
        """Every parameter as `estimate` would report it if it found exactly these values."""
        return foresee(self.expansion).estimates

    @cached_property
    def expansion(self) -> Expansion:
        """χ² about these values, which are its minimum."""
        return Expansion(self.problem, self.unknowns, self.information, torch.zeros(self.problem.size).double())


def unknowns_at(problem: Problem, values: Mapping[str, Tensor]) -> Tensor:
    """u [P] from a value (a scalar, or [C]) of every free parameter."""
    return torch.cat([torch.atleast_1d(values[name]).double().expand(problem.count(name)) for name in problem.free])


def usable(photographs: Photographs, problem: Problem, unknowns: Tensor) -> PhotographSamples:
    """The samples that photographs of the material at `unknowns` will give."""
    return photographed(photographs, problem.material(unknowns)).samples(dtype=torch.float64)


def thinned(samples: PhotographSamples) -> tuple[list[list[Callable[[], Tile]]], dict[int, float]]:
    """Tiles of at most so many samples as are enough, and how many each stands for, by position of the image."""
    share = max(len(samples) / _ENOUGH, 1.0)
    tiles: list[list[Callable[[], Tile]]] = []
    weights: dict[int, float] = {}
    for position in range(len(samples.images)):
        index = samples.indices(position)
        kept = index[np.arange(0, len(index), share).astype(int)]
        if not len(kept):
            continue
        weights[position] = len(index) / len(kept)
        tiles.append(
            [partial(_tile, samples, position, kept[start : start + _TILE]) for start in range(0, len(kept), _TILE)]
        )
    return tiles, weights


def _tile(samples: PhotographSamples, position: int, index: np.ndarray) -> Tile:
    """Some pixels of an image, in one group: nothing is to be told apart within an image."""
    return Tile(replace(samples.at(position, index), groups=samples.labels(position, index[:1]).expand(len(index))))


def forecast(samples: PhotographSamples, problem: Problem, unknowns: Tensor) -> Forecast:
    """The information of predicted photographs.

    Args:
        samples: of `usable`.
        problem: what will be estimated; it may have more free parameters than the samples were predicted with.
        unknowns: u [P] of the problem.
    """
    if problem.gauges:
        problem = problem.limited(problem.limit_of_gauges(unknowns))
    tiles, weights = thinned(samples)
    statistics = accumulate(problem, unknowns, tiles, unknowns)
    positions = samples.groups.image[statistics.labels]
    each = torch.tensor([weights[position] for position in positions.tolist()], dtype=torch.float64)
    information = (each[:, None, None] * statistics.informations).sum(0)
    return Forecast(problem, unknowns, information, len(samples) * samples.photographs.channels)


def bent_near(found: Forecast, samples: PhotographSamples) -> tuple[str, ...]:
    """Names of the parameters whose standard errors hold near the values assumed only."""
    tiles, weights = thinned(samples)
    share = 1 / max(weights.values(), default=1.0)
    around = cache(partial(surroundings, found.problem, found.unknowns, tiles, share=share))
    positions = bent_valleys(found.expansion, around)
    return tuple(name for name, place in found.problem.where.items() if positions & {*range(place.start, place.stop)})


def as_estimated(
    samples: PhotographSamples,
    specification: Specification,
    values: Mapping[str, Tensor],
    beside: Callable[[Forecast], Forecast] = lambda found: found,
) -> tuple[Forecast, Forecast]:
    """The forecast of what `estimate` will free, and the one with everything free that is held by default.

    A parameter held by default is freed where these images determine it, with those that `beside` adds to a forecast.
    """

    def predicted(problem: Problem) -> Forecast:
        return beside(forecast(samples, problem, unknowns_at(problem, values)))

    problem = specification.problem
    alone = predicted(problem)
    if not specification.default_held:
        return alone, alone
    everything = predicted(freed(specification, specification.default_held).problem)
    chosen = worth_freeing(everything.problem, specification.default_held, everything.unknowns, everything.information)
    freer = freed(specification, chosen).problem
    if freer.free == problem.free:
        return alone, everything
    found = predicted(freer)
    lost = any(estimate.status == "not determined" for estimate in found.estimates().values())
    return alone if lost else found, everything
