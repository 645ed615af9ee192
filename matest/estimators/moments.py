"""Additive statistics of samples: what a pass over them leaves behind."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace

import torch
from torch import Tensor

from matest.capture import Batch
from matest.capture.batch import Working
from matest.estimators.images import Images


@dataclass(frozen=True)
class Scores:
    """How well some samples are met.

    Attributes:
        cost: rᵀWr of all values, what a fit minimises.
        chi2: rᵀWr of the plain values: measured well inside the sensor's range, and no outliers.
        values: number of these.
        outliers: number of plain values of weight 0.
        squared_residual: rᵀr of the values of `chi2`.
        squared_signal: yᵀy of them.
        samples: number of samples.
        evaluated: number of points that the model was evaluated at.
    """

    cost: float
    chi2: float
    values: int
    outliers: int
    squared_residual: float
    squared_signal: float
    samples: int
    evaluated: int

    def __add__(self, other: Scores) -> Scores:
        return Scores(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))


@dataclass(frozen=True)
class Moments:
    """Additive statistics of the images Φ of some samples, double precision; r is a residual.

    Attributes:
        gram: ΦᵀWΦ [C, K, K].
        moment: ΦᵀWr [C, K].
        scores: of the residual.
    """

    gram: Tensor
    moment: Tensor
    scores: Scores

    def __add__(self, other: Moments) -> Moments:
        return Moments(self.gram + other.gram, self.moment + other.moment, self.scores + other.scores)


def moments(images: Images, working: Working, residual: Tensor, batch: Batch) -> Iterator[tuple[int, Moments]]:
    """Label and moments of every block of pixels in a batch, for residuals [n, C]."""
    values, tint = images.values, images.tint[:, None]
    weight = working.weight.T.contiguous()
    weighted = values * (weight * tint**2)[:, None]
    moved = weight * residual.T * tint
    rows = _rows(working, residual)
    channels, count = weighted.shape[:2]
    start = 0
    for label, length in batch.runs or ((batch.cluster or 0, len(batch)),):
        part = slice(start, start + length)
        start += length
        if len(values) == 1:
            # One product of matrices for all channels.
            own = values[0, :, part].T
            gram = (weighted[..., part].flatten(0, 1) @ own).reshape(channels, count, count)
            moment = moved[:, part] @ own
        else:
            gram = weighted[..., part] @ values[..., part].mT
            moment = (values[..., part] @ moved[:, part, None])[..., 0]
        yield label, Moments(gram.double().cpu(), moment.double().cpu(), _scores(rows[:, part]))


def _rows(working: Working, residual: Tensor) -> Tensor:
    """What `Scores` adds up, sample by sample [7, n]."""
    squared, signal = residual.square(), working.response.square()
    if working.scatter is not None:
        # Means over the pixels that each sample stands for.
        squared, signal = squared + working.scatter, signal + working.scatter
    weighted = working.weight * squared
    # Over the channels by products of matrices: sums of three are slow.
    ones = weighted.new_ones(weighted.shape[1])
    cost = weighted @ ones
    counted = working.plain & (working.weight > 0)
    if working.copies is not None:
        # What stands for nothing leaves no trace.
        counted |= working.copies == 0
    chi2 = cost
    plain = values = cost.new_full((), residual.shape[1]).expand(len(cost))
    if not bool(counted.all()):
        squared, signal, chi2 = squared * counted, signal * counted, (weighted * counted) @ ones
        plain, values = working.plain.to(cost) @ ones, counted.to(cost) @ ones
    # Each counts for as many pixels as it stands for.
    rows = torch.stack([values, plain - values, squared @ ones, signal @ ones, torch.ones_like(cost)])
    return torch.cat([cost[None], chi2[None], rows if working.copies is None else rows * working.copies[:, 0]])


def _scores(rows: Tensor) -> Scores:
    cost, chi2, values, outliers, squared, signal, samples = rows.sum(-1, dtype=torch.float64).tolist()
    return Scores(cost, chi2, round(values), round(outliers), squared, signal, round(samples), rows.shape[1])


@dataclass(frozen=True)
class Sums:
    """Additive statistics of some samples, double precision.

    Attributes:
        information: JᵀWJ [P, P].
        gradient: JᵀWr [P].
        scores: of the residual.
    """

    information: Tensor
    gradient: Tensor
    scores: Scores

    def __add__(self, other: Sums) -> Sums:
        return Sums(
            self.information + other.information, self.gradient + other.gradient, self.scores + other.scores
        )  # fmt: skip


@dataclass
class Statistics:
    """Statistics of a pass over samples, cluster by cluster."""

    clusters: dict[int, Sums] = field(default_factory=dict)

    def total(self, name: str) -> float:
        """The sum of one of the `Scores`."""
        return sum(getattr(sums.scores, name) for sums in self.clusters.values())

    def add(self, cluster: int, sums: Sums) -> None:
        known = self.clusters.get(cluster)
        self.clusters[cluster] = sums if known is None else known + sums

    @property
    def reduced_chi2(self) -> float:
        """χ² per value."""
        return self.total("chi2") / max(self.total("values"), 1)

    @property
    def misfit(self) -> float:
        """χ² per value, at least 1: how much larger the residuals are than the noise."""
        return max(self.reduced_chi2, 1.0)

    @property
    def outliers(self) -> float:
        """Share of outliers among the values that a goodness of fit is judged by."""
        rejected = self.total("outliers")
        return rejected / max(rejected + self.total("values"), 1)

    @property
    def relative_rmse(self) -> float:
        """Rms residual over rms signal; 0 without signal."""
        signal = self.total("squared_signal")
        return math.sqrt(self.total("squared_residual") / signal) if signal > 0 else 0.0

    def grouped(self, size: int) -> Statistics:
        """The same statistics with `size` successive cluster labels joined into one."""
        joined = Statistics()
        for cluster, sums in self.clusters.items():
            joined.add(cluster // size, sums)
        return joined

    @property
    def information(self) -> Tensor:
        return torch.stack([sums.information for sums in self.clusters.values()]).sum(0)

    @property
    def gradient(self) -> Tensor:
        return torch.stack([sums.gradient for sums in self.clusters.values()]).sum(0)


@dataclass(frozen=True)
class Compressed:
    """Moments of the blocks of pixels, from which statistics at any coefficients follow.

    Attributes:
        origin: coefficients g [C, K] that residuals were taken from.
        clusters: moments of every block.
    """

    origin: Tensor
    clusters: dict[int, Moments]

    @property
    def total(self) -> Moments:
        return sum(list(self.clusters.values())[1:], start=next(iter(self.clusters.values())))

    def statistics(self, coefficients: Tensor, slopes: Tensor) -> Statistics:
        """What a pass at `coefficients` [C, K] with derivatives [C, K, P] would give.

        The squared residual stays that at the origin.
        """
        if not self.clusters:
            return Statistics()
        change = coefficients - self.origin
        # Of all B blocks at once, [B, C, …].
        grams = torch.stack([own.gram for own in self.clusters.values()])
        vectors = torch.stack([own.moment for own in self.clusters.values()])
        moved = (grams @ change[..., None])[..., 0]
        rises = (change * (moved - 2 * vectors)).sum((1, 2)).tolist()
        informations = (slopes.mT @ grams @ slopes).sum(1)
        gradients = (slopes.mT @ (vectors - moved)[..., None]).sum(1)[..., 0]
        blocks = zip(self.clusters.items(), rises, informations, gradients, strict=True)
        out = {}
        for (label, own), rise, information, gradient in blocks:
            scores = replace(own.scores, cost=own.scores.cost + rise, chi2=own.scores.chi2 + rise)
            out[label] = Sums(information, gradient, scores)
        return Statistics(out)
