"""How far what a texel says of itself, and of what is in common, can be trusted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from torch import Tensor

from matest.estimators.moments import SCORES, score_rows
from matest.estimators.texels.elimination import Elimination
from matest.estimators.texels.fit import TexelFitter, TileFit
from matest.estimators.texels.small_systems import Factored
from matest.samples.likelihood import LeastSquares
from matest.samples.texels import TexelTile
from matest.scene import Points

# Relative standard error of a shape up to which a texel tells of the parameters in common.
_WELL_KNOWN = 0.05
# Share of the texels that do so at least.
_RELIABLE_SHARE = 0.25
# Least size of a value that errors are relative to.
_TINY = 1e-9
# Rise of χ² up to which another value is likely: three standard errors.
_LIKELY = 9.0
# Standard errors beyond which a value is another one.
_FAR = 4.0
# How many times brighter a highlight is than anything seen, if nothing is known of it.
_UNSEEN = 10.0
# Share of the texels whose optimum a search may miss: their χ² says nothing of the noise.
_MISSED = 0.01
# Uncertainty of the bias of scores, relative to it: it is that of the solution, not of the truth.
_BIAS_ERROR = 0.15


@dataclass(frozen=True, eq=False)
class Reliable:
    """Texels that tell of the unknowns in common.

    Where a shape is hardly known its likelihood is no Gaussian, and what is in common would be drawn by all that are so
    to one side: an error that does not fall with the number of texels.

    Attributes:
        counted: whether each of n texels is one of them [n].
        limit: relative standard error of their shapes.
    """

    counted: Tensor
    limit: float

    @classmethod
    def of(
        cls, fitter: TexelFitter, fit: TileFit, elimination: Elimination, inflation: float, limit: float | None = None
    ) -> Reliable:
        """Those whose shapes are known to `limit`; None: one that a quarter of the texels meets, if not more."""
        std = (inflation * elimination.variance).sqrt()
        is_shape = fitter.texels.is_shape
        relative = (std[is_shape] / fit.theta[is_shape].abs().clamp(min=_TINY)).amax(0)
        if limit is None:
            limit = max(_WELL_KNOWN, float(relative.quantile(_RELIABLE_SHARE)))
        return cls((relative <= limit) & ~ambiguous(fit, std, inflation).any(0), limit)


def ambiguous(fit: TileFit, std: Tensor, inflation: float) -> Tensor:
    """Where another value far away describes a texel nearly as well [T, n]; `std` [T, n] are standard errors."""
    assert fit.trials is not None
    is_likely = fit.trials.cost < _LIKELY * inflation
    far = (fit.trials.theta - fit.theta).abs() > _FAR * std
    return (is_likely[:, None] & far).any(0)


def least_information(fitter: TexelFitter, fit: TileFit) -> Tensor:
    """Variances of θ without the photograph that tells most of it, in units of the noise [T, n]."""
    images = fit.tile.images
    by_image = fit.problem.by_image(fit.theta, fitter.texels.rows).information
    rest = by_image.sum(2, keepdim=True) - by_image
    rest.diagonal()[:] += fit.prior.precision.permute(1, 0).unsqueeze(0).expand(images, -1, -1)
    variances = Factored.of(rest.flatten(2)).inverse().diagonal().T
    return variances.unflatten(-1, (images, -1)).amax(1)


def unlike_the_seen(fitter: TexelFitter, fit: TileFit) -> Tensor:
    """Texels whose highlight would be far brighter than anything that they were photographed at [n].

    Such a lobe is known from its foot alone.
    """
    tile, points = fit.tile, fit.tile.points
    mirrored = points.wo[:1] * points.wo.new_tensor([-1.0, -1.0, 1.0])
    light = points.irradiance.new_ones(1, 1, 1, tile.radiance.shape[1])
    one = replace(
        tile,
        points=Points(mirrored[:, :, None], points.wo[:1], light),
        radiance=torch.zeros_like(tile.radiance[: len(tile)]),
        usable=torch.ones_like(tile.usable[: len(tile)]),
    )
    highlight = fitter.radiance(one, fit.theta).amax(1)
    powers = points.irradiance.sum(-2).expand(tile.images, len(tile), -1)
    seen = fit.radiance.unflatten(0, (tile.images, -1)) / powers.clamp(min=_TINY)
    seen = (seen * tile.usable.unflatten(0, (tile.images, -1, 1))).amax((0, 2))
    return highlight > _UNSEEN * seen


def degrees(fit: TileFit, variance: Tensor) -> float:
    """Degrees of freedom that texels take, of variance [T, n] in units of the noise: none for what they do not tell."""
    return float((1 - fit.prior.precision * variance).clamp(0, 1).sum())


def variance_among_trials(fit: TileFit, inflation: float) -> Tensor:
    """Mean squared distance of likely values from θ, in units of the noise [T, n]: of those that were tried."""
    assert fit.trials is not None
    off = fit.trials.theta - fit.theta
    before = ((fit.trials.theta - fit.prior.mean).square() * fit.prior.precision).sum(1)
    here = ((fit.theta - fit.prior.mean).square() * fit.prior.precision).sum(0)
    lower = (here - fit.trials.cost.clamp(min=0) - before) / (2 * inflation)
    largest = lower.amax(0).clamp(min=0)
    likely, here = torch.exp(lower - largest), torch.exp(-largest)
    return (likely[:, None] * off.square()).sum(0) / (likely.sum(0) + here) / inflation


class ScoreBias(NamedTuple):
    """The mean score of the unknowns in common, per texel, where these are right.

    Attributes:
        mean: [S].
        scatter: covariance of what chance of the draws makes of it [S, S].
        information: of the texels that count on the unknowns in common, per texel [S, S].
        misfit: of what was drawn anew with the noise alone, as `misfit_of` has it.
    """

    mean: Tensor
    scatter: Tensor
    information: Tensor
    misfit: float

    @classmethod
    def none(cls, unknowns: int) -> ScoreBias:
        """Of texels whose scores are unbiased."""
        zeros = torch.zeros(unknowns, unknowns, dtype=torch.float64)
        return cls(zeros.sum(0), zeros, zeros, 0.0)

    @classmethod
    def average(cls, draws: Sequence[ScoreBias]) -> ScoreBias:
        """What several draws say together."""
        mean, scatter, information, misfit = (sum(part) / len(draws) for part in zip(*draws, strict=True))
        return cls(mean, scatter / len(draws), information, misfit)

    @property
    def error(self) -> Tensor:
        """Covariance of the error of the mean [S, S]."""
        error = _BIAS_ERROR * self.mean
        return self.scatter + error[:, None] * error

    @classmethod
    def of(cls, fitter: TexelFitter, fit: TileFit, inflation: float, limit: float, seed: int) -> ScoreBias:
        """The bias at a solution; `limit` as in `Reliable`.

        Texels of little known shape, and the choice of those that count, draw scores off 0 (Neyman and Scott 1948). It
        is what photographs say that are drawn anew from the solution: some noise, and its opposite, so that nothing is
        left of what is linear in it.
        """
        tile, generator = fit.tile, torch.Generator().manual_seed(seed)
        radiance, size = fit.radiance, len(fitter.texels.common)
        std = (inflation * tile.batch.variance(radiance)).sqrt()
        noise = std * torch.randn(radiance.shape, generator=generator)
        scores = torch.zeros(size, len(tile), dtype=torch.float64)
        information, misfit = torch.zeros(size, size, dtype=torch.float64), 0.0
        for drawn in (noise, -noise):
            again = fitter.fit(tile.measuring(radiance + drawn), fit.prior)
            elimination = Elimination.of(fitter, again)
            counted = Reliable.of(fitter, again, elimination, inflation, limit).counted
            scores += 0.5 * elimination.scores * counted
            information += 0.5 * elimination.sums(counted).information
            misfit += 0.5 * misfit_of(again) / inflation
        mean = scores.mean(-1)
        apart = scores - mean[:, None]
        return cls(mean, apart @ apart.T / len(tile) ** 2, information / len(tile), misfit)


def misfit_of(fit: TileFit) -> float:
    """χ² of a texel, but for those of the largest: the mean."""
    chi2 = fit.problem.normal(fit.theta, ()).cost
    return float(chi2.sort().values[: math.ceil((1 - _MISSED) * len(chi2))].mean())


def totals(tile: TexelTile, squares: LeastSquares, values: Tensor) -> Tensor:
    """Sums of the `SCORES` of the usable samples of every image of a tile [I, S], for radiance [I·n, C]."""
    rows = score_rows(squares, squares.weight.T, (squares.response - values).T)
    counted = tile.usable.to(values)
    # In single precision, which torch sums in parts: a sum in double precision takes longer than all that it is of.
    sums = [(row * counted).unflatten(0, (tile.images, -1)).sum(-1) for row in rows]
    # Every usable sample is one that the model is evaluated at.
    return torch.stack([*sums, sums[SCORES.index("samples")]], dim=-1).double()
