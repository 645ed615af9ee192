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

# Variance below which a Gaussian reaches hardly beyond the next pixel, pixels².
_NARROW = 0.2
# Pixels. Blur that reaches farther is no small error of a calibration.
_LARGEST_STEP = 8


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
        # (no steps), and of those around them by some steps.
        self._exact: WeakKeyDictionary[Batch, dict[tuple[int, ...], World]] = WeakKeyDictionary()

    def displaced(self, batch: Batch, values: Tensor) -> Displaced:
        """See `Calibration`."""
        if batch.pixels is None:
            raise ValueError("errors of the calibration need samples that say which pixel they are.")
        widths = [family.width for family in self.families]
        parts = dict(zip(self._names, values.split(widths, dim=1), strict=True))
        displaced = self._acted(self._world(batch, batch.pixels, ()), parts)
        variance = parts.get("blur")
        if variance is None:
            return displaced
        steps = blur_steps(float(variance.detach().mean()))
        around, inside = self._worlds.grid.around(batch.pixels, steps)
        with torch.no_grad():
            # Errors that are 0 change nothing.
            copies = {name: part.repeat(len(around), 1) for name, part in parts.items() if bool(part.any())}
            beside = self._acted(self._world(batch, around.flatten(), steps), copies)
        return replace(displaced, weights=blur_weights(variance[:, 0], steps, inside), around=beside)

    def _acted(self, world: World, values: Mapping[str, Tensor]) -> Displaced:
        for name, nuisance in NUISANCES.items():
            if name in values:
                nuisance.act(world, values[name], self._worlds)
        return Displaced(
            points=world.points(),
            body=world.body,
            power=world.power,
            curve=world.curve,
            departure=self._worlds.departure,
            white=None if world.power is None and world.curve is None else world.places.white,
            offset=world.offset,
        )

    def _world(self, batch: Batch, pixels: Tensor, steps: tuple[int, ...]) -> World:
        """The exact world of the pixels of a batch, or of some around each of them."""
        worlds = self._exact.setdefault(batch, {})
        if steps not in worlds:
            worlds[steps] = self._worlds.of(batch, self._groups.image_of(batch), pixels)
        return replace(worlds[steps])


def blur_steps(variance: float) -> tuple[int, ...]:
    """Distances of the pixels of a row or column whose weighted sum stands for a Gaussian: of one or two on each side.

    They are the nodes of the rules of Gauss and Hermite of three and of five points, rounded.

    Args:
        variance: of the Gaussian, pixels².
    """
    if variance < _NARROW:
        return (1,)
    near = max(round(math.sqrt((5 - math.sqrt(10)) * variance)), 1)
    far = max(round(math.sqrt((5 + math.sqrt(10)) * variance)), near + 1)
    return min(near, _LARGEST_STEP // 2), min(far, _LARGEST_STEP)


def blur_weights(variance: Tensor, steps: Sequence[int], inside: Tensor) -> Tensor:
    """Weights [1 + k, n] of samples and of the k pixels around each in blurred values; a background is black.

    They are products of those of a row and of a column, which have the mean square of the Gaussian and, of two steps on
    each side, its mean fourth power.

    Args:
        variance: of the Gaussian, pixels² [n].
        steps: from a pixel to those around it.
        inside: whether these are on the object [k, n].
    """
    squares = [float(step**2) for step in steps]
    if len(steps) == 1:
        sides = [variance / (2 * squares[0])]
    else:
        near, far = squares
        fourth = 3 * variance.square()
        sides = [
            (far * variance - fourth) / (2 * near * (far - near)),
            (fourth - near * variance) / (2 * far * (far - near)),
        ]
    middle = 1 - 2 * torch.stack(sides).sum(0)
    line = torch.stack([*reversed(sides), middle, *sides])
    square = (line[:, None] * line[None]).flatten(0, 1)
    here = len(square) // 2
    return torch.cat([square[here : here + 1], torch.cat([square[:here], square[here + 1 :]]) * inside])
