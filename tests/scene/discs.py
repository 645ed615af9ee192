"""Masks of discs."""

from __future__ import annotations

import numpy as np


def disc(
    shape: tuple[int, int],
    centre: tuple[float, float],
    radius: float,
    subpixels: int,
    waves: np.ndarray | None = None,
) -> np.ndarray:
    """Share of each pixel covered by a disc, 0 to 1; with one sub-pixel a binary mask.

    Args:
        waves: amplitudes [n, 2] of cosine and sine of no, one… n − 1 times the angle, added to the radius.
    """
    rows, columns = (np.indices((shape[0] * subpixels, shape[1] * subpixels)) + 0.5) / subpixels
    edge: float | np.ndarray = radius
    if waves is not None:
        angle = np.arctan2(rows - centre[1], columns - centre[0])
        for number, (cosine, sine) in enumerate(waves):
            edge = edge + cosine * np.cos(number * angle) + sine * np.sin(number * angle)
    inside = np.hypot(columns - centre[0], rows - centre[1]) < edge
    return inside.reshape(shape[0], subpixels, shape[1], subpixels).mean(axis=(1, 3))
