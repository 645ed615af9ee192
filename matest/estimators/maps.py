"""An albedo for every texel, and the rest of a material in common: texels are eliminated in closed form."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import torch
from torch import Tensor

from matest.estimators.basis import TangentBasis
from matest.estimators.covariance import Covariance, fisher
from matest.estimators.levenberg_marquardt import at_bound, moved
from matest.estimators.moments import SCORES, score_sums
from matest.estimators.one_step import expand_about
from matest.estimators.tile_sums import Expanded, each_tile
from matest.estimators.unknowns import Problem
from matest.progress import Progress, silent
from matest.samples import Batch, Tile, Tiles
from matest.samples.likelihood import LeastSquares
from matest.samples.residual_scale import NOISE_ALONE, ResidualScale
from matest.samples.tiles import in_memory
from matest.workers import single_threaded_torch

# Passes over the samples of some texels, from which the parameters in common are near the optimum of all.
_FEW_PASSES = 20
# Passes over all samples: where the model holds one for the texels, and one or two for everything.
_ALL_PASSES = 10
# Standard errors of the parameters in common below which a step ends the passes.
_LAST_STEP = 0.1
# Least factor of a texel's albedo: products with it stay positive.
_DARKEST = 1e-4


@dataclass(frozen=True, eq=False)
class TexelSums:
    """Sums over the samples of every texel at some factors of its albedo and some unknowns in common.

    Attributes:
        information: of the factors [N, C].
        scores: of the factors [N, C].
        cross: of each factor with the Q parameters of its channel that are in common [N, C, Q].
        common: information of the unknowns in common [P, P].
        common_scores: [P].
        totals: sums of the `SCORES`.
    """

    information: Tensor
    scores: Tensor
    cross: Tensor
    common: Tensor
    common_scores: Tensor
    totals: Tensor

    def total(self, name: str) -> float:
        return float(self.totals[SCORES.index(name)])

    @property
    def cost(self) -> float:
        return self.total("cost")

    @property
    def seen(self) -> Tensor:
        """Whether the samples of a texel tell its factor [N, C]."""
        return self.information > 0

    @classmethod
    def empty(cls, texels: int, problem: Problem, parameters: int) -> TexelSums:
        """Of no sample."""
        size, channels = problem.size, problem.channels
        information = torch.zeros(texels, channels)
        return cls(
            information=information,
            scores=torch.zeros_like(information),
            cross=torch.zeros(texels, channels, parameters),
            common=torch.zeros(size, size, dtype=torch.float64),
            common_scores=torch.zeros(size, dtype=torch.float64),
            totals=torch.zeros(len(SCORES), dtype=torch.float64),
        )

    def add(self, pixels: Tensor, part: TexelSums) -> None:
        """Add the sums of some samples, whose texels are at `pixels` [n]."""
        for name in ("information", "scores", "cross"):
            getattr(self, name).index_add_(0, pixels, getattr(part, name))
        for name in ("common", "common_scores", "totals"):
            getattr(self, name).add_(getattr(part, name))


@dataclass(frozen=True, eq=False)
class TexelFit:
    """A material of which each texel has an albedo of its own.

    Attributes:
        problem: what is estimated in common; the mapped parameters stay at their values in `unknowns`.
        unknowns: u [P].
        mapped: names of the parameters that every texel has its own factor of.
        factors: of these, at every texel and channel; NaN where no sample tells it [N, C].
        sums: there.
        converged: whether the last step was small.
        residual_scale: by which outliers were judged.
    """

    problem: Problem
    unknowns: Tensor
    mapped: Collection[str]
    factors: Tensor
    sums: TexelSums
    converged: bool
    residual_scale: ResidualScale

    @property
    def chi2(self) -> float:
        """Per degree of freedom."""
        free = self.sums.total("values") - int(self.sums.seen.sum()) - self.problem.size
        return self.sums.total("chi2") / max(free, 1.0)

    @property
    def inflation(self) -> float:
        """Of squared errors, where the model does not hold."""
        return max(self.chi2, 1.0)

    @cached_property
    def covariance(self) -> Covariance:
        """Of the unknowns in common; those of the mapped parameters and those at a bound have none."""
        free = self._schur.free & ~at_bound(self.problem, self.unknowns, self._schur.scores)
        return fisher(self._schur.information / self.inflation, free)

    @cached_property
    def _schur(self) -> _Schur:
        """The unknowns in common, the texels following them."""
        return _Schur(self.problem, self.mapped, self.sums)

    @property
    def sums_in_common(self) -> tuple[Tensor, Tensor]:
        """Information [P, P] and scores [P] of the unknowns in common, the texels following them."""
        return self._schur.information, self._schur.scores

    def totals_over(self, tiles: Tiles) -> Tensor:
        """Sums of the `SCORES` over other samples of the same texels; one that is not known is as the mean."""
        factors = torch.where(self.factors.isnan(), self.factors.nanmean(dim=0), self.factors)
        return _Model(self.problem, self.unknowns, self.mapped, factors).sums(tiles, self.residual_scale).totals

    @property
    def mean_factor_std(self) -> Tensor:
        """Standard errors of the mean factor over all texels that are seen [C]."""
        sums, schur = self.sums, self._schur
        variances = []
        for channel, places in enumerate(schur.places):
            seen = sums.seen[:, channel]
            own = (1 / sums.information[seen, channel].double()).sum() * self.inflation / int(seen.sum()) ** 2
            move, inside = schur.moves[seen, channel].double().mean(0), self.covariance.matrix[places][:, places]
            variances.append(own + move @ inside @ move)
        return torch.stack(variances).sqrt()

    @cached_property
    def factor_std(self) -> Tensor:
        """Standard errors of the factors [N, C]: of a texel's own samples, and of the unknowns in common."""
        sums, schur = self.sums, self._schur
        own = self.inflation / sums.information
        variances = []
        for channel in range(own.shape[1]):
            inside = self.covariance.matrix[schur.places[channel]][:, schur.places[channel]]
            moves = schur.moves[:, channel].double()
            variances.append((moves @ inside * moves).sum(-1))
        return torch.where(sums.seen, (own + torch.stack(variances, dim=1).to(own)).sqrt(), math.nan)


