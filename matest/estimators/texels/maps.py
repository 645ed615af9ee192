"""Maps: parameters of which every texel has its own values, and the others in common.

The unknowns of texels are eliminated: a step of those in common is taken with every texel following it (Schur
complement), so that a pass over all samples has sums of the size of the parameters in common alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import torch
from torch import Tensor

from matest.estimators.covariance import Covariance, fisher
from matest.estimators.levenberg_marquardt import at_bound, moved
from matest.estimators.moments import SCORES
from matest.estimators.texels.elimination import CommonSums, Elimination
from matest.estimators.texels.fit import TexelFitter
from matest.estimators.texels.regions import Regions
from matest.estimators.texels.sharing import bias_of_means, shared
from matest.estimators.texels.some import Knowledge, descend, regions_of, started, step, unbiased
from matest.estimators.texels.trust import ScoreBias, degrees, totals, variance_among_trials
from matest.estimators.texels.unknowns import TexelUnknowns
from matest.estimators.unknowns import Problem
from matest.progress import Progress, silent
from matest.samples.residual_scale import ResidualScale
from matest.samples.texels import TexelTile, TexelTileGroups
from matest.workers import in_groups, single_threaded_torch

# Share of the degrees of freedom that texels must leave for residuals to tell how well the model fits.
LEAST_LEFT = 0.02
# Passes over all samples: a second one where the first step of all was longer than the linear model is trusted.
_PASSES = 3
# Standard errors that some texels state of the parameters in common, up to which texels follow a step linearly.
_LINEAR = 5.0


@dataclass(frozen=True, eq=False)
class MapFit:
    """A material of which each texel has values of its own.

    Attributes:
        texels: the unknowns.
        unknowns: u [P]; the places of the unknowns of texels have no meaning.
        theta: those of the N texels [T, N]; NaN where no sample shows a texel.
        variance: of θ where the unknowns in common stand still, in units of the noise [T, N].
        moves: how far θ follows the unknowns in common [T, S, N].
        own: whether the samples of a texel tell its unknowns; the others are those of its region [T, N].
        held: whether a bound holds an unknown [T, N].
        information: of the unknowns in common, the texels following them [S, S].
        scores: [S].
        bias: of these, per texel, which they hold no more.
        totals: sums of the `SCORES` of every image [I, S].
        degrees: of freedom that the texels take.
        converged: whether the last step was one that texels follow.
        residual_scale: by which outliers were judged.
        regions: that texels take their values from where they have none of their own.
        drawn: how far the T unknowns, summed over all texels, follow the values of each region [T, T, R].
        mean_bias: of the means of θ, which they still hold [T].
    """

    texels: TexelUnknowns
    unknowns: Tensor
    theta: Tensor
    variance: Tensor
    moves: Tensor
    own: Tensor
    held: Tensor
    information: Tensor
    scores: Tensor
    bias: ScoreBias
    totals: Tensor
    degrees: float
    converged: bool
    residual_scale: ResidualScale
    regions: Regions
    drawn: Tensor
    mean_bias: Tensor

    def total(self, name: str) -> float:
        return float(self.totals[:, SCORES.index(name)].sum())

    @property
    def chi2(self) -> float:
        """Per degree of freedom."""
        free = self.degrees_left - len(self.information)
        return self.total("chi2") / free if free > 0 else 1.0

    @property
    def degrees_left(self) -> float:
        """Degrees of freedom that texels leave: 0 where they take so many that residuals tell nothing of the fit."""
        left = self.total("values") - self.degrees
        return left if left > LEAST_LEFT * self.total("values") else 0.0

    @property
    def inflation(self) -> float:
        """Of squared errors, where the model does not hold."""
        return max(self.chi2, 1.0)

    @cached_property
    def covariance(self) -> Covariance:
        """Of the unknowns in common."""
        places, problem = self.texels.common_places, self.texels.problem
        scores = torch.zeros(problem.size, dtype=torch.float64).index_copy_(0, places, self.scores)
        free = ~at_bound(problem, self.unknowns, scores)[places]
        covariance = fisher(self.information / self.inflation, free)
        matrix = covariance.matrix
        return replace(covariance, matrix=matrix + matrix @ self.bias_scatter @ matrix / self.inflation**2)

    @property
    def bias_scatter(self) -> Tensor:
        """Covariance of scores by the error of their bias [S, S]."""
        return self.theta.shape[1] ** 2 * self.bias.error

    @cached_property
    def std(self) -> Tensor:
        """Standard errors of θ [T, N]: of a texel's own samples, and of the unknowns in common."""
        moves = self.moves.double()
        following = torch.einsum("tsn,su,tun->tn", moves, self.covariance.matrix, moves)
        std = (self.inflation * self.variance + following.to(self.variance)).sqrt()
        return torch.where(self.theta.isnan(), math.nan, std)

    @property
    def mean_std(self) -> Tensor:
        """Standard errors of the mean of θ over all texels that are seen [T].

        Texels that take the value of a region have its error in common: where they lie together, as the parts of an
        object do that show no highlight, all may be off by as much as single ones are. What texels of little known
        shape lean to one side by does not average out either.
        """
        seen = ~self.theta[0].isnan()
        own = self.inflation * self.variance[:, seen].double().sum(1) / int(seen.sum()) ** 2
        moves = self.moves[..., seen].double().mean(-1)
        following = torch.einsum("ts,su,tu->t", moves, self.covariance.matrix, moves)
        spreads = torch.hypot(self.regions.spreads, self.regions.doubts)
        drawn = (self.drawn * spreads / int(seen.sum())).square().sum((1, 2))
        return (own + following + drawn + self.mean_bias.square()).sqrt()


