"""Photographs of a scene: pixels as a camera stored them, and the radiance that they encode."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from matest.errors import InputError
from matest.photographs import storage
from matest.photographs.codes import Clipping
from matest.photographs.file_images import FileImages
from matest.photographs.noise import Noise
from matest.photographs.photometry import Encoding
from matest.photographs.redundant import redundancy, without_copies
from matest.photographs.samples import PhotographSamples
from matest.scene import Scene


@dataclass(frozen=True)
class Photographs:
    """Photographs with their geometry and light; only the object's pixels are kept, as stored.

    Attributes:
        scene: surface, lights, shadows.
        stored: per image the object's pixels [N, C], integers or floats as in the file.
        encoding: from pixels to radiance.
        exposures: per image.
        noise: of the camera, stated or estimated from the images.
        noise_stated: whether it is stated.
        clipping: levels below full scale at which the values pile up; None: there are none.
        relative: True when the common scale of the lights is unknown.
        names: of the images, as people know them.
        notes: what was done to the values that the files store, as sentences.
    """

    scene: Scene
    stored: Sequence[np.ndarray]
    encoding: Encoding
    exposures: tuple[float, ...]
    noise: Noise
    noise_stated: bool
    relative: bool
    names: tuple[str, ...]
    clipping: Clipping | None = None
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.stored)

    @property
    def channels(self) -> int:
        return self.stored[0].shape[1]

    def take(self, selection: np.ndarray) -> Photographs:
        """The same photographs of some of the object's pixels (boolean [N]), in the shadows of all of them."""
        stored = self.stored
        return replace(
            self,
            scene=self.scene.take(selection),
            stored=stored.take(selection)
            if isinstance(stored, FileImages)
            else tuple(pixels[selection] for pixels in stored),
            encoding=self.encoding.take(selection),
        )

    def object(self, name: str | None, label: str) -> Photographs:
        """The photographs of one object of several, in the shadows of all; themselves where they show one without name.

        Args:
            name: of the object; None: the only one.
            label: of the capture, begins a refusal.

        Raises:
            InputError: see `Objects.number`.
        """
        objects = self.scene.surface.objects
        if objects is None:
            if name is not None:
                raise InputError(f"{label}: shows one object, which has no name; leave out '{name}'.")
            return self
        alone = self.take(objects.pixels_of(objects.number(name, label)))
        surface = replace(alone.scene.surface, objects=None)
        return replace(alone, scene=replace(alone.scene, surface=surface))

    def radiance(self, image: int, index: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Measured radiance [n, C] of object pixels, float32."""
        return self.encoding.signal(self.pixels(image, index), index, self.encoding.scale / self.exposures[image])

    def pixels(self, image: int, index: np.ndarray | slice) -> np.ndarray:
        """Some of the object's pixels as stored [n, C]."""
        stored = self.stored[image]
        return stored[index] if isinstance(index, slice) else np.take(stored, index, axis=0)

    def release(self, image: int) -> None:
        """Free the memory of an image's pixels if they are mapped from a temporary file."""
        storage.release(self.stored[image])

    def samples(
        self,
        images: Iterable[int] | None = None,
        *,
        distinct: bool = False,
        every_channel: bool = False,
        dtype: torch.dtype = torch.float32,
        device: torch.device | str = "cpu",
    ) -> PhotographSamples:
        """Geometry and photometry of every lit pixel, tile by tile.

        Args:
            images: that give pixels; None: all.
            distinct: leave out images and channels that add nothing to the others; the samples' `redundancy` names
                them.
            every_channel: with `distinct`, keep channels that are copies nevertheless.
            dtype, device: of the tensors.
        """
        selection = tuple(range(len(self))) if images is None else tuple(images)
        if not distinct:
            return PhotographSamples(self, selection, dtype, device)
        photographs = self if every_channel else without_copies(self)
        redundant = replace(redundancy(photographs, selection), channels=self.channels - photographs.channels)
        distinct_images = tuple(image for image in selection if image not in redundant.images)
        return PhotographSamples(photographs, distinct_images, dtype, device, redundant)
