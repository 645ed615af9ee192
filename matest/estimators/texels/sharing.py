"""Texels that take from their region what their own samples do not tell."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import one_hot

from matest.estimators.texels.elimination import Elimination
from matest.estimators.texels.fit import TexelFitter, TileFit
from matest.estimators.texels.regions import MISFIT_CHI2, Regions
from matest.estimators.texels.some import Knowledge
from matest.estimators.texels.trust import Reliable, ambiguous, least_information, unlike_the_seen
from matest.samples.texels import TexelTile


class SharedFit(NamedTuple):
    """The solution of a tile where what a texel does not tell is that of its region.

    Attributes:
        fit: of the texels.
        own: what they tell of their own [T, n].
        counted: which of them tell of the unknowns in common [n]; None: all.
        elimination: of them.
        pull: how far their unknowns follow the values of their region [T, T, n].
        labels: their regions [n].
    """

    fit: TileFit
    own: Tensor
    counted: Tensor | None
    elimination: Elimination
    pull: Tensor
    labels: Tensor

    def drawn(self, regions: Regions) -> Tensor:
        """How far the unknowns, all together, follow the values of each region [T, T, R]."""
        inside = one_hot(self.labels, regions.values.shape[1]) * _seen(self.fit.tile)[:, None]
        return torch.einsum("tjn,nr->tjr", self.pull.double(), inside.double())

    def doubt(self, regions: Regions, inflation: float) -> Tensor:
        """Variance of the unknowns by what is not known of the values of their regions [T, n]."""
        return (self.pull * regions.errors(inflation)[:, self.labels].to(self.pull)).square().sum(1)


def shared(fitter: TexelFitter, fit: TileFit, known: Knowledge) -> SharedFit:
    """The solution where what a texel does not tell is that of its region.

    Shapes come first: an amplitude is told with its shape known, whatever that is known from.
    """
    texels, regions, inflation = fitter.texels, known.regions, known.inflation
    labels = regions.labels(fit.theta)
    limits = regions.limits(labels)
    own, counted = torch.ones_like(fit.theta, dtype=torch.bool), None
    elimination = Elimination.of(fitter, fit, inflation)
    is_shape = texels.is_shape
    for some in (is_shape, ~is_shape):
        if not bool(some.any()):
            continue
        std = (inflation * elimination.variance).sqrt()
        untold = some[:, None] & (std > limits)
        if fit.trials is not None and some is is_shape:
            untold |= some[:, None] & ambiguous(fit, std, inflation)
            counted = Reliable.of(fitter, fit, elimination, inflation, known.limit).counted
            if inflation > MISFIT_CHI2:
                # A lobe that one photograph alone tells may be what the model lacks there.
                without_one = (inflation * least_information(fitter, fit)).sqrt()
                untold |= some[:, None] & ((without_one > limits) | unlike_the_seen(fitter, fit))
        own &= ~untold
        if len(places := untold.any(0).nonzero()[:, 0]):
            fit = fitter.with_prior(fit, regions.prior(labels, own, inflation), places)
            elimination = elimination.replaced(places, Elimination.of(fitter, fit.some(places), inflation))
    pull = elimination.covariance * torch.where(own, 0.0, fit.prior.precision)
    return SharedFit(fit, own, counted, elimination, pull, labels)


def bias_of_means(fitter: TexelFitter, fit: TileFit, known: Knowledge, seed: int) -> Tensor:
    """How far the means of θ over some texels are off where their solution is right [T].

    It is what photographs say that are drawn anew from the solution: some noise, and its opposite, so that nothing is
    left of what is linear in it. Where no shape is mapped there is none.
    """
    if fit.trials is None:
        return torch.zeros(len(fit.theta), dtype=torch.float64)
    tile, generator = fit.tile, torch.Generator().manual_seed(seed)
    truth = shared(fitter, fit, known).fit
    radiance = truth.radiance
    std = (known.inflation * tile.batch.variance(radiance)).sqrt()
    noise = std * torch.randn(radiance.shape, generator=generator)
    off = torch.zeros_like(truth.theta)
    for drawn in (noise, -noise):
        first = fitter.fit(tile.measuring(radiance + drawn), known.regions.weak_prior(len(tile)))
        off += 0.5 * (shared(fitter, first, known).fit.theta - truth.theta)
    return off[:, _seen(tile)].double().mean(1)


def _seen(tile: TexelTile) -> Tensor:
    """Whether any sample shows a texel [n]."""
    return tile.usable.unflatten(0, (tile.images, -1)).any(0)