@single_threaded_torch()
@torch.no_grad()
def fit_maps(
    problem: Problem,
    unknowns: Tensor,
    mapped: Sequence[str],
    few: TexelTile,
    tiles: TexelTileGroups,
    count: int,
    *,
    regions: int | None = None,
    seed: int = 0,
    progress: Progress = silent,
) -> MapFit:
    """Values of some parameters at every texel, and the other parameters in common.

    The parameters in common are found from all samples of some texels, and so is what values of texels scatter by; one
    pass over all samples then gives every texel its values and the parameters in common a step, which the texels
    follow.

    Args:
        problem: what is estimated.
        unknowns: of a fit with one value for all texels [P].
        mapped: parameters of texels.
        few: all samples at some texels.
        tiles: all samples.
        count: N; `texels` of tiles are below it.
        regions: number of regions whose values texels take where they have none of their own; None: found too.
        seed: of the search for regions.
        progress: called with a word on what is being done.
    """
    progress("fitting some texels")
    texels = TexelUnknowns(problem, tuple(mapped))
    amplitudes = texels.without_shapes()
    unknowns = started(amplitudes, unknowns, few)
    # With nothing but shapes mapped, the fit with one value for all texels is that already.
    in_common = descend(amplitudes, unknowns, few) if texels.shapes and amplitudes.mapped else None
    sample = descend(texels, unknowns if in_common is None else in_common.fitter.unknowns, few)
    sample, limit, bias = unbiased(sample, seed)
    elimination = Elimination.of(sample.fitter, sample.fit)
    found = regions_of(sample, elimination, in_common, regions, seed)
    knowledge = Knowledge(found, sample.inflation, limit, bias)
    progress("fitting all texels")
    out = _Maps.empty(texels, count)
    here = sample.fitter.unknowns
    for _ in range(_PASSES):
        fitter = TexelFitter(texels, here, sample.residual_scale)
        sums = _over_all(fitter, knowledge, tiles, out)
        sums = sums._replace(scores=sums.scores - count * knowledge.bias.mean)
        here, is_linear = out.step(texels, here, sums, elimination.sums().information)
        if is_linear:
            break
    lean = bias_of_means(sample.fitter, sample.fit, knowledge, seed)
    return out.fit(texels, here, sums, knowledge, lean, sample.residual_scale, converged=is_linear)


