"""Losses for training loops: comparing rendered with measured radiance."""

from __future__ import annotations

import torch
from torch import Tensor

from matest.samples import Batch


def photometric(rendered: Tensor, measured: Tensor, weight: Tensor | None = None) -> Tensor:
    """Mean squared error of radiance, optionally weighted (for example `batch.weight(batch.radiance)`).

    Args:
        rendered: [..., C].
        measured: [..., C].
        weight: broadcastable, not negative; the loss is divided by its mean.
    """
    squared = (rendered - measured).square()
    return squared.mean() if weight is None else (weight * squared).sum() / weight.expand_as(squared).sum()


def likelihood(rendered: Tensor, batch: Batch, *, degrees_of_freedom: float | None = None) -> Tensor:
    """Mean negative log-likelihood of a batch under its camera's noise (Gaussian, variance = read² + gain·signal).

    The variance is that of the rendered signal. A value that the sensor clips counts with the probability that it does.
    Terms that do not depend on the rendered radiance are left out.

    Args:
        rendered: radiance [n, 1 or C].
        batch: the measured values [n, C] and their noise.
        degrees_of_freedom: ν of Student's t distribution of the same scale instead of the Gaussian, for samples with
            outliers (dust, shadow edges); 4 is usual, large values approach the Gaussian.
    """
    variance = batch.variance(rendered)
    misfit = (batch.radiance - rendered).square() / variance
    if degrees_of_freedom is not None:
        misfit = (degrees_of_freedom + 1) * torch.log1p(misfit / degrees_of_freedom)
    value = 0.5 * (misfit + torch.log(variance))
    clipped, limits = batch.noise.clipped, batch.noise.limits
    if clipped is not None and limits is not None:
        lower, upper = limits
        # Values that are not clipped take their own radiance: an infinite limit would make gradients NaN.
        ends = torch.where(clipped > 0, upper, torch.where(clipped < 0, lower, batch.radiance))
        beyond = (rendered - ends) * clipped.sign() / variance.sqrt()
        value = torch.where(clipped == 0, value, -torch.special.log_ndtr(beyond))
    return value.mean()


def structural(rendered: Tensor, measured: Tensor, window: int = 11) -> Tensor:
    """1 − SSIM (structural similarity) of whole images, averaged over pixels and channels (kornia).

    Args:
        rendered: images [K, H, W, C] as `matest.render` returns them.
        measured: the same.
        window: side of the Gaussian window in pixels.
    """
    from kornia.metrics import ssim

    peak = float(measured.detach().max())
    return 1 - ssim(rendered.movedim(-1, 1), measured.movedim(-1, 1), window, max_val=max(peak, 1e-12)).mean()
