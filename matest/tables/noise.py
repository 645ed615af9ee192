"""The noise of a table, stated or estimated from what a fit leaves."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from matest.errors import InputError
from matest.tables.loss import Loss
from matest.tables.samples import TableNoise
from matest.tables.table import Table

# Before any fit: relative noise, and the floor as a share of a channel's median value.
_FIRST_RELATIVE = 0.05
_FIRST_FLOOR = 0.05
# Floor that goes with a stated relative noise, as a share of a channel's largest value: the digits of a table.
_LEAST_FLOOR = 1e-6
# Relative noise below this is rounding of the model.
_LEAST_RELATIVE = 1e-4
# Rounds of the regression of squared residuals, whose weights depend on the outcome.
_ROUNDS = 20


def stated_noise(table: Table, relative: float, floor: float | None = None) -> TableNoise:
    """The noise that the user states: a share of the value, and a floor of f cos θi in 1/sr.

    Raises:
        InputError: a number that is no noise.
    """
    if not 0 < relative < 1 or (floor is not None and floor <= 0):
        raise InputError(
            f"noise is a share of the value between 0 and 1, and a floor in 1/sr above 0, as 0.01,0.0001; got "
            f"{relative:g}{'' if floor is None else f',{floor:g}'}."
        )
    largest = _radiance(table).abs().amax(0)
    floors = (_LEAST_FLOOR * largest).clamp(min=1e-12) if floor is None else torch.full_like(largest, floor)
    return TableNoise(torch.full_like(largest, relative), floors)


def first_noise(table: Table, loss: Loss) -> TableNoise:
    """A noise to begin with, where none is stated."""
    radiance = _radiance(table)
    if loss.comparison is not None:
        return estimated_noise(loss, radiance, torch.zeros_like(radiance), torch.ones_like(radiance[:, :1]))
    typical = torch.maximum(radiance.median(0).values, 0.01 * radiance.abs().mean(0)).clamp(min=1e-9)
    return TableNoise(torch.full_like(typical, _FIRST_RELATIVE), _FIRST_FLOOR * typical)


def estimated_noise(loss: Loss, measured: Tensor, model: Tensor, variance_shares: Tensor) -> TableNoise:
    """The noise that makes the residuals of a fit likeliest.

    Of a likelihood relative noise and floor of each channel; of another cost one variance for all values.

    Args:
        loss: that was minimised.
        measured, model: y = f cos θi [n, C].
        variance_shares: variances of the rows relative to each other [n, 1].
    """
    if loss.comparison is not None:
        difference = loss.comparison.function(measured) - loss.comparison.function(model)
        std = (difference.square() / variance_shares).mean().sqrt().clamp(min=1e-12).expand(measured.shape[1])
        return TableNoise(torch.zeros_like(std), std)
    squares = ((measured - model).square() / variance_shares).numpy()
    signal = model.clamp(min=0).square().numpy()
    channels = [_regressed(squares[:, c], signal[:, c]) for c in range(measured.shape[1])]
    relative, floor = torch.tensor(channels, dtype=measured.dtype).T
    return TableNoise(relative, floor)


def _regressed(squares: np.ndarray, signal: np.ndarray) -> tuple[float, float]:
    """Relative noise and floor from squared residuals and squared signals [n], by weighted non-negative regression.

    The variance of a squared residual is twice the square of its mean: the regression is Fisher's scoring.
    """
    from scipy.optimize import nnls

    least = _LEAST_FLOOR**2 * max(float(signal.max()), 1e-18)
    design = np.stack([np.ones_like(signal), signal], axis=1)
    variance = squares.mean() + np.median(squares) + np.zeros_like(signal) + least
    floor2, relative2 = 0.0, 0.0
    for _ in range(_ROUNDS):
        floor2, relative2 = nnls(design / variance[:, None], squares / variance)[0]
        variance = np.maximum(floor2, least) + relative2 * signal
    return max(relative2**0.5, _LEAST_RELATIVE), max(floor2, least) ** 0.5


def _radiance(table: Table) -> Tensor:
    return table.values * table.wi[:, 2:]