class _Schur:
    """The unknowns in common where the factors of all texels follow them.

    Attributes:
        places: positions in u of the parameters of each channel [C, Q].
        free: unknowns that are not those of a mapped parameter [P].
        moves: how far each factor follows the parameters of its channel, less is negative [N, C, Q].
    """

    def __init__(self, problem: Problem, mapped: Collection[str], sums: TexelSums) -> None:
        self.places = _places(problem)
        self._inflation = max(sums.total("chi2") / max(sums.total("values"), 1.0), 1.0)
        self.free = torch.ones(problem.size, dtype=torch.bool)
        for name in mapped:
            self.free[problem.where[name]] = False
        inverse = torch.where(sums.seen, 1 / sums.information, 0.0)
        self.moves = -sums.cross * inverse[..., None]
        self.information, self.scores = sums.common.clone(), sums.common_scores.clone()
        for channel, places in enumerate(self.places):
            cross, moves = sums.cross[:, channel].double(), self.moves[:, channel].double()
            self.information.index_put_((places[:, None], places[None]), cross.T @ moves, accumulate=True)
            self.scores.index_put_((places,), moves.T @ sums.scores[:, channel].double(), accumulate=True)

    def step(self, problem: Problem, unknowns: Tensor) -> tuple[Tensor, float]:
        """The step of the unknowns in common [P], and its length in standard errors."""
        free = self.free & ~at_bound(problem, unknowns, self.scores)
        step = fisher(self.information, free).matrix @ self.scores
        change = moved(problem, unknowns, step) - unknowns
        return change, math.sqrt(max(float(change @ self.information @ change), 0.0) / self._inflation)


def _places(problem: Problem) -> Tensor:
    """Positions in u of the Q parameters of each channel [C, Q]."""
    return problem.selectors.argmax(dim=-1)


