"""The optimum of everything over some texels, and what it says of all."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from matest.estimators.covariance import fisher
from matest.estimators.levenberg_marquardt import at_bound, moved
from matest.estimators.moments import SCORES
from matest.estimators.search import shape_nodes
from matest.estimators.texels.elimination import CommonSums, Elimination
from matest.estimators.texels.fit import TexelFitter, TileFit
from matest.estimators.texels.regions import Regions
from matest.estimators.texels.trust import Reliable, ScoreBias, ambiguous, degrees, misfit_of, totals
from matest.estimators.texels.unknowns import TexelUnknowns
from matest.samples.likelihood import deviations
from matest.samples.residual_scale import NOISE_ALONE, ResidualScale
from matest.samples.texels import TexelTile

# Texels, and nodes of the shapes in common, of the search for a start.
_STARTERS = 500
_START_NODES = 9
# Steps of the parameters in common over the samples of some texels.
_STEPS = 20
# Standard errors of the parameters in common below which a step is the last.
_LAST_STEP = 0.1
# Steps by which the bias is taken off; the draws of the later half of them are averaged.
_CORRECTIONS = 6
# Least χ² that another one is relative to.
_TINY = 1e-9


class SomeTexels(NamedTuple):
    """The solution over some texels.

    Attributes:
        fitter: with the parameters in common.
        fit: of the texels.
        residual_scale: of the residuals there.
        inflation: of squared errors there.
    """

    fitter: TexelFitter
    fit: TileFit
    residual_scale: ResidualScale
    inflation: float


def started(texels: TexelUnknowns, unknowns: Tensor, tile: TexelTile) -> Tensor:
    """u [P] with the shapes in common that describe texels best, if each has the best amplitudes of its own.

    A fit with one value for all takes what differs from texel to texel for shape, and may end where a shape has no
    derivative.
    """
    problem = texels.problem
    names = [name for name in problem.shapes if name not in texels.mapped]
    if not names or not texels.mapped:
        return unknowns
    some = tile.some(torch.arange(min(len(tile), _STARTERS)))
    prior = Regions.single(texels, unknowns).weak_prior(len(some))
    nodes = shape_nodes(problem, max(int(_START_NODES ** (1 / len(names))), 2))
    lowest, squares = TexelFitter(texels, unknowns, NOISE_ALONE).cost(some, None, prior)
    best = unknowns
    for combination in itertools.product(*(nodes[name] for name in names)):
        trial = unknowns.clone()
        for name, value in zip(names, combination, strict=True):
            trial[problem.where[name]] = value
        cost, _ = TexelFitter(texels, trial, NOISE_ALONE).cost(some, squares, prior)
        if cost < lowest:
            lowest, best = cost, trial
    return best


def descend(texels: TexelUnknowns, unknowns: Tensor, tile: TexelTile) -> SomeTexels:
    """The optimum of everything over the samples of a tile."""
    scale = NOISE_ALONE
    fitter = TexelFitter(texels, unknowns, scale)
    prior = Regions.single(texels, unknowns).weak_prior(len(tile))
    fit = fitter.fit(tile, prior)
    for _ in range(_STEPS):
        values = fit.radiance
        elimination, counted = Elimination.of(fitter, fit), None
        scale, inflation = _scale(tile, values), _inflation(fit, elimination)
        if fit.trials is not None and texels.common:
            counted = Reliable.of(fitter, fit, elimination, inflation).counted
        sums = elimination.sums(counted)
        change, length = step(texels, unknowns, sums)
        unknowns = moved(texels.problem, unknowns, change)
        theta = fit.theta + torch.einsum("tsn,s->tn", elimination.moves, change[texels.common_places].float())
        fitter = TexelFitter(texels, unknowns, scale)
        fit = fitter.moved(fit, theta)
        if length < _LAST_STEP * math.sqrt(inflation):
            break
    # The last step may have mended what was far off.
    return SomeTexels(fitter, fit, scale, _inflation(fit, elimination))


@dataclass(frozen=True, eq=False)
class Knowledge:
    """What some texels have told.

    Attributes:
        regions: that texels take values from.
        inflation: of squared errors.
        limit: relative standard error of the shapes of texels that tell of the unknowns in common.
        bias: of their scores.
    """

    regions: Regions
    inflation: float
    limit: float
    bias: ScoreBias


def unbiased(sample: SomeTexels, seed: int) -> tuple[SomeTexels, float, ScoreBias]:
    """The solution where scores are as large as their bias is there, and `limit` and `bias` of `Knowledge`.

    The score of the samples and its bias are found anew at every step, by the same search and the same choice of
    texels: what is wrong with these is wrong in both. Steps are of the size that draws foresee, since a solution that
    is far off may be told by next to no texel.
    """
    texels, tile, prior = sample.fitter.texels, sample.fit.tile, sample.fit.prior
    limit, bias = 0.0, ScoreBias.none(len(texels.common))
    if sample.fit.trials is None or not texels.common:
        return sample, limit, bias
    fitter, fit, scale, inflation = sample
    elimination = Elimination.of(fitter, fit)
    limit = Reliable.of(fitter, fit, elimination, inflation).limit
    draws: list[ScoreBias] = []
    for number in range(_CORRECTIONS):
        draws.append(ScoreBias.of(fitter, fit, inflation, limit, seed + number))
        # The first are those of solutions that are still off.
        bias = ScoreBias.average(draws[(number + 1) // 2 :])
        counted = Reliable.of(fitter, fit, elimination, inflation, limit).counted
        scores = elimination.sums(counted).scores - bias.mean * len(tile)
        change, _ = step(texels, fitter.unknowns, CommonSums(bias.information * len(tile), scores))
        fitter = TexelFitter(texels, moved(texels.problem, fitter.unknowns, change), scale)
        fit = fitter.fit(tile, prior)
        elimination, scale = Elimination.of(fitter, fit), _scale(tile, fit.radiance)
        inflation = max(misfit_of(fit) / max(bias.misfit, _TINY), 1.0)
    return SomeTexels(fitter, fit, scale, inflation), limit, bias


def regions_of(
    sample: SomeTexels, elimination: Elimination, in_common: SomeTexels | None, count: int | None, seed: int
) -> Regions:
    """Regions of a material, and what is known of them from some texels.

    Args:
        sample: the solution over these texels.
        elimination: of them.
        in_common: the solution with one value of each shape for all of them; None: no shape is mapped.
        count: of regions; None: as many as stand apart.
        seed: of the search for them.
    """
    fitter, fit = sample.fitter, sample.fit
    texels, theta = fitter.texels, fit.theta
    found = Regions.of(texels, theta, count, seed)
    labels = found.labels(theta)
    values = fitter.unknowns[texels.places, None].repeat(1, len(found.features))
    errors = torch.zeros_like(values)
    if in_common is not None:
        errors[:] = _errors(texels, in_common)[:, None]
    for region in range(len(found.features)):
        places = (labels == region).nonzero()[:, 0]
        if in_common is None or len(found.features) == 1:
            break
        shared = descend(texels.without_shapes(), in_common.fitter.unknowns, fit.tile.some(places))
        values[:, region] = shared.fitter.unknowns[texels.places]
        errors[:, region] = _errors(texels, shared)
    std = (sample.inflation * elimination.variance).sqrt()
    if fit.trials is not None:
        std = torch.where(ambiguous(fit, std, sample.inflation), math.inf, std)
    return found.filled(labels, theta, std, values, errors)


def _errors(texels: TexelUnknowns, in_common: SomeTexels) -> Tensor:
    """Standard errors of the unknowns of texels in a solution where some have one value, 0 of the others [T]."""
    sums = Elimination.of(in_common.fitter, in_common.fit).sums()
    every = torch.ones(len(sums.scores), dtype=torch.bool)
    errors = torch.zeros(texels.problem.size, dtype=torch.float64)
    errors[in_common.fitter.texels.common_places] = fisher(sums.information / in_common.inflation, every).std
    return errors[texels.places]


def step(texels: TexelUnknowns, unknowns: Tensor, sums: CommonSums) -> tuple[Tensor, float]:
    """The step of the unknowns in common, 0 at the others [P], and its length in standard errors of the noise."""
    places, problem = texels.common_places, texels.problem
    every = torch.zeros(problem.size, dtype=torch.float64).index_copy_(0, places, sums.scores)
    free = ~at_bound(problem, unknowns, every)[places]
    step = torch.zeros(problem.size, dtype=torch.float64)
    step[places] = fisher(sums.information, free).matrix @ sums.scores
    change = (moved(problem, unknowns, step) - unknowns)[places]
    step = torch.zeros_like(step).index_copy_(0, places, change)
    return step, math.sqrt(max(float(change @ sums.information @ change), 0.0))


def _scale(tile: TexelTile, values: Tensor) -> ResidualScale:
    """The scale of the residuals of a tile from radiance [I·n, C]."""
    rows = tile.usable.nonzero()[:, 0]
    sizes = deviations(values[rows], tile.radiance[rows], tile.noise[rows])
    return ResidualScale.of(tile.half_angles[rows], sizes)


def _inflation(fit: TileFit, elimination: Elimination) -> float:
    """χ² per degree of freedom of a tile, at least 1."""
    sums = totals(fit.tile, fit.problem.squares, fit.radiance).sum(0)
    chi2, count = (float(sums[SCORES.index(name)]) for name in ("chi2", "values"))
    return max(chi2 / max(count - degrees(fit, elimination.variance), 1.0), 1.0)
