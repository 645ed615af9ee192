"""The smooth squares of pixels on a surface, and the few samples that replace the pixels of each.

Small squares have 7×7 pixels. Over one of a smooth surface radiance is bilinear in row and column, to third order.
Least squares then need only the four bilinear coefficients of its 49 values. Four samples at ±2 rows and columns from
the centre carry these, each with the noise of 49/4 pixels averaged: rows −3…3 have the mean (0) and mean square (4) of
rows ±2. (For k×k pixels and ±s that takes k² = 12 s² + 1, which has no other solution in whole numbers below k = 97.)

Large squares have 21×21 pixels: 3×3 small ones. Over one radiance is biquadratic to fifth order, and nine samples, 8
pixels apart, replace the 36 of its small squares. Along a row they weigh 0.286, 0.427 and 0.286: these weights keep the
mean square of −10…10, and give a parabola 95 % of the precision that the pixels give it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np
import torch
from torch import Tensor

from matest.samples.merging import Tier
from matest.scene import Light, PointLight, Scene

# Pixels along the side of a small square: the smallest for which samples at whole pixels keep the mean square.
SMALL_SIDE = 7
SMALL_PIXELS = SMALL_SIDE**2
# Pixels that each of the four samples of a small square replaces.
SMALL_SHARE = SMALL_PIXELS / 4
# Indices of the four samples among the 49 pixels, row by row: ±2 rows and columns from the centre.
SMALL_NODES = (8, 12, 36, 40)
# Small squares in a large one: 3×3.
SMALL_PER_LARGE = 9
# Pixels along the side of a large square.
LARGE_SIDE = 3 * SMALL_SIDE
# Rows (and columns) of the samples of its small squares, from the centre of a large square: −7, 0 and 7, each ±2.
_SMALL_STEPS = (-9, -5, -2, 2, 5, 9)
# Rows (and columns) of its own samples, from its centre: wide enough for its mean square, at whole pixels.
_LARGE_STEPS = (-8, 0, 8)
# Rows (and columns) where radiance is compared with the biquadratic: half-way between its samples.
_LARGE_CHECKS = (-4, 4)
# Largest difference between the geometry of a smooth square and its polynomial: rad of normals and views, share of the
# lights' distance of positions, share of the sky. Creases, edges and noisy normals differ by more.
_SMOOTH = 5e-4


def _pixels_to_small() -> Tensor:
    """From the pixels of a small square to its bilinear part at the four samples, [4, 49]."""
    steps = torch.arange(SMALL_SIDE, dtype=torch.float64) - SMALL_SIDE // 2
    down, across = (grid.flatten() / 2 for grid in torch.meshgrid(steps, steps, indexing="ij"))
    bilinear = torch.stack([torch.ones_like(down), down, across, down * across])
    # These four functions are orthogonal over the four samples, and over all 49 pixels.
    return bilinear[:, list(SMALL_NODES)].T @ bilinear / SMALL_PIXELS


def _biquadratic(sources: tuple[int, ...], targets: tuple[int, ...]) -> Tensor:
    """From values at the rows and columns `sources` to their least-squares biquadratic at `targets`, [t², s²]."""
    at_sources, at_targets = (
        torch.tensor(steps, dtype=torch.float64)[:, None] ** torch.arange(3.0).double() for steps in (sources, targets)
    )
    along = at_targets @ torch.linalg.pinv(at_sources)
    return torch.kron(along, along)


def _large_shares() -> Tensor:
    """Pixels that each sample of a large square replaces [9]."""
    outer = (LARGE_SIDE**2 - 1) / 12 / (2 * _LARGE_STEPS[-1] ** 2)
    along = LARGE_SIDE * torch.tensor([outer, 1 - 2 * outer, outer], dtype=torch.float64)
    return torch.kron(along, along)


PIXELS_TO_SMALL = _pixels_to_small()
# From the 36 samples of its small squares to the nine samples of a large square, and back.
SMALL_TO_LARGE = _biquadratic(_SMALL_STEPS, _LARGE_STEPS)
LARGE_TO_SMALL = _biquadratic(_LARGE_STEPS, _SMALL_STEPS)
# A small square is checked at its centre, where the bilinear function is the mean of its four samples.
SMALL = Tier(torch.full((4,), SMALL_SHARE, dtype=torch.float64), torch.full((1, 4), 0.25, dtype=torch.float64))
LARGE = Tier(_large_shares(), _biquadratic(_LARGE_STEPS, _LARGE_CHECKS))


@dataclass(frozen=True)
class SmoothSquares:
    """Pixels of a surface by the square that they lie in, as indices into its N pixels.

    Attributes:
        small: pixels of M small squares, row by row [49, M]; first those inside the Q large squares: the Q at the first
            of nine places, then the Q at the second, and so on.
        large: pixels of the samples and of the checks of Q large squares [9 + 4, Q].
        single: pixels in no square.
    """

    small: np.ndarray
    large: np.ndarray
    single: np.ndarray


def find_squares(scene: Scene, blocks: np.ndarray) -> SmoothSquares:
    """The smooth squares of the scene's surface; small and large ones are each ordered by block [N]."""
    surface = scene.surface
    width = surface.shape[1]
    # In 32 bits, because memory limits the size of a capture here.
    index = np.full(surface.shape[0] * width, -1, dtype=np.int32)
    index[surface.pixels] = np.arange(len(surface), dtype=np.int32)

    # Squares are identified by the pixel at their centre.
    centres = _centres(surface.shape, SMALL_SIDE)
    pixels = index[centres + _around(range(-3, 4), width)]
    smooth = (pixels >= 0).all(axis=0)
    smooth[smooth] = _smooth(scene, pixels[:, smooth], PIXELS_TO_SMALL, SMALL_NODES)
    is_small = np.zeros(len(index), dtype=bool)
    is_small[centres[smooth]] = True

    inside = _around((-SMALL_SIDE, 0, SMALL_SIDE), width)
    large = _centres(surface.shape, LARGE_SIDE)
    large = large[is_small[large + inside].all(axis=0)]
    nodes = index[large + _around(_SMALL_STEPS, width)]
    large = large[_smooth(scene, nodes, LARGE_TO_SMALL @ SMALL_TO_LARGE, range(len(nodes)))]

    large = large[np.argsort(blocks[index[large]], kind="stable")]
    small_in_large = (large + inside).ravel()
    is_small[small_in_large] = False
    other_small = np.flatnonzero(is_small)
    other_small = other_small[np.argsort(blocks[index[other_small]], kind="stable")]
    small = index[np.concatenate([small_in_large, other_small]) + _around(range(-3, 4), width)]
    single = np.ones(len(surface), dtype=bool)
    single[small] = False
    offsets = np.concatenate([_around(_LARGE_STEPS, width), _around(_LARGE_CHECKS, width)])
    return SmoothSquares(small, index[large + offsets], np.flatnonzero(single))


