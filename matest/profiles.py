"""Cross-sections of images: brightness along a line, compared between images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from matest.errors import InputError

Line = tuple[float, float, float, float]
# Share of the pixels of an image that are not brighter than its peak: highlights do not count.
_PEAK = 0.99
# Share of the peak from which on a pixel is bright: the ratio of darker ones may be that of two black levels.
_BRIGHT = 0.25


@dataclass(frozen=True)
class Comparison:
    """Brightness of several images along one line.

    Attributes:
        distance: along the line, pixels [n].
        profiles: brightness (mean over channels) of each image [m, n].
        names: of the images; the first is the reference.
        rms: root mean square difference from the reference, per image.
        maximum: largest absolute difference from the reference.
        peak: distance at which each profile is brightest.
    """

    distance: np.ndarray
    profiles: np.ndarray
    names: list[str]
    rms: list[float]
    maximum: list[float]
    peak: list[float]


def middle_row(shape: tuple[int, int]) -> Line:
    """The horizontal line through the middle of an image, x0, y0, x1, y1."""
    return (0.0, shape[0] // 2, shape[1] - 1.0, shape[0] // 2)


def cross_section(image: np.ndarray, line: Line) -> np.ndarray:
    """Brightness (mean over channels) of an image H×W[×C] along a line of pixel indices, one value per pixel step."""
    from skimage.measure import profile_line

    x0, y0, x1, y1 = line
    plane = image if image.ndim == 2 else image.mean(axis=2)
    return profile_line(plane, (y0, x0), (y1, x1), order=1, mode="constant")


def ratio_of_bright(image: np.ndarray, reference: np.ndarray) -> float | None:
    """The ratio of the medians of two images H×W×C over the pixels where both are bright; None where none are."""
    planes = [one.mean(axis=2) for one in (image, reference)]
    bright = np.logical_and(*(plane > _BRIGHT * np.quantile(plane, _PEAK) for plane in planes))
    if not bright.any():
        return None
    return float(np.median(planes[0][bright]) / np.median(planes[1][bright]))


def compare(images: list[np.ndarray], names: list[str], line: Line) -> Comparison:
    """Profiles of images along a line, and the differences from the first.

    Raises:
        InputError: images of different sizes, or a line that leaves them.
    """
    shape = images[0].shape[:2]
    for image, name in zip(images, names, strict=True):
        if image.shape[:2] != shape:
            raise InputError(
                f"{name}: expected the size of {names[0]} ({shape[0]}×{shape[1]}); got {image.shape[0]}×"
                f"{image.shape[1]}. Render the images at one size."
            )
    x0, y0, x1, y1 = line
    if not all(0 <= x <= shape[1] - 1 and 0 <= y <= shape[0] - 1 for x, y in ((x0, y0), (x1, y1))):
        raise InputError(
            f"the line {x0:g},{y0:g} to {x1:g},{y1:g} leaves the image: x runs from 0 to {shape[1] - 1}, y from 0 to "
            f"{shape[0] - 1}."
        )
    profiles = np.stack([cross_section(image, line) for image in images])
    difference = profiles - profiles[0]
    distance = np.arange(profiles.shape[1], dtype=float)
    return Comparison(
        distance=distance,
        profiles=profiles,
        names=names,
        rms=np.sqrt((difference**2).mean(axis=1)).tolist(),
        maximum=np.abs(difference).max(axis=1).tolist(),
        peak=distance[profiles.argmax(axis=1)].tolist(),
    )
