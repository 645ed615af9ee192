"""Where smooth patches of pixels lie on a surface, and what a few samples of each say of the rest.

Over 7×7 pixels of a smooth surface radiance is bilinear in row and column, to third order. Least squares then need of
the 49 values no more than their four bilinear coefficients, and these are the same four numbers that single pixels at
±2 rows and columns from the centre would have given, each with the noise of 49/4 pixels averaged: over −3…3 as over
±2, x has mean 0 and mean square 4. (For k×k pixels and ±s that takes k² = 12 s² + 1, which has no other solution in
whole numbers below k = 97.)

Three by three such patches are a quilt of 21×21 pixels, over which radiance is biquadratic to fifth order: nine
samples, 8 pixels apart, stand for the 36 of its patches. Along a row they weigh 0.286, 0.427 and 0.286: x has the mean
square that it has over −10…10, and a parabola 95 % of the precision that the pixels give it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from matest.samples.merging import Tier
from matest.scene import Scene

SIDE = 7
PIXELS = SIDE * SIDE
# Pixels that each of the four stands for.
SHARE = PIXELS / 4
# Places of the four in a patch, row by row.
NODES = (8, 12, 36, 40)
# Patches of a quilt, and pixels along its side.
NINE, QUILT_SIDE = 9, 3 * SIDE
# From the middle of a quilt along a row: the samples of its patches; its own; where radiance has to be biquadratic.
_PARTS, _SAMPLES, _CHECKS = (-9, -5, -2, 2, 5, 9), (-8, 0, 8), (-4, 4)
# The geometry of what stands for a patch or quilt, and the polynomial through that of what it stands for, differ by
# less than this (radians) where the surface is smooth: creases, edges and noisy normals are not.
_SMOOTH = 5e-4


def _projection() -> Tensor:
    """Bilinear part of a patch at its four nodes, [4, 49]."""
    steps = torch.arange(SIDE, dtype=torch.float64) - SIDE // 2
    down, across = (grid.flatten() / 2 for grid in torch.meshgrid(steps, steps, indexing="ij"))
    bilinear = torch.stack([torch.ones_like(down), down, across, down * across])
    # The nodes' own columns of these four functions are orthogonal, as all 49 are.
    return bilinear[:, list(NODES)].T @ bilinear / PIXELS


def _biquadratic(at: tuple[int, ...], to: tuple[int, ...]) -> Tensor:
    """Values at `to` of the biquadratic that meets values at `at` best; both are rows and columns, [to², at²]."""
    here, there = (torch.tensor(x, dtype=torch.float64)[:, None] ** torch.arange(3.0).double() for x in (at, to))
    along = there @ torch.linalg.pinv(here)
    return torch.kron(along, along)


def _shares() -> Tensor:
    """Pixels that each of a quilt's samples stands for [9]."""
    outer = (QUILT_SIDE**2 - 1) / 12 / (2 * _SAMPLES[-1] ** 2)
    along = QUILT_SIDE * torch.tensor([outer, 1 - 2 * outer, outer], dtype=torch.float64)
    return torch.kron(along, along)


PROJECTION = _projection()
# From the 36 samples of a quilt's patches to its nine, and back.
SEW, UNPICK = _biquadratic(_PARTS, _SAMPLES), _biquadratic(_SAMPLES, _PARTS)
PATCH = Tier(torch.full((4,), SHARE, dtype=torch.float64), torch.full((1, 4), 0.25, dtype=torch.float64))
QUILT = Tier(_shares(), _biquadratic(_SAMPLES, _CHECKS))


@dataclass(frozen=True)
class Layout:
    """Pixels, as indices into a surface's N.

    Attributes:
        patches: of the smooth patches, row by row [49, M]; those of the quilts first, nine by nine.
        quilts: of what stands for the quilts, and where they are checked [9 + 4, Q].
        loose: of no patch.
    """

    patches: np.ndarray
    quilts: np.ndarray
    loose: np.ndarray


