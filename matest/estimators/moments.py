"""Additive statistics of samples: what a pass over them leaves behind."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from matest.estimators.images import Images
from matest.samples import Batch
from matest.samples.batch import Working

# What says how well some samples are met, in this order:
# cost: rᵀWr of all values, what a fit minimises.
# chi2: rᵀWr of the plain values: measured well inside the sensor's range, and no outliers.
# values: number of these.
# outliers: number of plain values of weight 0.
# squared_residual: rᵀr of the values of `chi2`.
# squared_signal: yᵀy of them.
# samples: number of samples.
# evaluated: number of points that the model was evaluated at.
SCORES = ("cost", "chi2", "values", "outliers", "squared_residual", "squared_signal", "samples", "evaluated")
_COUNTS = [SCORES.index(name) for name in ("values", "outliers", "samples")]


def scores(**given: float) -> Tensor:
    """A row of scores from some of them by name; the others are 0."""
    return torch.tensor([[given.get(name, 0.0) for name in SCORES]], dtype=torch.float64)


@dataclass(frozen=True, eq=False)
class Moments:
    """Additive statistics of the images Φ of B blocks of samples, double precision; r is a residual.

    Attributes:
        labels: of the blocks [B].
        gram: ΦᵀWΦ [B, C, K, K].
        moment: ΦᵀWr [B, C, K].
        scores: of the residual [B, 8], see `SCORES`.
    """

    labels: Tensor
    gram: Tensor
    moment: Tensor
    scores: Tensor


def nothing(channels: int, images: int) -> Moments:
    """Moments of no block."""
    none = torch.zeros(0, channels, images, images, dtype=torch.float64)
    return Moments(torch.zeros(0).long(), none, none[..., 0], none.new_zeros(0, len(SCORES)))


def joined(parts: Sequence[Moments]) -> Moments:
    """The moments of all parts together; blocks in the order of their labels."""
    labels = torch.cat([part.labels for part in parts])
    return Moments(
        *_grouped(
            labels,
            torch.cat([part.gram for part in parts]),
            torch.cat([part.moment for part in parts]),
            torch.cat([part.scores for part in parts]),
        )
    )


def _grouped(labels: Tensor, *columns: Tensor) -> Iterator[Tensor]:
    """Every label once, and of each column the sums over its rows of the same label."""
    kept, places = np.unique(labels.numpy(), return_inverse=True)
    yield torch.from_numpy(kept)
    for column in columns:
        yield column.new_zeros(len(kept), *column.shape[1:]).index_add_(0, torch.from_numpy(places), column)


def moments(images: Images, working: Working, residual: Tensor, batch: Batch) -> Moments:
    """Moments of every block of pixels in a batch, for residuals [n, C]."""
    values, tint = images.values, images.tint[:, None]
    weight = working.weight.T.contiguous()
    (channels, samples), count = weight.shape, values.shape[1]
    # Of every channel the weighted images, then the weighted residual.
    left = values.new_empty(channels, count + 1, samples)
    torch.mul(values, (weight * tint**2)[:, None], out=left[:, :-1])
    torch.mul(weight * residual.T, tint, out=left[:, -1])
    runs = batch.runs or ((batch.cluster or 0, samples),)
    ends = torch.tensor([length for _, length in runs]).cumsum(0)
    parts = [slice(end - length, end) for (_, length), end in zip(runs, ends.tolist(), strict=True)]
    if len(values) == 1:
        # One product of matrices for all channels.
        flat, own = left.flatten(0, 1), values[0]
        products = torch.stack([flat[:, part] @ own[:, part].T for part in parts])
        products = products.reshape(-1, channels, count + 1, count)
    else:
        products = torch.stack([left[..., part] @ values[..., part].mT for part in parts])
    products = products.double().cpu()
    # Sums over the runs as differences of running sums.
    running = torch.nn.functional.pad(_rows(working, residual).double().cumsum(-1), (1, 0)).cpu()
    sums = running[:, ends].diff(dim=-1, prepend=running[:, :1])
    lengths = ends.diff(prepend=ends.new_zeros(1))
    found = torch.cat([sums, lengths[None].double()]).T
    # Shares of pixels add up to whole ones.
    found[:, _COUNTS] = found[:, _COUNTS].round()
    labels = torch.tensor([label for label, _ in runs])
    return Moments(labels, products[:, :, :-1], products[:, :, -1], found)


def _rows(working: Working, residual: Tensor) -> Tensor:
    """What the scores add up, sample by sample [7, n]."""
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


@dataclass(frozen=True, eq=False)
class Statistics:
    """Additive statistics of a pass over B blocks of samples, double precision.

    Attributes:
        labels: of the blocks [B].
        informations: JᵀWJ of each [B, P, P].
        gradients: JᵀWr of each [B, P].
        scores: of the residual of each [B, 8], see `SCORES`.
    """

    labels: Tensor
    informations: Tensor
    gradients: Tensor
    scores: Tensor

    def __len__(self) -> int:
        return len(self.labels)

    def column(self, name: str) -> Tensor:
        """One of the `SCORES` of every block [B]."""
        return self.scores[:, SCORES.index(name)]

    def total(self, name: str) -> float:
        """The sum of one of the `SCORES`."""
        return float(self.column(name).sum())

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

    def moved(self, change: Tensor) -> Statistics:
        """What a pass would give if the unknowns changed by this [P] and the model were linear in them.

        The squared residual stays as it is.
        """
        pulled = self.informations @ change
        rises = pulled @ change - 2 * self.gradients @ change
        return replace(self, gradients=self.gradients - pulled, scores=_risen(self.scores, rises))

    def regrouped(self, coarser: Tensor) -> Statistics:
        """The same statistics with groups joined; `coarser` [G] has the new label of every group."""
        return Statistics(*_grouped(coarser[self.labels], self.informations, self.gradients, self.scores))

    @property
    def information(self) -> Tensor:
        return self.informations.sum(0)

    @property
    def gradient(self) -> Tensor:
        return self.gradients.sum(0)


@dataclass(frozen=True, eq=False)
class Compressed:
    """Moments of the blocks of pixels, from which statistics at any coefficients follow.

    Attributes:
        origin: coefficients g [C, K] that residuals were taken from.
        moments: of every block.
    """

    origin: Tensor
    moments: Moments

    def statistics(self, coefficients: Tensor, slopes: Tensor) -> Statistics:
        """What a pass at `coefficients` [C, K] with derivatives [C, K, P] would give.

        The squared residual stays that at the origin.
        """
        own, change = self.moments, coefficients - self.origin
        moved = (own.gram @ change[..., None])[..., 0]
        rises = (change * (moved - 2 * own.moment)).sum((1, 2))
        return Statistics(
            labels=own.labels,
            informations=(slopes.mT @ own.gram @ slopes).sum(1),
            gradients=(slopes.mT @ (own.moment - moved)[..., None]).sum(1)[..., 0],
            scores=_risen(own.scores, rises),
        )


def _risen(scores: Tensor, rises: Tensor) -> Tensor:
    """Scores [B, 8] where the squared residual of each block rises by so much [B]."""
    found = scores.clone()
    found[:, [SCORES.index("cost"), SCORES.index("chi2")]] += rises[:, None]
    return found
