"""Channels and photographs that say nothing that others have not said."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from torch import Tensor

from matest.samples.redundancy import Redundancy

if TYPE_CHECKING:
    from matest.photographs.photographs import Photographs

# Pixels that are compared before all of them are.
_GLANCE = 1024
# An image is even if no larger share of its pixels differs from most of them.
_EVEN = 0.01


def without_copies(photographs: Photographs) -> Photographs:
    """One channel where all channels are copies of it: a grey image stored as a coloured one.

    Their noise is the same too; taken for independent it would count as often as there are channels.
    """
    if photographs.channels == 1 or not all(_alike(tensor) for tensor in _colours(photographs)):
        return photographs
    scene, encoding = photographs.scene, photographs.encoding
    calibration = [part for part in (encoding.black, encoding.flat) if isinstance(part, np.ndarray)]
    for part in (*photographs.stored, *calibration):
        if not all(_equal(part[:, 0], part[:, channel]) for channel in range(1, part.shape[1])):
            return photographs
    wavelength = None if scene.wavelength is None else scene.wavelength[:1]
    lights = tuple(tuple(light.channel(0) for light in lights) for lights in scene.lights)
    black = encoding.black[:, :1] if isinstance(encoding.black, np.ndarray) else encoding.black
    flat = None if encoding.flat is None else encoding.flat[:, :1]
    return replace(
        photographs,
        stored=tuple(np.ascontiguousarray(pixels[:, :1]) for pixels in photographs.stored),
        scene=replace(scene, lights=lights, ambient=scene.ambient[:, :1], wavelength=wavelength),
        encoding=replace(encoding, black=black, flat=flat),
    )


def redundancy(photographs: Photographs, images: Iterable[int]) -> Redundancy:
    """Of some images those that add nothing to the others, and those that contradict an earlier one.

    An image adds nothing where no light falls in it as it is stated, or where it is a photograph that is there already,
    pixel by pixel and under the same light. Images that are even all over contradict none: black and clipped ones are
    alike whatever the light.
    """
    images = tuple(images)
    lit = [image for image in images if _lit(photographs, image)]
    reasons = {image: "its lights are stated to give none" for image in images if image not in lit}
    contradictions = {}
    for image, twin in _twins(photographs, lit).items():
        if _stated_alike(photographs, image, twin):
            reasons[image] = f"it is the photograph {photographs.names[twin]} once more"
        elif _varied(photographs.stored[image]):
            contradictions[image] = twin
    return Redundancy(dict(sorted(reasons.items())), contradictions=contradictions)


def _twins(photographs: Photographs, images: Iterable[int]) -> dict[int, int]:
    """Of some images those that are an earlier one pixel by pixel, and which.

    Of several that are, one stated to be under the same light.
    """
    twins: dict[int, int] = {}
    likely: dict[bytes, list[int]] = {}
    for image in images:
        pixels = photographs.stored[image]
        # Zeros have two signs.
        others = likely.setdefault((_glance(pixels) + 0).tobytes(), [])
        if others:
            same = [other for other in others if np.array_equal(pixels, photographs.stored[other])]
            same.sort(key=lambda other: not _stated_alike(photographs, image, other))
            twins |= {image: same[0]} if same else {}
        others.append(image)
        # Pixels that lie in a temporary file are not to fill the memory.
        for other in others:
            photographs.release(other)
    return twins


def _varied(pixels: np.ndarray) -> bool:
    return float((pixels != np.median(pixels, axis=0)).any(axis=1).mean()) > _EVEN


def _lit(photographs: Photographs, image: int) -> bool:
    scene = photographs.scene
    return bool((scene.ambient[image] > 0).any()) or any(bool((light.power > 0).any()) for light in scene.lights[image])


def _stated_alike(photographs: Photographs, image: int, other: int) -> bool:
    """Whether two images are stated to be taken under the same light with the same exposure."""
    scene, exposures = photographs.scene, photographs.exposures
    if exposures[image] != exposures[other] or len(scene.lights[image]) != len(scene.lights[other]):
        return False
    alike = all(one.same_as(two) for one, two in zip(scene.lights[image], scene.lights[other], strict=True))
    return alike and bool(scene.ambient[image].equal(scene.ambient[other]))


def _equal(one: np.ndarray, other: np.ndarray) -> bool:
    return np.array_equal(_glance(one), _glance(other)) and np.array_equal(one, other)


def _glance(pixels: np.ndarray) -> np.ndarray:
    """A few values from their middle: they tell most images apart, and no more is read of those."""
    return pixels[len(pixels) // 2 : len(pixels) // 2 + _GLANCE]


def _colours(photographs: Photographs) -> list[Tensor]:
    """What is known of every channel [..., C], beside the pixels."""
    scene = photographs.scene
    wavelength = [] if scene.wavelength is None else [scene.wavelength]
    return [scene.ambient, *wavelength, *(light.power for lights in scene.lights for light in lights)]


def _alike(values: Tensor) -> bool:
    return bool((values == values[..., :1]).all())
