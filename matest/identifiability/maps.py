"""What each number of photographs allows where parameters have a value at every pixel, before any fit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from matest.estimation.freeing import worth_freeing
from matest.estimation.mapping import SOME_TEXELS, mapped_names
from matest.estimators import Problem
from matest.estimators.texels.expected import ExpectedTexels, Told
from matest.estimators.texels.regions import AMPLITUDE_TOLD, SHAPE_TOLD
from matest.estimators.texels.small_systems import Factored
from matest.estimators.texels.unknowns import TexelUnknowns
from matest.identifiability.forecast import Forecast, references
from matest.inference.quantities import Number
from matest.photographs.samples import PhotographSamples
from matest.progress import Progress
from matest.samples.texels import TexelTile
from matest.workers import single_threaded_torch

# Samples of the pixels that stand for all, about.
_SAMPLES = 24_000
# Pixels among these, at least, however many photographs there are.
_FEWEST_TEXELS = 250
# Samples by which photographs are put in order, about: a sum of logarithms needs few.
_ORDERED_BY = 6_000
_FEWEST_ORDERED_BY = 50
# Numbers of photographs that are looked at: these, and doubled again and again.
_COUNTS = (1, 2, 3, 4, 6, 8, 12)
# Seed of the choice of pixels.
_SEED = 0
# Ends and middle of a distribution.
_QUARTILES = (0.25, 0.5, 0.75)


@dataclass(frozen=True)
class MapForecast:
    """What some photographs tell of a parameter with a value at every pixel.

    Attributes:
        known: share of the object's pixels whose own value the photographs tell, as `ParameterMap.determined`.
        known_range: the least and the largest share over all levels of the shape parameters that were not given; None
            where there is only one level.
        relative: quartiles, over the pixels that the photographs light, of std over value, the worst channel's; of a
            shape by the pixel's own photographs, of anything else with the shapes known that are shared; None where
            they light none.
        relative_range: the least and the largest median over all levels; None likewise.
    """

    known: float
    known_range: tuple[float, float] | None
    relative: tuple[float, float, float] | None
    relative_range: tuple[float, float] | None


@dataclass(frozen=True)
class SomePhotographs:
    """What some of the photographs allow.

    Attributes:
        images: which, in the order in which they tell most.
        lit: share of the object's pixels that they light.
        maps: by name of the parameter.
        common: std over value of the parameters in common to all pixels, the worst channel's; None where they are not
            determined, or held for that.
        as_one: the same of each mapped shape if it were in common to all pixels instead, which is what pixels take that
            do not tell their own.
    """

    images: list[int]
    lit: float
    maps: dict[str, MapForecast]
    common: dict[str, float | None]
    as_one: dict[str, float | None]


@dataclass(frozen=True)
class MappedParameter:
    """A parameter that is to have a value at every pixel.

    Attributes:
        value: that is assumed of every pixel.
        unit: of it.
        is_shape: whether it shapes the reflectance; others only multiply it.
        limit: std over value up to which a pixel counts as known.
    """

    value: Number
    unit: str
    is_shape: bool
    limit: float


@dataclass(frozen=True)
class MapsForecast:
    """What each number of photographs allows where parameters have a value at every pixel.

    By the noise alone, every pixel having the assumed values.

    Attributes:
        parameters: that are mapped, by name.
        photographs: by their number, the least first; the last are all.
        relative: whether the strength of the lights is unknown, so that maps are known up to one scale.
        pixels: of the object.
    """

    parameters: dict[str, MappedParameter]
    photographs: list[SomePhotographs]
    relative: bool
    pixels: int


@single_threaded_torch()
def forecast_maps(
    samples: PhotographSamples,
    forecast: Forecast,
    words: Sequence[str],
    levels: Sequence[Mapping[str, Tensor]],
    default_held: Sequence[str],
    progress: Progress,
) -> MapsForecast:
    """What each number of photographs allows.

    The photographs are put in the order in which each tells most of all parameters of a pixel, those before it known:
    the gain of log det of the information is the largest (D-optimality). The first k of this order are the k of a row.

    Args:
        samples: predicted for the photographs at the assumed values.
        forecast: of one value for all pixels, with those parameters free that `estimate` frees.
        words: names as `--maps` takes them.
        levels: other values of all parameters.
        default_held: parameters that `estimate` frees only where the photographs determine them.
        progress: called with a word.

    Raises:
        InputError: a parameter that is not estimated, or cannot have a map.
    """
    problem, images = forecast.problem, len(samples.images)
    found = {name for word in words for name in mapped_names(problem, word)}
    mapped = tuple(name for name in problem.free if name in found)
    may_be_held = [name for name in default_held if name in problem.where and name not in found]
    progress("predicting maps")
    tile = samples.some_texels(min(max(_SAMPLES // max(images, 1), _FEWEST_TEXELS), SOME_TEXELS), _SEED)
    share = len(tile) / max(samples.texels, 1)

    @cache
    def at_levels(held: tuple[str, ...]) -> list[_Level]:
        each = [problem.values(forecast.unknowns), *levels]
        return [_Level.of(TexelUnknowns(_held(problem, held, values), mapped), values, tile) for values in each]

    def row(places: list[int]) -> SomePhotographs:
        held: tuple[str, ...] = ()
        if may_be_held and len(places) < images:
            information = at_levels(())[0].expected.in_common(places, ()) / share
            freed = worth_freeing(problem, may_be_held, forecast.unknowns, information)
            held = tuple(name for name in may_be_held if name not in freed)
        return _some(at_levels(held), places, [samples.images[place] for place in places], share, held)

    order = _order(at_levels(())[0].expected)
    return MapsForecast(
        parameters={name: _mapped(problem, forecast.unknowns, name) for name in mapped},
        photographs=[row(order[:count]) for count in _counts(images)],
        relative=problem.relative,
        pixels=samples.texels,
    )


def _held(problem: Problem, names: Sequence[str], values: Mapping[str, Tensor]) -> Problem:
    """The problem with some more parameters held at their values."""
    blocks = tuple(block for block in problem.blocks if block.name not in names)
    return replace(problem, blocks=blocks, held={**problem.held, **{name: values[name] for name in names}})


def _mapped(problem: Problem, unknowns: Tensor, name: str) -> MappedParameter:
    is_shape = name in problem.shapes
    limit = SHAPE_TOLD if is_shape else AMPLITUDE_TOLD
    return MappedParameter(problem.values(unknowns)[name].tolist(), problem.declared(name).unit, is_shape, limit)


def _counts(images: int) -> list[int]:
    """Numbers of photographs that are looked at, the last being all."""
    counts = [*_COUNTS]
    while counts[-1] < images:
        counts.append(2 * counts[-2])
    return [count for count in counts if count < images] + [images]


class _AtLevel(NamedTuple):
    """What some photographs tell at one level.

    Attributes:
        lit: share of the pixels that they light.
        maps: share of the pixels that are known, and quartiles of their relative errors, by name.
        common: of the parameters in common; None: there are none.
    """

    lit: float
    maps: dict[str, tuple[float, tuple[float, float, float] | None]]
    common: Forecast | None


@dataclass(frozen=True, eq=False)
class _Level:
    """Texels of one value.

    Attributes:
        texels: the unknowns.
        unknowns: u [P].
        expected: what samples will tell.
    """

    texels: TexelUnknowns
    unknowns: Tensor
    expected: ExpectedTexels

    @classmethod
    def of(cls, texels: TexelUnknowns, values: Mapping[str, Tensor], tile: TexelTile) -> _Level:
        """The texels of a tile at the values of all parameters."""
        unknowns = texels.problem.unknowns_at(values)
        return cls(texels, unknowns, ExpectedTexels.of(texels, unknowns, tile))

    def told(self, images: list[int], share: float) -> _AtLevel:
        """What some of the images, by their places, tell; the tile has a `share` of the object's pixels."""
        told = self.expected.told(images)
        common = self.in_common(images, self.texels.mapped, share, told)
        relative, maps = self._relative_std(told, common)[:, told.seen], {}
        for name in self.texels.mapped:
            rows, quartiles = self.texels.at(name), None
            if relative.shape[1]:
                low, middle, high = np.quantile(relative[rows].amax(0).numpy(), _QUARTILES).tolist()
                quartiles = (low, middle, high)
            maps[name] = (float(told.own[rows].all(0).double().mean()), quartiles)
        return _AtLevel(float(told.seen.double().mean()), maps, common)

    def in_common(
        self, images: list[int], mapped: Sequence[str], share: float, told: Told | None = None
    ) -> Forecast | None:
        """The forecast of the parameters in common to all pixels; None where there are none.

        Args:
            images: by their places.
            mapped: the other parameters.
            share: of the object's pixels that the tile has.
            told: of the pixels, which of them tell of what is in common; None: all do.
        """
        values = self.texels.problem.values(self.unknowns)
        rest = _held(self.texels.problem, mapped, values)
        if not rest.blocks:
            return None
        information = self.expected.in_common(images, mapped, None if told is None else told.counted) / share
        return Forecast(rest, rest.unknowns_at(values), information, 0)

    def _relative_std(self, told: Told, common: Forecast | None) -> Tensor:
        """Standard errors over values of θ [T, n], those of the parameters in common included."""
        variance = told.variance
        if common is not None:
            matrix = common.expansion.covariance.matrix
            variance = variance + torch.einsum("tsn,su,tun->tn", told.moves, matrix, told.moves)
        return variance.sqrt() / references(self.texels.problem, self.unknowns)[self.texels.places, None]


