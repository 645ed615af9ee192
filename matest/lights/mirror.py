"""Photographs of spheres under one light each, and what mirror spheres show of the lights."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from matest.errors import InputError
from matest.lights.directions import Sighting, sight
from matest.lights.highlight import Candidates, candidates, choose
from matest.lights.sphere import MirrorSphere
from matest.photographs.images import ImageFile, full_scale, read_image_file
from matest.photographs.photometry import Encoding
from matest.progress import Progress, silent
from matest.workers import in_threads


@dataclass(frozen=True)
class Mirror:
    """Photographs of spheres under one light each: of mirrors, or of a matte one that measures how strong lights are.

    Attributes:
        folder: that holds them.
        files: the photographs.
        names: of the photographs, as a light list calls them.
        spheres: in every one of them.
        mask: H×W, nonzero where the spheres can be seen; None: everywhere.
        encoding: from pixels to brightness.
        shape: height and width of every photograph in pixels.
        exposures: of each photograph as stated; None where nothing states it; none at all: nothing states any.
        outline_seen: whether the outline of its sphere comes from edges in the photographs.
    """

    folder: Path
    files: tuple[Path, ...]
    names: tuple[str, ...]
    spheres: tuple[MirrorSphere, ...]
    mask: np.ndarray | None
    encoding: Encoding
    shape: tuple[int, int]
    exposures: tuple[float | None, ...] = ()
    outline_seen: bool = False

    def brightness(self, index: int) -> np.ndarray:
        """A photograph as H×W mean of the channels, 1 where all are saturated; relative where none ever is.

        Raises:
            InputError: it cannot be read, or has another size than the first.
        """
        stored = self._stored(index).pixels
        if self.encoding.saturation is None:
            unbounded: np.ndarray = self.encoding.linear(stored.astype(np.float32)).mean(axis=2)
            return unbounded
        limits = np.asarray(self.encoding.saturation, dtype=np.float32)
        clipped = np.minimum(stored / np.float32(full_scale(stored.dtype)), limits)
        shares: np.ndarray = (self.encoding.linear(clipped) / self.encoding.linear(limits)).mean(axis=2)
        return shares

    def radiance(self, index: int, pixels: np.ndarray) -> np.ndarray:
        """Radiance of some pixels of a photograph, by their flat indices [n], [n, C]; NaN where they are saturated.

        Raises:
            InputError: it cannot be read, or has another size than the first.
        """
        file = self._stored(index)
        stored = file.pixels.reshape(-1, file.pixels.shape[2])[pixels]
        stated = self.exposures[index] if self.exposures else None
        exposure = next((value for value in (stated, file.exposure) if value is not None), 1.0)
        signal = self.encoding.signal(stored, pixels) / exposure
        values: np.ndarray = np.where(self.encoding.saturated(stored), np.nan, signal)
        return values

    def radiances(self, pixels: np.ndarray, what: str, progress: Progress = silent) -> np.ndarray:
        """Radiance of some pixels of all K photographs [K, n, C], float64.

        Args:
            pixels: their flat indices [n].
            what: the photographs show, for the progress.
            progress: told of every photograph.

        Raises:
            InputError: one that cannot be read, or has another size or other channels than the first.
        """
        parts = []
        read = in_threads(lambda index: self.radiance(index, pixels), range(len(self.files)))
        for done, values in enumerate(read, start=1):
            parts.append(values.astype(np.float64))
            progress(f"reading the {what}", done, len(self.files))
        if len({values.shape[1] for values in parts}) > 1:
            raise InputError(f"{self.folder}: photographs in grey and in colour; convert them to one of the two.")
        return np.stack(parts)

    def _stored(self, index: int) -> ImageFile:
        path = self.files[index]
        file = read_image_file(path)
        height, width = file.pixels.shape[:2]
        if (height, width) != self.shape:
            raise InputError(
                f"{path}: expected the size of {self.files[0].name}, {self.shape[0]}×{self.shape[1]}; got "
                f"{height}×{width}. The sphere must be at the same place in all photographs."
            )
        return file

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
