"""Moments of the columns of a model: what a pass over samples adds up, group by group."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from matest.estimators.columns import Columns
from matest.samples.likelihood import LeastSquares

# What says how well some samples are met, in this order:
# cost: rᵀWr of all values, what a fit minimises.
# chi2: rᵀWr of the plain values: measured well inside the sensor's range, and no outliers.
# values: number of these.
# outliers: number of plain values of weight 0.
# usable: number of all values but clipped ones that the model puts beyond the end of the sensor's range too.
# squared_residual, squared_signal: rᵀr and yᵀy of the usable values.
# trimmed_residual, trimmed_signal: rᵀr and yᵀy of the values of `chi2`.
# samples: number of samples.
# evaluated: number of points that the model was evaluated at.
SCORES = (
    "cost",
    "chi2",
    "values",
    "outliers",
    "usable",
    "squared_residual",
    "squared_signal",
    "trimmed_residual",
    "trimmed_signal",
    "samples",
    "evaluated",
)
_COUNTS = [SCORES.index(name) for name in ("values", "outliers", "usable", "samples")]


def scores(**given: float) -> Tensor:
    """A row of scores from some of them by name; the others are 0."""
    return torch.tensor([[given.get(name, 0.0) for name in SCORES]], dtype=torch.float64)


@dataclass(frozen=True, eq=False)
class Moments:
    """Additive statistics of the columns Φ of B groups of samples, double precision; r is a residual.

    Attributes:
        labels: of the groups [B].
        gram: ΦᵀWΦ [B, C, K, K].
        moment: ΦᵀWr [B, C, K].
        scores: of the residual [B, S], see `SCORES`.
    """

    labels: Tensor
    gram: Tensor
    moment: Tensor
    scores: Tensor


def nothing(channels: int, columns: int) -> Moments:
    """Moments of no group."""
    none = torch.zeros(0, channels, columns, columns, dtype=torch.float64)
    return Moments(torch.zeros(0).long(), none, none[..., 0], none.new_zeros(0, len(SCORES)))


def joined(parts: Sequence[Moments]) -> Moments:
    """The moments of all parts together; groups in the order of their labels."""
    labels = torch.cat([part.labels for part in parts])
    return Moments(
        *by_label(
            labels,
            torch.cat([part.gram for part in parts]),
            torch.cat([part.moment for part in parts]),
            torch.cat([part.scores for part in parts]),
        )
    )


def by_label(labels: Tensor, *columns: Tensor) -> Iterator[Tensor]:
    """Every label once, and of each column the sums over its rows of the same label."""
    kept, places = np.unique(labels.numpy(), return_inverse=True)
    yield torch.from_numpy(kept)
    for column in columns:
        yield column.new_zeros(len(kept), *column.shape[1:]).index_add_(0, torch.from_numpy(places), column)


def moments(columns: Columns, problem: LeastSquares, residual: Tensor, groups: Tensor | None) -> Moments:
    """Moments of every group of samples, for residuals [n, C].

    Args:
        columns: of the samples.
        problem: their weights.
        residual: of the measured radiance [n, C].
        groups: labels [n], those of a group in a row; None: a single group 0.
    """
    values, tint = columns.values, columns.tint[:, None]
    weight = problem.weight.T.contiguous()
    (channels, samples), count = weight.shape, values.shape[1]
    if not samples:
        return nothing(channels, count)
    # Of every channel the weighted columns, then the weighted residual.
    left = values.new_empty(channels, count + 1, samples)
    torch.mul(values, (weight * tint**2)[:, None], out=left[:, :-1])
    torch.mul(weight * residual.T, tint, out=left[:, -1])
    labels, lengths = torch.zeros(1).long(), torch.tensor([samples])
    if groups is not None:
        labels, lengths = torch.unique_consecutive(groups.cpu(), return_counts=True)
    ends = lengths.cumsum(0)
    parts = [slice(end - length, end) for length, end in zip(lengths.tolist(), ends.tolist(), strict=True)]
    if len(values) == 1:
        # One product of matrices for all channels.
        flat, right = left.flatten(0, 1), values[0]
        products = torch.stack([flat[:, part] @ right[:, part].T for part in parts])
        products = products.reshape(-1, channels, count + 1, count)
    else:
        products = torch.stack([left[..., part] @ values[..., part].mT for part in parts])
    products = products.double().cpu()
    # Sums over the groups as differences of running sums.
    running = torch.nn.functional.pad(_rows(problem, residual).double().cumsum(-1), (1, 0)).cpu()
    sums = running[:, ends].diff(dim=-1, prepend=running[:, :1])
    totals = torch.cat([sums, lengths[None].double()]).T
    # Shares of pixels add up to whole ones.
    totals[:, _COUNTS] = totals[:, _COUNTS].round()
    return Moments(labels, products[:, :, :-1], products[:, :, -1], totals)


def _rows(problem: LeastSquares, residual: Tensor) -> Tensor:
    """What the scores add up, sample by sample: all but the last of them, [10, n]."""
    squared, signal, means = residual.square(), problem.response.square(), problem.means
    if means is not None:
        # Means over the pixels that each sample stands for.
        squared, signal = squared + means.scatter, signal + means.scatter
    weighted = problem.weight * squared
    # Over the channels by products of matrices: sums of three are slow.
    ones = weighted.new_ones(weighted.shape[1])
    cost = weighted @ ones
    counted = problem.plain & (problem.weight > 0)
    if means is not None:
        # What stands for nothing leaves no trace.
        counted |= means.pixels == 0
    chi2 = cost
    usable = plain = values = cost.new_full((), residual.shape[1]).expand(len(cost))
    every = trimmed = (squared @ ones, signal @ ones)
    if not bool(counted.all()):
        trimmed, chi2 = ((squared * counted) @ ones, (signal * counted) @ ones), (weighted * counted) @ ones
        plain, values = problem.plain.to(cost) @ ones, counted.to(cost) @ ones
    if problem.errors is not None:
        model, (measured, counts) = problem.response - residual, problem.errors
        # What is merged is not clipped: there is nothing scattered about a clipped value.
        squared = torch.where(measured == problem.response, squared, (measured - model).square())
        signal = torch.where(measured == problem.response, signal, measured.square())
        usable, every = counts.to(cost) @ ones, ((squared * counts) @ ones, (signal * counts) @ ones)
    # Each counts for as many pixels as it stands for.
    rows = torch.stack([values, plain - values, usable, *every, *trimmed, torch.ones_like(cost)])
    return torch.cat([cost[None], chi2[None], rows if means is None else rows * means.pixels[:, 0]])


def raised(scores: Tensor, rises: Tensor) -> Tensor:
    """Scores [B, S] where the squared residual of each group rises by so much [B]."""
    out = scores.clone()
    out[:, [SCORES.index("cost"), SCORES.index("chi2")]] += rises[:, None]
    return out
