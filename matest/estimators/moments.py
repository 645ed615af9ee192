"""Moments of the columns of a model: what a pass over samples adds up, group by group."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from matest.estimators.columns import Columns
from matest.samples.likelihood import LeastSquares

# Sums that say how well a model describes some samples, in this order:
# cost: rᵀWr of all values, what a fit minimises.
# chi2: rᵀWr of the plain values: measured well inside the sensor's range, and no outliers.
# values: number of values in `chi2`.
# outliers: number of plain values of weight 0.
# rejected: what these would cost if each were only just rejected.
# usable: number of all values, except clipped ones where the model too lies beyond the end of the sensor's range.
# squared_residual, squared_signal: rᵀr and yᵀy of the usable values.
# trimmed_residual, trimmed_signal: rᵀr and yᵀy of the usable values without the outliers.
# samples: number of samples.
# evaluated: number of points that the model was evaluated at.
SCORES = (
    "cost",
    "chi2",
    "values",
    "outliers",
    "rejected",
    "usable",
    "squared_residual",
    "squared_signal",
    "trimmed_residual",
    "trimmed_signal",
    "samples",
    "evaluated",
)
_COUNTS = [SCORES.index(name) for name in ("values", "outliers", "usable", "samples")]


def scores(**by_name: float) -> Tensor:
    """The scores [1, S] of one group from some of them by name; the others are 0."""
    return torch.tensor([[by_name.get(name, 0.0) for name in SCORES]], dtype=torch.float64)


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


def empty_moments(channels: int, columns: int) -> Moments:
    """Moments of no group."""
    gram = torch.zeros(0, channels, columns, columns, dtype=torch.float64)
    return Moments(torch.zeros(0).long(), gram, gram[..., 0], gram.new_zeros(0, len(SCORES)))


def sum_moments(parts: Sequence[Moments]) -> Moments:
    """The moments of all parts together; groups in the order of their labels."""
    labels = torch.cat([part.labels for part in parts])
    return Moments(
        *sum_by_label(
            labels,
            torch.cat([part.gram for part in parts]),
            torch.cat([part.moment for part in parts]),
            torch.cat([part.scores for part in parts]),
        )
    )


def sum_by_label(labels: Tensor, *tensors: Tensor) -> Iterator[Tensor]:
    """Every label once, ascending; then of each tensor [n, ...] the sums over the rows with the same label."""
    distinct, rows = np.unique(labels.numpy(), return_inverse=True)
    yield torch.from_numpy(distinct)
    for tensor in tensors:
        yield tensor.new_zeros(len(distinct), *tensor.shape[1:]).index_add_(0, torch.from_numpy(rows), tensor)


def moments(columns: Columns, problem: LeastSquares, residual: Tensor, groups: Tensor | None) -> Moments:
    """Moments of every group of samples, for residuals [n, C].

    Args:
        columns: of the samples.
        problem: their weights.
        residual: of the measured radiance [n, C].
        groups: labels [n], those of a group in a row; None: a single group 0.
    """
    values, tint = columns.values, columns.tint[:, None]
    # An array of each channel: torch is several times slower where the innermost loop is over three channels.
    weight, residual = problem.weight.T.contiguous(), residual.T.contiguous()
    (channels, samples), count = weight.shape, values.shape[1]
    if not samples:
        return empty_moments(channels, count)
    # For every channel the weighted columns, and the weighted residual as the last row.
    weighted = values.new_empty(channels, count + 1, samples)
    torch.mul(values, (weight * tint**2)[:, None], out=weighted[:, :-1])
    torch.mul(weight * residual, tint, out=weighted[:, -1])
    labels, parts = runs(groups, samples)
    if len(values) == 1:
        # One product of matrices for all channels.
        weighted_of_all, columns_of_all = weighted.flatten(0, 1), values[0]
        products = torch.stack([weighted_of_all[:, part] @ columns_of_all[:, part].T for part in parts])
        products = products.reshape(len(parts), channels, count + 1, count)
    else:
        products = torch.stack([weighted[..., part] @ values[..., part].mT for part in parts])
    products = products.double().cpu()
    return Moments(labels, products[:, :, :-1], products[:, :, -1], score_sums(problem, weight, residual, parts))


def runs(groups: Tensor | None, samples: int) -> tuple[Tensor, list[slice]]:
    """The labels of the groups of some samples in their order [B], and the samples of each; None: a single group 0."""
    if groups is None:
        return torch.zeros(1).long(), [slice(0, samples)]
    labels, lengths = torch.unique_consecutive(groups.cpu(), return_counts=True)
    ends = lengths.cumsum(0)
    return labels, [slice(end - length, end) for length, end in zip(lengths.tolist(), ends.tolist(), strict=True)]


def score_sums(problem: LeastSquares, weight: Tensor, residual: Tensor, parts: Sequence[slice]) -> Tensor:
    """The scores [B, S] of groups, from weights and residuals [C, n] and the samples of each group."""
    rows = torch.stack(score_rows(problem, weight, residual))
    sums = torch.stack([rows[:, part].sum(-1, dtype=torch.float64) for part in parts]).cpu()
    lengths = torch.tensor([[part.stop - part.start] for part in parts], dtype=torch.float64)
    totals = torch.cat([sums, lengths], dim=1)
    # A merged sample counts shares of pixels, which add up to whole pixels but for rounding.
    totals[:, _COUNTS] = totals[:, _COUNTS].round()
    return totals


def score_rows(problem: LeastSquares, weight: Tensor, residual: Tensor) -> list[Tensor]:
    """The scores of every sample, except the last of `SCORES` [n] each, from weights and residuals [C, n]."""
    response, means = problem.response.T, problem.means
    squared, signal = residual.square(), response.square()
    if means is not None:
        # Means over the pixels that each sample stands for.
        squared, signal = squared + means.scatter.T, signal + means.scatter.T
    weighted = weight * squared
    # Numbers 0 and 1 instead of truth values, which torch converts slowly; no weight is negative.
    plain = problem.plain.T.to(weighted)
    counted = plain * weight.sign()
    # Sum over the channels by products of matrices: torch sums three numbers slowly.
    ones = weighted.new_ones(len(weighted))
    usable = ones.sum().expand(weighted.shape[1])
    if problem.errors is not None:
        model, (measured, usable_values) = response - residual, (part.T for part in problem.errors)
        exact, power = (measured - model).square(), measured.square()
        if means is not None:
            # Merged samples are never clipped: no scatter is added to a clipped value.
            merged = measured == response
            exact, power = torch.where(merged, squared, exact), torch.where(merged, signal, power)
        squared, signal = exact, power
        share = usable_values.to(weighted)
        usable, squared, signal = ones @ share, squared * share, signal * share
    every = trimmed = ones @ squared, ones @ signal
    cost, chi2, values = ones @ weighted, ones @ (weighted * plain), ones @ counted
    outliers = rejected = ones @ plain - values
    # Most tiles have none.
    if bool(outliers.any()):
        is_outlier, rejection = plain - counted, problem.rejection
        inliers, each = 1 - is_outlier, rejection.T if isinstance(rejection, torch.Tensor) else rejection
        trimmed = ones @ (squared * inliers), ones @ (signal * inliers)
        rejected = ones @ (is_outlier * each)
    rows = [values, outliers, rejected, usable, *every, *trimmed, torch.ones_like(cost)]
    if means is not None:
        # Each sample counts for as many pixels as it stands for; weights hold these already. One that stands for none
        # is no outlier.
        rows = [row * means.pixels[:, 0] for row in rows]
    return [cost, chi2, *rows]


def with_added_cost(scores: Tensor, added: Tensor) -> Tensor:
    """Scores [B, S] whose cost and χ² are larger by `added` [B]."""
    out = scores.clone()
    out[:, [SCORES.index("cost"), SCORES.index("chi2")]] += added[:, None]
    return out
