"""Maps of the light around a scene, from their files."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import torch
from torch import Tensor

from matest.capture.schema import LightTable
from matest.errors import Fault, refuse
from matest.photographs.images import read_image
from matest.photographs.photometry import as_tensor
from matest.scene.environment import (
    USUAL_COUNT,
    Environment,
    EnvironmentLight,
    environment_for,
    environment_of,
)


class EnvironmentMaps:
    """Makes the lights of a file from its maps, each of which is read once.

    Args:
        locate: gives the file that a key refers to, by the reference and the key.
        channels: of the photographs.
        curvature: of what the material reflects, 1/rad², by which maps get their directions; None: it is not known.
    """

    def __init__(self, locate: Callable[[str, str], Path], channels: int, curvature: float | None) -> None:
        self._locate, self._channels, self._curvature = locate, channels, curvature
        self._made: dict[tuple[str, float, int | None], Environment] = {}

    def light(self, table: LightTable, label: str) -> EnvironmentLight:
        """The light of a table that names a map.

        Args:
            table: of the light.
            label: of the light, for refusals.

        Raises:
            InputError: see `read_environment`.
        """
        scale, count, name = 1.0 if table.scale is None else table.scale, table.directions, table.environment or ""
        if (name, scale, count) not in self._made:
            radiance = scale * read_environment(self._locate(name, f"{label}: environment"), self._channels)
            if count is None and self._curvature is not None:
                environment = environment_for(radiance, self._curvature)
            else:
                environment = environment_of(radiance, count or USUAL_COUNT)
            self._made[name, scale, count] = environment
        return EnvironmentLight(self._made[name, scale, count], table.turn or 0.0)


def read_environment(path: Path, channels: int) -> Tensor:
    """The radiance of a map in latitude and longitude [R, 2 R, C].

    Args:
        path: of an image of floats.
        channels: of the photographs; a grey map serves any, and grey photographs take the mean of a coloured one.

    Raises:
        InputError: unreadable, integers, not twice as wide as high, negative, dark, or of other channels.
    """
    image = read_image(path)
    refuse(path, _faults(image.shape, image.dtype.kind, float(image.min()), float(image.max()), channels))
    radiance = as_tensor(image, torch.float64, "cpu")
    if channels == 1:
        radiance = radiance.mean(dim=2, keepdim=True)
    return radiance.expand(-1, -1, channels)


def _faults(shape: tuple[int, ...], kind: str, least: float, most: float, channels: int) -> Iterator[Fault]:
    """What is wrong with a map."""
    sentence = "an environment map holds radiance, floats (EXR, HDR); got integers. Convert it to linear EXR."
    yield kind != "f", sentence
    twice = shape[1] == 2 * shape[0] and shape[0] > 1
    sentence = (
        f"an environment map in latitude and longitude is twice as wide as high; got {shape[1]}×{shape[0]} pixels."
    )
    yield not twice, sentence
    yield least < 0, f"an environment map has no negative radiance; got {least:g}. Set such pixels to 0."
    yield most == 0, "the environment map is dark everywhere; leave out the light, or render the map again."
    fits = channels == 1 or shape[2] in (1, channels)
    yield not fits, f"an environment map has 1 channel or those of the images, {channels}; got {shape[2]}."
