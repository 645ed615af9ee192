"""How far what a texel says of itself, and of what is in common, can be trusted."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from matest.estimators.moments import SCORES, score_rows
from matest.estimators.texels.elimination import Elimination
from matest.estimators.texels.fit import TexelFitter, TileFit
from matest.estimators.texels.small_systems import Factored
from matest.samples.likelihood import LeastSquares
from matest.samples.texels import TexelTile

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


def curvature(fitter: TexelFitter, fit: TileFit, elimination: Elimination, inflation: float) -> Tensor:
    """How much higher radiance is on average where θ errs than where it is right [I·n, C].

    The bias of non-linear least squares follows from it (Box 1971). Second differences reach as far as the errors.
    """
    here, total = fit.radiance, torch.zeros_like(fit.radiance)
    lower, upper = (end.to(fit.theta) for end in (fitter.texels.lower, fitter.texels.upper))
    for errors in _root(inflation * elimination.covariance):
        inside = torch.ones(len(fit.tile), dtype=torch.bool)
        sides = torch.zeros_like(here)
        for theta in (fit.theta + errors, fit.theta - errors):
            inside &= ((theta >= lower) & (theta <= upper)).all(0)
            sides += fit.problem.radiance(theta.clamp(lower, upper))
        total += torch.where(inside.repeat(fit.tile.images)[:, None], sides - 2 * here, 0.0)
    return total


def _root(matrices: Tensor) -> Tensor:
    """Vectors [T, T, n], the first axis counts them, whose outer products add up to matrices [T, T, n]."""
    factored = Factored.of(matrices)
    vectors = []
    for column, diagonal in enumerate(factored.diagonal):
        below = [factored.lower[row][column] for row in range(column + 1, len(matrices))]
        vector = torch.stack([torch.zeros_like(diagonal)] * column + [torch.ones_like(diagonal), *below])
        vectors.append(vector * diagonal.sqrt())
    return torch.stack(vectors)


def totals(tile: TexelTile, squares: LeastSquares, values: Tensor) -> Tensor:
    """Sums of the `SCORES` of the usable samples of every image of a tile [I, S], for radiance [I·n, C]."""
    rows = score_rows(squares, squares.weight.T, (squares.response - values).T)
    counted = tile.usable.to(values)
    # In single precision, which torch sums in parts: a sum in double precision takes longer than all that it is of.
    sums = [(row * counted).unflatten(0, (tile.images, -1)).sum(-1) for row in rows]
    # Every usable sample is one that the model is evaluated at.
    return torch.stack([*sums, sums[SCORES.index("samples")]], dim=-1).double()
