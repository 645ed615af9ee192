"""Channels and photographs that add nothing to the others: copies, and photographs without light."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from matest.photographs.file_images import FileImages
from matest.samples.redundancy import Redundancy

if TYPE_CHECKING:
    from matest.photographs.photographs import Photographs

# Pixels that are compared first: they differ in most pairs of images, whose other pixels then stay on disk.
_EXCERPT = 1024
# Largest share of the pixels of an even image that differ from its median: dust and hot pixels are fewer.
_EVEN_SHARE = 0.01


def without_copies(photographs: Photographs) -> Photographs:
    """The same photographs with one channel, if all channels are copies of it: grey images in a format for colours.

    Copies have the same noise. Counted as independent values, they would make error bars too small.
    """
    scene, encoding, stored = photographs.scene, photographs.encoding, photographs.stored
    colours = [scene.ambient, *(light.power for lights in scene.lights for light in lights)]
    colours += [] if scene.wavelength is None else [scene.wavelength]
    if photographs.channels == 1 or not all(bool((colour == colour[..., :1]).all()) for colour in colours):
        return photographs
    calibration = [part for part in (encoding.black, encoding.flat) if isinstance(part, np.ndarray)]
    for part in (*stored, *calibration):
        if not all(_equal(part[:, 0], part[:, channel]) for channel in range(1, part.shape[1])):
            return photographs
    wavelength = None if scene.wavelength is None else scene.wavelength[:1]
    lights = tuple(tuple(light.channel(0) for light in lights) for lights in scene.lights)
    black = encoding.black[:, :1] if isinstance(encoding.black, np.ndarray) else encoding.black
    flat = None if encoding.flat is None else encoding.flat[:, :1]
    saturation = encoding.saturation[0] if isinstance(encoding.saturation, tuple) else encoding.saturation
    return replace(
        photographs,
        stored=stored.first_channel()
        if isinstance(stored, FileImages)
        else tuple(np.ascontiguousarray(pixels[:, :1]) for pixels in stored),
        scene=replace(scene, lights=lights, ambient=scene.ambient[:, :1], wavelength=wavelength),
        encoding=replace(encoding, black=black, flat=flat, saturation=saturation),
    )


def redundancy(photographs: Photographs, images: Iterable[int]) -> Redundancy:
    """The images that add nothing to the others, and those that contradict an earlier one.

    An image adds nothing if its stated lights have no power, or if an earlier image has the same pixels under the same
    light. An even image contradicts none: black and clipped photographs look alike under every light.
    """
    images = tuple(images)
    lit = [image for image in images if _lit(photographs, image)]
    reasons = {image: _darkness(photographs, image) for image in images if image not in lit}
    contradictions = {}
    for image, twin in _twins(photographs, lit).items():
        if _stated_alike(photographs, image, twin):
            reasons[image] = f"it is the photograph {photographs.names[twin]} once more"
        elif _varied(photographs.stored[image]):
            contradictions[image] = twin
    return Redundancy(dict(sorted(reasons.items())), contradictions=contradictions)


def _twins(photographs: Photographs, images: Iterable[int]) -> dict[int, int]:
    """Images with the pixels of an earlier one, each with that one.

    Of several such it is the first under the same stated light, or else the first.
    """
    twins: dict[int, int] = {}
    by_excerpt: dict[bytes, list[int]] = {}
    for image in images:
        pixels = photographs.stored[image]
        # Adding 0 makes −0 and 0 the same bytes.
        candidates = by_excerpt.setdefault((_excerpt(pixels) + 0).tobytes(), [])
        equal = [other for other in candidates if np.array_equal(pixels, photographs.stored[other])]
        if equal:
            twins[image] = min(equal, key=lambda other: not _stated_alike(photographs, image, other))
        candidates.append(image)
        # Pixels mapped from a temporary file must not stay in memory.
        for other in candidates:
            photographs.release(other)
    return twins


def _varied(pixels: np.ndarray) -> bool:
    """Whether more than a few pixels differ from the median."""
    return float((pixels != np.median(pixels, axis=0)).any(axis=1).mean()) > _EVEN_SHARE


def _lit(photographs: Photographs, image: int) -> bool:
    """Whether any light of an image is stated to have power."""
    scene = photographs.scene
    return bool((scene.ambient[image] > 0).any()) or any(bool((light.power > 0).any()) for light in scene.lights[image])


def _darkness(photographs: Photographs, image: int) -> str:
    """Why no light falls in an image."""
    return "its lights are stated to give none" if photographs.scene.lights[image] else "no light is stated for it"


def _stated_alike(photographs: Photographs, image: int, other: int) -> bool:
    """Whether two images are stated to be taken under the same light with the same exposure."""
    scene, exposures = photographs.scene, photographs.exposures
    keys = [[light.key for light in scene.lights[k]] for k in (image, other)]
    return (
        exposures[image] == exposures[other]
        and keys[0] == keys[1]
        and bool(scene.ambient[image].equal(scene.ambient[other]))
    )


def _equal(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two arrays are equal, looking at an excerpt first."""
    return np.array_equal(_excerpt(one), _excerpt(other)) and np.array_equal(one, other)


def _excerpt(pixels: np.ndarray) -> np.ndarray:
    """The first pixels of the second half."""
    return pixels[len(pixels) // 2 : len(pixels) // 2 + _EXCERPT]