@single_threaded_torch()
def fit_maps(
    problem: Problem,
    unknowns: Tensor,
    mapped: Collection[str],
    few: Batch,
    tiles: Tiles,
    texels: int,
    progress: Progress = silent,
) -> TexelFit:
    """An albedo of every texel, and the other parameters in common.

    The parameters in common are found from all samples of some texels; then one pass over all samples gives every texel
    its albedo, and the next takes a step of everything together.

    Args:
        problem: what is estimated.
        unknowns: of a fit with one albedo for all [P].
        mapped: parameters that only multiply shapes.
        few: all samples at some texels.
        tiles: all samples, one by one.
        texels: N; `pixels` of samples are below it.
        progress: called with a word on what is being done.
    """
    progress("fitting some texels")
    _, places = few.pixels.unique(return_inverse=True) if few.pixels is not None else (None, None)
    assert places is not None
    some = [Tile(replace(few, pixels=places), cache={})]
    ones = torch.ones(int(places.max()) + 1, problem.channels)
    sample = _descend(problem, unknowns, mapped, ones, some)
    progress("fitting all texels")
    rest = torch.ones(texels, problem.channels)
    return _over_all(sample, rest, tiles)


def _descend(
    problem: Problem, unknowns: Tensor, mapped: Collection[str], factors: Tensor, tiles: list[Tile]
) -> TexelFit:
    """The optimum over samples in memory."""
    factors = _first_factors(problem, unknowns, mapped, factors, in_memory(tiles))
    for _ in range(_FEW_PASSES):
        model = _Model(problem, unknowns, mapped, factors)
        scale, expanded = expand_about([model.radiance(tile) for tile in tiles], tiles)
        sums = model.sums(in_memory(expanded), scale)
        schur = _Schur(problem, mapped, sums)
        change, length = schur.step(problem, unknowns)
        unknowns, factors = _stepped(problem, unknowns, factors, sums, schur, change)
        if length < _LAST_STEP:
            break
    return TexelFit(problem, unknowns, mapped, factors, sums, length < _LAST_STEP, scale)


def _over_all(sample: TexelFit, factors: Tensor, tiles: Tiles) -> TexelFit:
    """The solution over all samples, near that over some."""
    problem, unknowns, mapped, scale = sample.problem, sample.unknowns, sample.mapped, sample.residual_scale
    factors = _first_factors(problem, unknowns, mapped, factors, tiles)
    for turn in range(_ALL_PASSES):
        sums = _Model(problem, unknowns, mapped, factors).sums(tiles, scale)
        schur = _Schur(problem, mapped, sums)
        change, length = schur.step(problem, unknowns)
        if turn and length < _LAST_STEP:
            break
        unknowns, factors = _stepped(problem, unknowns, factors, sums, schur, change)
    factors = torch.where(sums.seen, factors, math.nan)
    return TexelFit(problem, unknowns, mapped, factors, sums, length < _LAST_STEP, scale)


def _stepped(
    problem: Problem, unknowns: Tensor, factors: Tensor, sums: TexelSums, schur: _Schur, change: Tensor
) -> tuple[Tensor, Tensor]:
    """Unknowns and factors after a step of both."""
    own = torch.where(sums.seen, sums.scores / sums.information, 0.0)
    followed = torch.stack(
        [schur.moves[:, channel] @ change[places].to(factors) for channel, places in enumerate(schur.places)], dim=1
    )
    return moved(problem, unknowns, change), (factors + own + followed).clamp(min=_DARKEST)


def _first_factors(
    problem: Problem, unknowns: Tensor, mapped: Collection[str], factors: Tensor, tiles: Tiles
) -> Tensor:
    """The factors that fit the measured values best, the noise being that of these."""
    sums = _Model(problem, unknowns, mapped, factors).sums(tiles, None)
    return torch.where(sums.seen, factors + sums.scores / sums.information, 1.0).clamp(min=_DARKEST)