class _TileSums(NamedTuple):
    """What a tile adds to the sums of a pass."""

    information: Tensor
    scores: Tensor
    totals: Tensor
    degrees: float
    drawn: Tensor


def _over_all(fitter: TexelFitter, known: Knowledge, tiles: TexelTileGroups, out: _Maps) -> _TileSums:
    """Fit all texels; what belongs to them goes to `out`, what is in common is summed."""

    def work(get: Callable[[], TexelTile]) -> list[_TileSums]:
        with torch.no_grad():
            tile = get()
            first = fitter.fit(tile, known.regions.weak_prior(len(tile)))
            solution = shared(fitter, first, known)
            fit, own, elimination = solution.fit, solution.own, solution.elimination
            told = degrees(fit, elimination.variance)
            variance = elimination.variance + solution.doubt(known.regions, known.inflation) / known.inflation
            if fit.trials is not None:
                among = variance_among_trials(fit, known.inflation)
                variance = torch.where(own, variance, torch.maximum(variance, among))
            out.put(tile, fit.theta, variance, elimination, own)
            sums = totals(tile, fit.problem.squares, fit.radiance)
            return [_TileSums(*elimination.sums(solution.counted), sums, told, solution.drawn(known.regions))]

    parts = list(in_groups(work, tiles))
    return _TileSums(*(sum(column) for column in zip(*parts, strict=True)))


@dataclass(frozen=True, eq=False)
class _Maps:
    """What belongs to the texels, filled tile by tile; attributes are those of `MapFit`."""

    theta: Tensor
    variance: Tensor
    moves: Tensor
    own: Tensor
    held: Tensor

    @classmethod
    def empty(cls, texels: TexelUnknowns, count: int) -> _Maps:
        rows, common = len(texels.rows), len(texels.common)
        numbers = (torch.full((rows, *between, count), math.nan) for between in ((), (), (common,)))
        flags = (torch.zeros(rows, count, dtype=torch.bool) for _ in range(2))
        return cls(*numbers, *flags)

    def put(self, tile: TexelTile, theta: Tensor, variance: Tensor, elimination: Elimination, own: Tensor) -> None:
        """The solution of a tile; texels that no sample shows have none."""
        seen = tile.usable.unflatten(0, (tile.images, -1)).any(0)
        at = tile.texels[seen]
        self.theta[:, at] = theta[:, seen].float()
        self.variance[:, at] = variance[:, seen].float()
        self.moves[..., at] = elimination.moves[..., seen].float()
        self.own[:, at], self.held[:, at] = own[:, seen], elimination.held[:, seen]

    def step(self, texels: TexelUnknowns, unknowns: Tensor, sums: _TileSums, sample: Tensor) -> tuple[Tensor, bool]:
        """A step of the unknowns in common, which texels follow: u [P], and whether they follow it linearly.

        Args:
            texels: the unknowns.
            unknowns: u [P].
            sums: of all tiles.
            sample: information of some texels on the unknowns in common [S, S], that u [P] is from.
        """
        change, _ = step(texels, unknowns, CommonSums(sums.information, sums.scores))
        inside = change[texels.common_places]
        follows = torch.einsum("tsn,s->tn", self.moves, inside.float())
        torch.clamp(self.theta + follows, texels.lower.float(), texels.upper.float(), out=self.theta)
        length = math.sqrt(max(float(inside @ sample @ inside), 0.0))
        return moved(texels.problem, unknowns, change), length < _LINEAR

    def fit(
        self,
        texels: TexelUnknowns,
        unknowns: Tensor,
        sums: _TileSums,
        known: Knowledge,
        lean: Tensor,
        residual_scale: ResidualScale,
        *,
        converged: bool,
    ) -> MapFit:
        """All together."""
        return MapFit(
            texels, unknowns, self.theta, self.variance, self.moves, self.own, self.held, sums.information, sums.scores,
            known.bias, sums.totals, sums.degrees, converged, residual_scale, known.regions, sums.drawn,
            lean,
        )  # fmt: skip