def _order(expected: ExpectedTexels) -> list[int]:
    """The images, each the one that tells most of all unknowns of a texel beside those before it."""
    texels, problem = expected.texels, expected.texels.problem
    images, texel_count = len(expected.informations), expected.informations.shape[-1]
    step = max(texel_count // max(_ORDERED_BY // images, _FEWEST_ORDERED_BY), 1)
    rows = [*texels.mapped, *(name for name in problem.free if name not in texels.mapped)]
    # Where nothing is told, an unknown lies somewhere in its domain.
    width = TexelUnknowns(problem, tuple(rows)).width(expected.unknowns)
    informations = expected.informations[..., ::step] * (width * width.T)[..., None]
    before = torch.eye(len(width), dtype=informations.dtype)[..., None].expand_as(informations[0])
    left, order = list(range(images)), []
    while left:
        trials = before + informations[left]
        diagonal = torch.stack(Factored.of(trials.permute(1, 2, 0, 3).flatten(2)).diagonal)
        gains = diagonal.log().sum(0).unflatten(0, (len(left), -1)).sum(1)
        best = int(gains.argmax())
        before = trials[best]
        order.append(left.pop(best))
    return order


def _some(
    levels: Sequence[_Level], places: list[int], images: list[int], share: float, held: Sequence[str]
) -> SomePhotographs:
    """What some of the photographs allow.

    Args:
        levels: the assumed values first.
        places: of the photographs among the samples.
        images: their numbers.
        share: of the object's pixels that the tile has.
        held: parameters that are held as they do not determine them.
    """
    first, texels = levels[0], levels[0].texels
    at_levels = [level.told(places, share) for level in levels]
    amplitudes = [name for name in texels.mapped if name not in texels.shapes]
    as_one = first.in_common(places, amplitudes, share) if texels.shapes else None
    common = [name for name in texels.problem.free if name not in texels.mapped]
    return SomePhotographs(
        images=images,
        lit=at_levels[0].lit,
        maps={name: _map_forecast([level.maps[name] for level in at_levels]) for name in texels.mapped},
        common={**_errors(at_levels[0].common, common), **dict.fromkeys(held)},
        as_one=_errors(as_one, texels.shapes),
    )


def _map_forecast(levels: Sequence[tuple[float, tuple[float, float, float] | None]]) -> MapForecast:
    """The forecast of a map from known shares and quartiles at all levels."""
    shares = [share for share, _ in levels]
    medians = [quartiles[1] for _, quartiles in levels if quartiles is not None]
    several = len(levels) > 1
    return MapForecast(
        known=shares[0],
        known_range=(min(shares), max(shares)) if several else None,
        relative=levels[0][1],
        relative_range=(min(medians), max(medians)) if several and medians else None,
    )


def _errors(forecast: Forecast | None, names: Sequence[str]) -> dict[str, float | None]:
    """Relative standard errors of some parameters, of the worst channel; None where they are not determined."""
    if forecast is None:
        return {}
    problem, relative = forecast.problem, forecast.relative_std
    estimates = forecast.posterior.estimates
    out: dict[str, float | None] = {}
    for name in names:
        if name not in problem.gauges:
            is_known = estimates[name].status != "not determined"
            error = float(relative[problem.where[name]].max())
            out[name] = error if is_known and math.isfinite(error) else None
    return out
