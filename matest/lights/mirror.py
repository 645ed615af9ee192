"""Photographs of mirror spheres, and what the spheres show of the lights."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from matest.errors import InputError
from matest.lights.directions import Sighting, sight
from matest.lights.highlight import Candidates, candidates, choose
from matest.lights.sphere import MirrorSphere
from matest.photographs.images import full_scale, read_image
from matest.photographs.photometry import Encoding
from matest.progress import Progress, silent
from matest.workers import in_threads


@dataclass(frozen=True)
class Mirror:
    """Photographs of mirror spheres under one light each.

    Attributes:
        folder: that holds them.
        files: the photographs.
        names: of the photographs, as a light list calls them.
        spheres: in every one of them.
        mask: H×W, nonzero where the spheres can be seen; None: everywhere.
        encoding: from pixels to brightness.
        shape: height and width of every photograph in pixels.
    """

    folder: Path
    files: tuple[Path, ...]
    names: tuple[str, ...]
    spheres: tuple[MirrorSphere, ...]
    mask: np.ndarray | None
    encoding: Encoding
    shape: tuple[int, int]

    def brightness(self, index: int) -> np.ndarray:
        """A photograph as H×W mean of the channels, 1 where all are saturated; relative where none ever is.

        Raises:
            InputError: it cannot be read, or has another size than the first.
        """
        path = self.files[index]
        stored = read_image(path)
        if stored.shape[:2] != self.shape:
            raise InputError(
                f"{path}: expected the size of {self.files[0].name}, {self.shape[0]}×{self.shape[1]}; got "
                f"{stored.shape[0]}×{stored.shape[1]}. The sphere must be at the same place in all photographs."
            )
        if self.encoding.saturation is None:
            unbounded: np.ndarray = self.encoding.linear(stored.astype(np.float32)).mean(axis=2)
            return unbounded
        limits = np.asarray(self.encoding.saturation, dtype=np.float32)
        clipped = np.minimum(stored / np.float32(full_scale(stored.dtype)), limits)
        shares: np.ndarray = (self.encoding.linear(clipped) / self.encoding.linear(limits)).mean(axis=2)
        return shares

    def sightings(self, progress: Progress = silent) -> list[list[Sighting]]:
        """What every sphere shows of the light of every photograph: a list for each sphere.

        Raises:
            InputError: a photograph cannot be read, or its highlight cannot be told from the rest.
        """
        saturation = math.inf if self.encoding.saturation is None else 1.0

        def patches(index: int) -> list[Candidates]:
            image = self.brightness(index)
            return [candidates(image, sphere, self.mask, saturation) for sphere in self.spheres]

        found = []
        for count, one in enumerate(in_threads(patches, range(len(self.files))), start=1):
            found.append(one)
            progress("reading images", count, len(self.files))
        return [
            [sight(patch, sphere) for patch in choose([one[k] for one in found], self.files)]
            for k, sphere in enumerate(self.spheres)
        ]
