"""Columns: the radiance that lights give through each shape of a model; their weighted sum is that of every sample."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from matest.scene import Points
from matest.scene.points import LitPairs
from matest.shading import sky_light

# Units of rounding. Lights have one colour if their channels differ by a common factor up to so many: the irradiances
# of a colour are products of two or three numbers.
_COLOUR_TOLERANCE = 4


@dataclass(frozen=True)
class Columns:
    """Radiance of n samples at unit coefficient of each of K shapes.

    Attributes:
        values: [G, K, n]; G is 1 where channels differ by no more than `tint`, otherwise C.
        tint: factor of every channel [C].
    """

    values: Tensor
    tint: Tensor

    def radiance(self, coefficients: Tensor) -> Tensor:
        """Radiance [n, C] for coefficients [C, K]."""
        return self.sums(coefficients[:, None])[0]

    def sums(self, coefficients: Tensor) -> Tensor:
        """Several weighted sums [Q, n, C] for coefficients [C, Q, K]; each channel is an array of its own."""
        weights = coefficients.to(self.values) * self.tint[:, None, None]
        return (weights @ self.values).permute(1, 2, 0)

    def of_points(self, pairs: LitPairs) -> Columns:
        """Of n points, where these are of M pairs of them and their lights; of S copies in a row likewise."""
        by_pair = self.values.unflatten(-1, (-1, len(pairs.rows))).movedim(-1, 0)
        return Columns(pairs.sums(by_pair).movedim(0, -1).flatten(-2).contiguous(), self.tint)


def light_columns(
    points: Points,
    shapes: Sequence[Tensor],
    sky: Callable[[], Sequence[Tensor]],
    coefficients: Tensor | None,
    channels: int,
) -> Columns:
    """Columns of K shapes under the light of n points.

    Args:
        points: geometry and light.
        shapes: each [n, L, 1 or C], for every light; or, without coefficients, S sets of them [S, n, L, 1 or C], whose
            columns follow each other as those of S n samples.
        sky: gives each shape integrated over an even sky, [33, 1 or C] or [S, 33, 1 or C]; called where there is one.
        coefficients: of the shapes [C, K]; a light whose reflectance is below zero adds nothing. None: all lights add.
        channels: C.
    """
    from_sky = sky_light(points, sky)
    cosines, irradiance = points.wi[..., 2:].clamp(min=0), points.irradiance
    tint = _tint(irradiance, channels) if from_sky is None else None
    light = (irradiance if tint is None else irradiance[..., :1]) * cosines
    stacked = torch.stack(torch.broadcast_tensors(*shapes))
    if coefficients is not None:
        light = light * _positive(stacked, coefficients.to(stacked))
    values = (stacked * light)[..., 0, :] if light.shape[-2] == 1 else (stacked * light).sum(-2)
    if from_sky is not None:
        values = values + from_sky
    if values.shape[-1] > 1 or tint is None:
        values = values.expand(*values.shape[:-1], channels)
    values = values.flatten(1, -2).permute(2, 0, 1).contiguous()
    return Columns(values, values.new_ones(channels) if tint is None else tint)


def _positive(shapes: Tensor, coefficients: Tensor) -> Tensor:
    """1 where the reflectance Σk coefficients · shapes [K, ..., L, 1 or C] is not negative [..., L, 1 or C]."""
    if not shapes.numel():
        # Only the sky lights these points.
        return shapes.new_ones(1, 1, 1)
    if shapes.shape[-1] == 1:
        reflectance = (coefficients @ shapes.flatten(1)).reshape(-1, *shapes.shape[1:-1]).movedim(0, -1)
    else:
        reflectance = torch.einsum("ck,k...c->...c", coefficients, shapes)
    if float(reflectance.min()) >= 0:
        return shapes.new_ones(1, 1, 1)
    return (reflectance >= 0).to(shapes)


def _tint(irradiance: Tensor, channels: int) -> Tensor | None:
    """The factor of each channel [C] where it is the same for all lights [..., L, C]; otherwise None."""
    if irradiance.shape[-1] != channels or not irradiance.numel():
        return irradiance.new_ones(channels)
    rows = irradiance.flatten(0, -2)
    brightest = rows[rows[:, 0].argmax()]
    if not brightest[0] > 0:
        return None
    tint = brightest / brightest[0]
    tolerance = _COLOUR_TOLERANCE * torch.finfo(tint.dtype).eps
    return tint if torch.allclose(rows[:, :1] * tint, rows, rtol=tolerance, atol=0) else None
