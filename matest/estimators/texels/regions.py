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
UNKNOWN_SPREAD = 0.5
# Square of the standard deviations within which half of a Gaussian lies.
_HALF = 0.4549
# Standard error of a variance by the median of n squares, relative to it, times √n.
_OF_MEDIAN = 2.3
# Halvings of the range of a scatter's square.
_HALVINGS = 40
# χ² per degree of freedom above which the model does not hold: shapes have to be told by more than one photograph.
MISFIT_CHI2 = 1.5
# Share of a region's scatter within which texels take its value as it is.
_AS_IT_IS = 1e-3
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
        doubts: standard error of the values for texels that do not tell their own, which may differ from those that do
            [T, R].
    """

    texels: TexelUnknowns
    features: np.ndarray
    values: Tensor
    spreads: Tensor
    doubts: Tensor

    @classmethod
    def single(cls, texels: TexelUnknowns, unknowns: Tensor) -> Regions:
        """One region of the values in common, nothing being known of the scatter about them."""
        values = unknowns[texels.places, None]
        return cls(texels, np.zeros((1, 0)), values, texels.width(values), torch.zeros_like(values))

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
        parts = (single.values, single.spreads, single.doubts)
        return cls(texels, centres, *(part.repeat(1, len(centres)) for part in parts))

    def filled(self, labels: Tensor, theta: Tensor, std: Tensor, values: Tensor, error: Tensor) -> Regions:
        """The same regions with what is known of their texels.

        Args:
            labels: the region of some texels [n].
            theta: their values [T, n].
            std: standard errors of these, infinite where another value is likely too [T, n].
            values: of the shapes of each region [T, R]; amplitudes are those of the mean of its texels.
            error: standard errors of the shapes of each region [T, R].
        """
        values, doubts = values.clone(), torch.zeros_like(values)
        spreads = torch.maximum(UNKNOWN_SPREAD * values.abs(), _LEAST_SPREAD * self._unknown)
        for region in range(values.shape[1]):
            for number, row in enumerate(self.texels.rows):
                inside = (labels == region) & std[number].isfinite()
                of_texels, errors = theta[number, inside].double(), std[number, inside].double()
                if row.name not in self.texels.shapes:
                    values[number, region] = _mean(of_texels, errors, values[number, region])
                # A larger error than the scatter that is taken where nothing is known says nothing.
                tells = errors < UNKNOWN_SPREAD * values[number, region].abs()
                of_texels, errors = of_texels[tells], errors[tells]
                if len(errors) < _FEWEST:
                    continue
                if row.name not in self.texels.shapes:
                    values[number, region] = _mean(of_texels, errors, values[number, region])
                scatter = _scatter(of_texels - values[number, region], errors)
                share = len(errors) / float((labels == region).sum())
                # The others may lie off by as much as these scatter.
                doubts[number, region] = math.sqrt(1 - share) * scatter
                spreads[number, region] = math.hypot(scatter, float(error[number, region]))
        spreads = torch.maximum(spreads, _LEAST_SPREAD * self._unknown)
        return replace(self, values=values, spreads=spreads, doubts=doubts)

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

    def prior(self, labels: Tensor, own: Tensor, inflation: float) -> TexelPrior:
        """The priors of texels of these regions: next to nothing for what they tell on their `own` [T, n].

        Samples whose squared errors are `inflation` times those of the noise tell less beside what a region says. Where
        the model does not hold, shapes are the region's: a lobe would be drawn to what the model lacks at one texel.
        """
        mean, spread = self.values[:, labels], self.spreads[:, labels]
        spread = torch.where(self._lent(inflation), _AS_IT_IS * spread, spread)
        width = self._unknown.expand_as(mean)
        return TexelPrior(mean.float(), (inflation / torch.where(own, width, spread).square()).float())

    def errors(self, inflation: float) -> Tensor:
        """Standard errors of the values for texels that take them, beside those which `prior` leaves [T, R]."""
        return torch.where(self._lent(inflation), torch.hypot(self.doubts, self.spreads), self.doubts)

    def _lent(self, inflation: float) -> Tensor:
        """Unknowns whose value texels take as it is, if they take it [T, 1]."""
        return self.texels.is_shape[:, None] & (inflation > MISFIT_CHI2)


def _mean(values: Tensor, errors: Tensor, otherwise: Tensor) -> Tensor:
    """The mean of values [n], those of errors larger than most counting less; another value where there are few."""
    if len(values) < _FEWEST:
        return otherwise
    weights = 1 / (errors.square() + errors.median().square())
    return (weights * values).sum() / weights.sum()


def _scatter(differences: Tensor, errors: Tensor) -> float:
    """The standard deviation of what some values, of known standard errors [n], differ by beyond these.

    It is the one within which half of them lie as of a Gaussian: a few values far off do not matter. As many as there
    are tell its square to a standard error, which is added: they may have come to lie together by chance.
    """
    squares, low, high = differences.square(), 0.0, float(differences.square().max())
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        if float((squares / (errors.square() + middle)).median()) > _HALF:
            low = middle
        else:
            high = middle
    return math.sqrt(high + _OF_MEDIAN / math.sqrt(len(errors)) * (high + float(errors.square().median())))


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
