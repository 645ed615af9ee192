"""What a texel's own photographs do not tell of it: the values of its region take their place."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.cluster.vq import kmeans2, vq
from torch import Tensor

from matest.estimators.texels.problem import TexelPrior
from matest.estimators.texels.unknowns import TexelUnknowns

# Standard error, relative to the value of the region, up to which a texel tells an amplitude, and a shape.
AMPLITUDE_TOLD = 0.5
SHAPE_TOLD = 0.25
# Least scatter of the values of a region, relative to the domain: the region's value is no better known.
_LEAST_SPREAD = 1e-3
# Scatter of values where a texel does not tell one, relative to the value of the region.
_UNKNOWN_SPREAD = 0.5
# Texels that a region's mean and scatter need.
_FEWEST = 10
# Least albedo of which the logarithm is taken where regions are told apart.
_DARKEST = 1e-3
# Texels by which it is judged whether regions stand apart, and most of these.
_JUDGED = 500
_MOST_APART = 6
# Quantile of the silhouettes of regions that stand apart, and its least value: where two regions are taken for one, and
# of values that are spread evenly, it is about 0.5.
_WORST = 0.25
_APART = 0.75
# Least share of the texels of a region that is found.
_LEAST_SHARE = 0.03
# Least distance that another one is relative to.
_TINY = 1e-9
# Trials of k-means, of which the best counts.
_TRIALS = 5


@dataclass(frozen=True, eq=False)
class Regions:
    """Parts of an object that are made of one material each, as far as texels do not say otherwise.

    Attributes:
        texels: the unknowns.
        features: centre of each of the R regions among the logarithms of amplitudes [R, A].
        values: of the T unknowns [T, R].
        spreads: standard deviation of the values of its texels about them [T, R].
    """

    texels: TexelUnknowns
    features: np.ndarray
    values: Tensor
    spreads: Tensor

    @classmethod
    def single(cls, texels: TexelUnknowns, unknowns: Tensor) -> Regions:
        """One region of the values in common, nothing being known of the scatter about them."""
        values = unknowns[texels.places, None]
        return cls(texels, np.zeros((1, 0)), values, texels.width(values))

    @classmethod
    def of(cls, texels: TexelUnknowns, theta: Tensor, count: int | None, seed: int) -> Regions:
        """At most `count` regions, told apart by the amplitudes of some texels θ [T, n]; of no known values yet.

        None: as many as their amplitudes stand apart in, where a shape is mapped.
        """
        single = cls.single(texels, texels.problem.anywhere)
        features = _features(texels, theta)
        if count == 1 or not features.shape[1] or (count is None and not texels.shapes):
            return single
        centres = _apart(features, seed) if count is None else _clustered(features, count, seed)
        return cls(texels, centres, *(part.repeat(1, len(centres)) for part in (single.values, single.spreads)))

    def filled(self, labels: Tensor, theta: Tensor, std: Tensor, values: Tensor) -> Regions:
        """The same regions with what is known of their texels.

        Args:
            labels: the region of some texels [n].
            theta: their values [T, n].
            std: standard errors of these, infinite where another value is likely too [T, n].
            values: of the shapes of each region [T, R]; amplitudes are those of the mean of its texels.
        """
        values, spreads = values.clone(), self._unknown.repeat(1, values.shape[1])
        for region in range(values.shape[1]):
            inside = labels == region
            for number, row in enumerate(self.texels.rows):
                # A larger error than the scatter that is taken where nothing is known says nothing.
                some = inside & (std[number] < _UNKNOWN_SPREAD * values[number, region].abs())
                if int(some.sum()) < _FEWEST:
                    spreads[number, region] = _UNKNOWN_SPREAD * values[number, region].abs()
                    continue
                of_texels, errors = theta[number, some].double(), std[number, some].double()
                # Those whose errors are larger than most say little of the scatter.
                weights = (errors.square() + errors.median().square()).pow(-2)
                weights = weights / weights.sum()
                if row.name not in self.texels.shapes:
                    values[number, region] = weights @ of_texels
                scatter = weights @ ((of_texels - values[number, region]).square() - errors.square())
                unknown = (_UNKNOWN_SPREAD * values[number, region]).square()
                share = float(some.sum()) / float(inside.sum())
                spreads[number, region] = (share * scatter.clamp(min=0) + (1 - share) * unknown).sqrt()
        return replace(self, values=values, spreads=torch.maximum(spreads, _LEAST_SPREAD * self._unknown))

    def labels(self, theta: Tensor) -> Tensor:
        """The region of every texel, by its values θ [T, n], int64 [n]."""
        if len(self.features) == 1:
            return torch.zeros(theta.shape[1], dtype=torch.int64)
        nearest, _ = vq(_features(self.texels, theta), self.features)
        return torch.from_numpy(nearest.astype(np.int64))

    def limits(self, labels: Tensor) -> Tensor:
        """Standard errors up to which texels of these regions tell their own values [T, n].

        One that is less than the scatter of a region says more than the region does.
        """
        shares = [SHAPE_TOLD if row.name in self.texels.shapes else AMPLITUDE_TOLD for row in self.texels.rows]
        limits = self.values.abs() * torch.tensor(shares, dtype=torch.float64)[:, None]
        limits = torch.maximum(limits, torch.where(self.spreads < self._unknown, self.spreads, 0.0))
        return limits[:, labels]

    @property
    def _unknown(self) -> Tensor:
        """A scatter that stands for none that is known [T, 1]."""
        return self.texels.width(self.values[:, :1])

    def weak_prior(self, texels: int) -> TexelPrior:
        """Priors of so many texels that say next to nothing: that values lie inside their domain."""
        mean = self.values.mean(1, keepdim=True).expand(-1, texels)
        return TexelPrior(mean.float(), self._unknown.expand_as(mean).pow(-2).float())

    def prior(self, labels: Tensor, own: Tensor) -> TexelPrior:
        """The priors of texels of these regions: next to nothing for what they tell on their `own` [T, n]."""
        mean, spread = self.values[:, labels], self.spreads[:, labels]
        width = self._unknown.expand_as(mean)
        return TexelPrior(mean.float(), torch.where(own, width, spread).pow(-2).float())


def _features(texels: TexelUnknowns, theta: Tensor) -> np.ndarray:
    """What tells the regions of texels apart [n, A]."""
    rows = [k for k, row in enumerate(texels.rows) if row.name not in texels.shapes]
    return theta[rows].clamp(min=_DARKEST).log().T.double().numpy()


def _apart(features: np.ndarray, seed: int) -> np.ndarray:
    """Centres [R, A] of the fewest clusters of some texels [n, A] that stand apart; one where none do."""
    some = np.random.default_rng(seed).permutation(features)[:_JUDGED]
    for count in range(2, _MOST_APART + 1):
        centres = _clustered(some, count, seed)
        if len(centres) < count:
            break
        nearest, second = np.sort(np.linalg.norm(some[:, None] - centres, axis=2), axis=1)[:, :2].T
        shares = np.bincount(vq(some, centres)[0], minlength=count) / len(some)
        # Silhouettes of Rousseeuw (1987), with distances from centres.
        silhouettes = 1 - nearest / np.maximum(second, _TINY)
        if np.quantile(silhouettes, _WORST) > _APART and shares.min() > _LEAST_SHARE:
            return centres
    return some.mean(0, keepdims=True)


def _clustered(features: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Centres [R, A] of no more than `count` clusters."""
    best, lowest = features[:1], math.inf
    for trial in range(_TRIALS):
        centres, labels = kmeans2(features, count, minit="++", rng=np.random.default_rng([seed, trial]))
        cost = float(np.square(features - centres[labels]).sum())
        if cost < lowest:
            best, lowest = centres[np.unique(labels)], cost
    return best
