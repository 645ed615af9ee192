"""A batch of samples: points, their measured radiance, and the noise of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from matest.samples.likelihood import Limits, MeasurementNoise, Readout
from matest.scene.points import Points, join_points


@dataclass(frozen=True, eq=False)
class Batch:
    """n samples.

    Attributes:
        points: geometry and light.
        radiance: measured, [n, C].
        noise: of the measured radiance.
        pixels: of each sample its place among the surface's N pixels, int64 [n]; None where there is no image.
        groups: label of the group that each sample belongs to (`Groups`), int64 [n]; None: all to group 0.
    """

    points: Points
    radiance: Tensor
    noise: MeasurementNoise
    pixels: Tensor | None = None
    groups: Tensor | None = None

    def __repr__(self) -> str:
        return f"Batch({self.radiance.numel()} values, {self.radiance.shape[-1]} channels)"

    def __len__(self) -> int:
        return len(self.radiance)

    def __getitem__(self, index: slice | Tensor) -> Batch:
        """Some of the samples."""
        pixels, groups = (None if part is None else part[index] for part in (self.pixels, self.groups))
        return Batch(self.points[index], self.radiance[index], self.noise[index], pixels, groups)

    @property
    def ungrouped(self) -> Batch:
        """The same samples, all in one group."""
        return replace(self, groups=None)

    def variance(self, radiance: Tensor) -> Tensor:
        """Noise variance of a sample of this true `radiance` [n, C]."""
        return self.noise.variance(radiance)

    def weight(self, radiance: Tensor) -> Tensor:
        """Inverse variance of samples of this true `radiance` [n, C]; 0 where the measured value is clipped."""
        weight = 1 / self.variance(radiance)
        return weight if self.noise.clipped is None else weight * (self.noise.clipped == 0)


def join(parts: Sequence[Batch]) -> Batch:
    """One batch of several; samples with fewer lights get dark ones."""
    if len(parts) == 1:
        return parts[0]
    pixels = [part.pixels for part in parts if part.pixels is not None]
    return Batch(
        points=join_points([part.points for part in parts], [len(part) for part in parts]),
        radiance=torch.cat([part.radiance for part in parts]),
        noise=_joined_noise(parts),
        pixels=torch.cat(pixels) if len(pixels) == len(parts) else None,
        groups=torch.cat([_labels(part) for part in parts]),
    )


def _joined_noise(parts: Sequence[Batch]) -> MeasurementNoise:
    noises, clipped, limits = [part.noise for part in parts], None, None
    if any(noise.clipped is not None for noise in noises):
        clipped = torch.cat(
            [
                torch.zeros_like(part.radiance, dtype=torch.int8) if part.noise.clipped is None else part.noise.clipped
                for part in parts
            ]
        )
    if noises[0].limits is not None:
        ends = [[end.expand(part.radiance.shape) for end in part.noise.limits or ()] for part in parts]
        limits = Limits(*(torch.cat(column) for column in zip(*ends, strict=True)))
    readouts = [[value.expand(len(part), -1) for value in part.noise.readout] for part in parts]
    readout = Readout(*(torch.cat(column) for column in zip(*readouts, strict=True)))
    return MeasurementNoise(readout, limits, clipped, noises[0].comparison)


def _labels(batch: Batch) -> Tensor:
    return torch.zeros(len(batch), dtype=torch.int64) if batch.groups is None else batch.groups