def lay_out(scene: Scene, blocks: np.ndarray) -> Layout:
    """Patches and quilts of the scene's surface; both kinds ordered by block [N]."""
    surface = scene.surface
    width = surface.shape[1]
    index = np.full(surface.shape[0] * width, -1)
    index[surface.pixels] = np.arange(len(surface))

    # Known by the pixel in the middle.
    middles = _middles(surface.shape, SIDE)
    pixels = index[middles + _around(range(-3, 4), width)]
    smooth = (pixels >= 0).all(axis=0)
    smooth[smooth] = _smooth(scene, pixels[:, smooth], PROJECTION, NODES)
    is_patch = np.zeros(len(index), dtype=bool)
    is_patch[middles[smooth]] = True

    nine = _around((-SIDE, 0, SIDE), width)
    quilts = _middles(surface.shape, QUILT_SIDE)
    quilts = quilts[is_patch[quilts + nine].all(axis=0)]
    parts = index[quilts + _around(_PARTS, width)]
    quilts = quilts[_smooth(scene, parts, UNPICK @ SEW, range(len(parts)))]

    quilts = quilts[np.argsort(blocks[index[quilts]], kind="stable")]
    sewn = (quilts + nine).T.ravel()
    is_patch[sewn] = False
    single = np.flatnonzero(is_patch)
    single = single[np.argsort(blocks[index[single]], kind="stable")]
    patches = index[np.concatenate([sewn, single]) + _around(range(-3, 4), width)]
    loose = np.ones(len(surface), dtype=bool)
    loose[patches] = False
    places = np.concatenate([_around(_SAMPLES, width), _around(_CHECKS, width)])
    return Layout(patches, index[quilts + places], np.flatnonzero(loose))


def nothing_laid_out(pixels: int) -> Layout:
    """Every pixel of a surface loose."""
    none = np.empty((0, 0), dtype=np.int64)
    return Layout(none.reshape(PIXELS, 0), none.reshape(QUILT.size, 0), np.arange(pixels))


def by_rows(values: Tensor) -> Tensor:
    """Samples [4, 9 q, C] of the patches of q quilts, row by row of each quilt [36, q, C]."""
    # Rows and columns of samples in a patch, quilts, rows and columns of patches in each.
    parted = values.reshape(2, 2, -1, 3, 3, values.shape[-1])
    return parted.permute(3, 0, 4, 1, 2, 5).reshape(4 * NINE, -1, values.shape[-1])


def _middles(shape: tuple[int, int], side: int) -> np.ndarray:
    """Pixels in the middle of the squares that an image divides into, counted row by row."""
    rows, columns = (side * np.arange(size // side) + side // 2 for size in shape)
    return (rows[:, None] * shape[1] + columns).ravel()


def _around(steps: Iterable[int], width: int) -> np.ndarray:
    """Pixels so many rows and columns from one, row by row [steps², 1]."""
    along = np.array(list(steps))
    return (along[:, None] * width + along).reshape(-1, 1)


def _smooth(scene: Scene, pixels: np.ndarray, polynomial: Tensor, at: Iterable[int]) -> np.ndarray:
    """Where geometry is a polynomial.

    Args:
        scene: the surface, its lights and sky.
        pixels: of squares [n, m].
        polynomial: the values that the polynomial through n has at some of them [k, n].
        at: which these are.
    """
    surface = scene.surface
    features = [surface.normals_as(torch.float32).detach()]
    if len(surface.view) > 1:
        features.append(surface.view.float())
    near = [light for lights in scene.lights for light in lights if light.near]
    if near and surface.positions is not None:
        closest = min(float(light.distance(surface.positions).min()) for light in near)
        features.append((surface.positions.detach() / closest).float())
    if scene.unoccluded is not None:
        features.append(torch.from_numpy(scene.unoccluded).float()[:, None])
    smooth = np.ones(pixels.shape[1], dtype=bool)
    columns, own = torch.from_numpy(pixels), list(at)
    for feature in features:
        values = feature[columns]
        expected = (polynomial.float() @ values.flatten(1)).reshape(len(own), *values.shape[1:])
        smooth &= ((expected - values[own]).abs().amax((0, 2)) < _SMOOTH).numpy()
    return smooth