class _Derivatives(NamedTuple):
    """A model at n samples.

    Attributes:
        radiance: [n, C].
        by_factor: its derivatives by the factor of the texel [n, C].
        by_parameter: its derivatives by the parameters in common [C, Q, n].
    """

    radiance: Tensor
    by_factor: Tensor
    by_parameter: Tensor


class _Model:
    """The radiance of a material with a factor of its albedo at every texel [N, C]."""

    def __init__(self, problem: Problem, unknowns: Tensor, mapped: Collection[str], factors: Tensor) -> None:
        self._problem, self._factors = problem, factors
        self._basis = TangentBasis(problem, unknowns)
        names = {*mapped, *(name for name, source in problem.ties.items() if source in mapped)}
        powers = [sum(factor.name in names for factor in product) for product in self._basis.column_factors]
        self._powers = torch.tensor(powers, dtype=torch.float64)
        # A mapped parameter of the problem itself stays where it is.
        common = torch.tensor([name not in mapped for name in problem.free], dtype=torch.float64)
        self._slopes = self._basis.slopes * common

    def radiance(self, tile: Tile) -> Tensor:
        """Of the samples of a tile [n, C]."""
        return self._at(tile).radiance

    def _at(self, tile: Tile) -> _Derivatives:
        batch = tile.batch
        columns = self._basis.columns(tile)
        factors = self._factors[_pixels(batch)].to(batch.radiance)
        powers = self._powers.to(factors)
        radiance, by_factor, by_parameter = [], [], []
        for channel in range(self._problem.channels):
            values = columns.values[min(channel, len(columns.values) - 1)] * columns.tint[channel]
            factor = factors[:, channel]
            scaled = values * factor ** powers[:, None]
            weights = self._basis.coefficients[channel].to(scaled)
            radiance.append(weights @ scaled)
            by_factor.append((weights * powers) @ scaled / factor)
            by_parameter.append(self._slopes[channel].to(scaled).T @ scaled)
        return _Derivatives(torch.stack(radiance, dim=1), torch.stack(by_factor, dim=1), torch.stack(by_parameter))

    def sums(self, tiles: Tiles, residual_scale: ResidualScale | None) -> TexelSums:
        """Sums over tiles, the likelihood expanded here; without a residual scale about the measured values."""

        def expand(tile: Tile) -> Expanded[tuple[Tensor, TexelSums]]:
            derivatives = self._at(tile)
            about = None if residual_scale is None else derivatives.radiance
            return Expanded(about, lambda tile, squares: (_pixels(tile.batch), self._of_samples(squares, derivatives)))

        total = TexelSums.empty(len(self._factors), self._problem, self._slopes.shape[-1])
        for pixels, part in each_tile(tiles, expand, residual_scale or NOISE_ALONE):
            total.add(pixels, part)
        return total

    def _of_samples(self, squares: LeastSquares, at: _Derivatives) -> TexelSums:
        """Sums of the samples of a tile; those of texels are of each sample [n]."""
        weight, residual = squares.weight, squares.response - at.radiance
        weighted = weight * at.by_factor
        cross = torch.stack([(weighted[:, c] * each).T for c, each in enumerate(at.by_parameter)], dim=1)
        size = self._problem.size
        common, scores = torch.zeros(size, size, dtype=torch.float64), torch.zeros(size, dtype=torch.float64)
        for channel, places in enumerate(_places(self._problem)):
            own = at.by_parameter[channel] * weight[:, channel]
            products = (own @ at.by_parameter[channel].T).double()
            common.index_put_((places[:, None], places[None]), products, accumulate=True)
            scores.index_put_((places,), (own @ residual[:, channel]).double(), accumulate=True)
        rows: Sequence[slice] = [slice(0, len(weight))]
        totals = score_sums(squares, weight.T.contiguous(), residual.T.contiguous(), rows)[0]
        return TexelSums(weighted * at.by_factor, weighted * residual, cross, common, scores, totals)


def _pixels(batch: Batch) -> Tensor:
    assert batch.pixels is not None
    return batch.pixels
