"""The light around the mirrors of Li & Torrance's figure 3: a room with windows, as a map of radiance."""

from __future__ import annotations

import math

import numpy as np

# Corners of the room; its middle is where the mirrors hang.
LOWER, UPPER = np.array([-3.0, -1.4, -4.0]), np.array([3.0, 1.8, 4.0])
DAYLIGHT = (3.0, 3.4, 4.0)
FRAME = (0.75, 0.7, 0.62)
CEILING = (0.62, 0.6, 0.56)
TILES = (0.55, 0.47, 0.38), (0.1, 0.08, 0.07)
# Walls at the left, right, behind the mirrors and behind the viewer.
WALLS = (0.42, 0.34, 0.26), (0.3, 0.2, 0.16), (0.3, 0.34, 0.38), (0.24, 0.3, 0.26)
# Windows: the number of the wall, middle along it and up, half width and half height.
WINDOWS = (
    (0, -2.9, 0.3, 0.8, 0.9),
    (0, -0.7, 0.3, 0.8, 0.9),
    (1, -2.9, 0.3, 0.8, 0.9),
    (1, -0.7, 0.3, 0.8, 0.9),
    (3, 1.1, 0.2, 0.9, 1.1),
)
BAR = 0.06  # half the width of the bars of a window
# Light comes to a texel from so many points across and down.
_POINTS = 2


def room(rows: int = 256) -> np.ndarray:
    """Radiance [R, 2 R, 3], float32, in latitude and longitude as `environment` of a light has it."""
    fine = _POINTS * rows
    polar, azimuth = np.meshgrid(
        (np.arange(fine) + 0.5) * math.pi / fine, (np.arange(2 * fine) + 0.5) * math.pi / fine, indexing="ij"
    )
    toward = np.stack([np.sin(polar) * np.sin(azimuth), np.cos(polar), -np.sin(polar) * np.cos(azimuth)], axis=-1)
    radiance = _seen(toward).reshape(rows, _POINTS, 2 * rows, _POINTS, 3).mean((1, 3))
    return radiance.astype(np.float32)


def _seen(toward: np.ndarray) -> np.ndarray:
    """Radiance [..., 3] from unit vectors [..., 3]."""
    # The distance to the wall, floor or ceiling ahead along each axis.
    reach = np.where(toward > 0, UPPER, LOWER) / np.where(np.abs(toward) < 1e-12, 1e-12, toward)
    axis = reach.argmin(axis=-1)
    place = toward * reach.min(axis=-1, keepdims=True)
    x, y, z = np.moveaxis(place, -1, 0)
    radiance = np.zeros(toward.shape)
    radiance[(axis == 1) & (y > 0)] = CEILING
    tiles = (np.floor(1.25 * x) + np.floor(1.25 * z)) % 2 > 0
    for colour, chosen in zip(TILES, (tiles, ~tiles), strict=True):
        radiance[(axis == 1) & (y < 0) & chosen] = colour
    walls = [(axis == 0) & (x < 0), (axis == 0) & (x > 0), (axis == 2) & (z < 0), (axis == 2) & (z > 0)]
    for colour, wall in zip(WALLS, walls, strict=True):
        radiance[wall] = colour
    for number, middle, up, width, height in WINDOWS:
        along, above = np.abs((z if number < 2 else x) - middle), np.abs(y - up)
        radiance[walls[number] & (along < width + BAR) & (above < height + BAR)] = FRAME
        radiance[walls[number] & (along > BAR) & (above > BAR) & (along < width) & (above < height)] = DAYLIGHT
    return radiance
