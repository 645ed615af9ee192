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
    rows, columns = np.indices(shape) + 0.5
    distance = np.hypot(columns - centre[0], rows - centre[1])
    share = (distance < radius).astype(float)
    # Half a pixel's diagonal, and what the waves come to at most: only pixels so near the edge are divided.
    reach = np.sqrt(0.5) + (0.0 if waves is None else float(np.abs(waves).sum()))
    crossed = np.abs(distance - radius) <= reach
    steps = (np.arange(subpixels) + 0.5) / subpixels - 0.5
    right = columns[crossed][:, None, None] + steps - centre[0]
    down = rows[crossed][:, None, None] + steps[:, None] - centre[1]
    edge: float | np.ndarray = radius
    if waves is not None:
        angle = np.arctan2(down, right)
        for number, (cosine, sine) in enumerate(waves):
            edge = edge + cosine * np.cos(number * angle) + sine * np.sin(number * angle)
    share[crossed] = (np.hypot(right, down) < edge).mean(axis=(1, 2))
    return share