def no_squares(pixels: int) -> SmoothSquares:
    """Every pixel of a surface single."""
    none = np.empty((0, 0), dtype=np.int64)
    return SmoothSquares(none.reshape(SMALL_PIXELS, 0), none.reshape(LARGE.size, 0), np.arange(pixels))


def rows_of_large(values: Tensor) -> Tensor:
    """From samples of small squares [4, C, 9 Q] to those of each of Q large squares, row by row [36, C, Q].

    The small squares at one place in their large squares follow each other, as in `SmoothSquares`.
    """
    # Axes: row and column of the sample in a small square, channel, row and column of that square in the large one.
    by_place = values.reshape(2, 2, values.shape[1], 3, 3, -1)
    return by_place.permute(3, 0, 4, 1, 2, 5).reshape(4 * SMALL_PER_LARGE, values.shape[1], -1)


def _centres(shape: tuple[int, int], side: int) -> np.ndarray:
    """Centre pixels of the squares that an image divides into, as flat indices."""
    rows, columns = (side * np.arange(size // side) + side // 2 for size in shape)
    return (rows[:, None] * shape[1] + columns).ravel()


def _around(steps: Iterable[int], width: int) -> np.ndarray:
    """Offsets in flat indices of the pixels at all pairs of row and column steps, row by row [steps², 1]."""
    along = np.array(list(steps))
    return (along[:, None] * width + along).reshape(-1, 1)


def _beams(lights: Iterable[Light], positions: Tensor | None) -> Iterator[Tensor]:
    """Share of its greatest intensity that each light with an axis sends toward every pixel, [N, 1]."""
    for light in lights:
        if isinstance(light, PointLight) and light.axis is not None and positions is not None:
            yield light.beam(light.at(positions.detach())[0]).float()


def _smooth(scene: Scene, pixels: np.ndarray, polynomial: Tensor, rows: Iterable[int]) -> np.ndarray:
    """Squares over which the geometry is a polynomial, bool [m].

    Args:
        scene: the surface, its lights and sky.
        pixels: n pixels of each of m squares [n, m].
        polynomial: from values at the n pixels to their polynomial at k of them [k, n].
        rows: which k of the n pixels.
    """
    surface = scene.surface
    features = [surface.normals_as(torch.float32).detach()]
    view = surface.view.float()
    if len(view) > 1:
        features.append(view)
    near = [light for lights in scene.lights for light in lights if light.near]
    if near and surface.positions is not None:
        closest = min(float(light.distance(surface.positions).min()) for light in near)
        features.append((surface.positions.detach() / closest).float())
    if scene.unoccluded is not None:
        features.append(torch.from_numpy(scene.unoccluded).float()[:, None])
    smooth = np.ones(pixels.shape[1], dtype=bool)
    index, compared = torch.from_numpy(pixels), list(rows)
    for feature in chain(features, _beams(near, surface.positions)):
        values = feature[index]
        expected = (polynomial.float() @ values.flatten(1)).reshape(len(compared), *values.shape[1:])
        smooth &= ((expected - values[compared]).abs().amax((0, 2)) < _SMOOTH).numpy()
    return smooth
