"""Errors of the calibration of photographs together: what they do to samples, blur included."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from weakref import WeakKeyDictionary

import torch
from torch import Tensor

from matest.photographs.nuisances import NUISANCES
from matest.photographs.pixels import LitPixels
from matest.photographs.world import World, Worlds
from matest.samples.batch import Batch
from matest.samples.calibration import Displaced
from matest.samples.groups import Groups

# Pixels. Blur that reaches farther is no small error of a calibration.
_LARGEST_STRIDE = 4


class PhotographCalibration:
    """The families of errors of some photographs, and what they do to samples.

    Args:
        samples: of the photographs.
        groups: of the samples.
        names: of the kinds of errors, in the order of their unknowns.
    """

    def __init__(self, samples: LitPixels, groups: Groups, names: Sequence[str]) -> None:
        self._worlds = Worlds(samples)
        self._groups = groups
        self._names = names
        self.families = [NUISANCES[name].family(self._worlds, groups) for name in names]
        # What does not change with the errors, for batches that are asked for more than once: of the pixels of a batch
        # (stride 0), and of those around them at some stride.
        self._exact: WeakKeyDictionary[Batch, dict[int, World]] = WeakKeyDictionary()

    def displaced(self, batch: Batch, values: Tensor) -> Displaced:
        """See `Calibration`."""
        if batch.pixels is None:
            raise ValueError("errors of the calibration need samples that say which pixel they are.")
        widths = [family.width for family in self.families]
        parts = dict(zip(self._names, values.split(widths, dim=1), strict=True))
        displaced = self._acted(self._world(batch, batch.pixels, 0), parts)
        variance = parts.get("blur")
        if variance is None:
            return displaced
        stride = blur_stride(float(variance.detach().mean()))
        around, inside = self._worlds.grid.around(batch.pixels, stride)
        with torch.no_grad():
            # Errors that are 0 change nothing.
            copies = {name: part.repeat(len(around), 1) for name, part in parts.items() if bool(part.any())}
            beside = self._acted(self._world(batch, around.flatten(), stride), copies)
        return replace(displaced, weights=blur_weights(variance[:, 0], stride, inside), around=beside)

    def _acted(self, world: World, values: Mapping[str, Tensor]) -> Displaced:
        for name, nuisance in NUISANCES.items():
            if name in values:
                nuisance.act(world, values[name], self._worlds)
        return Displaced(
            points=world.points(),
            body=world.body,
            power=world.power,
            white=None if world.power is None else world.places.white,
            offset=world.offset,
        )

    def _world(self, batch: Batch, pixels: Tensor, stride: int) -> World:
        """The exact world of the pixels of a batch, or of some at a stride around each of them."""
        worlds = self._exact.setdefault(batch, {})
        if stride not in worlds:
            worlds[stride] = self._worlds.of(batch, self._groups.image_of(batch), pixels)
        return replace(worlds[stride])


def blur_stride(variance: float) -> int:
    """Distance of the pixels whose weighted sum has the mean square and the mean fourth power of a Gaussian, rounded.

    Args:
        variance: of the Gaussian, pixels².
    """
    return min(max(round(math.sqrt(3 * max(variance, 0.0))), 1), _LARGEST_STRIDE)


def blur_weights(variance: Tensor, stride: int, inside: Tensor) -> Tensor:
    """Weights [9, n] of samples and of the pixels around each in blurred values; a background is black.

    They are products of those of a row and of a column, by the three-point rule of Gauss and Hermite.

    Args:
        variance: of the Gaussian, pixels² [n].
        stride: from a pixel to those around it.
        inside: whether these are on the object [8, n].
    """
    side = variance / (2 * stride**2)
    line = torch.stack([side, 1 - 2 * side, side])
    square = (line[:, None] * line[None]).flatten(0, 1)
    middle = len(square) // 2
    return torch.cat([square[middle : middle + 1], torch.cat([square[:middle], square[middle + 1 :]]) * inside])
