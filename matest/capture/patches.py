"""Square patches of neighbouring pixels, each stood for by four samples that carry what all of it says.

Over 7×7 pixels of a smooth surface radiance is bilinear in row and column, to third order. Least squares then need of
the 49 values no more than their four bilinear coefficients, and these are the same four numbers that single pixels at
±2 rows and columns from the centre would have given, each with the noise of 49/4 pixels averaged: over −3…3 as over
±2, x has mean 0 and mean square 4. (For k×k pixels and ±s that takes k² = 12 s² + 1, which has no other solution in
whole numbers below k = 97.)
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from matest.capture.batch import TRUSTED, Batch, Merged
from matest.capture.samples import BLOCKS, Samples
from matest.scene import PointLight

SIDE = 7
PIXELS = SIDE * SIDE
# Pixels that each of the four stands for.
SHARE = PIXELS / 4
# Places of the four in a patch, row by row.
NODES = (8, 12, 36, 40)
# The geometry of the four, and the bilinear part of that of their patch, differ by less than this (radians) where the
# surface is smooth: creases, edges and noisy normals are not.
_SMOOTH = 5e-4
# Surfaces of fewer pixels are not worth it.
_WORTH = 1 << 15
# Patches that are worked on at once fit the processor's cache; a tile has about this many samples.
_CHUNK, _TILE = 1024, 98_304


def _projection() -> Tensor:
    """Bilinear part of a patch at its four nodes, [4, 49]."""
    steps = torch.arange(SIDE, dtype=torch.float64) - SIDE // 2
    down, across = (grid.flatten() / 2 for grid in torch.meshgrid(steps, steps, indexing="ij"))
    bilinear = torch.stack([torch.ones_like(down), down, across, down * across])
    # The nodes' own columns of these four functions are orthogonal, as all 49 are.
    return bilinear[:, list(NODES)].T @ bilinear / PIXELS


PROJECTION = _projection()


class Patches:
    """The samples of a capture with smooth patches of pixels merged.

    A patch is merged where all its pixels are usable, none is clipped or nearly so, and none is far from the bilinear
    part of the patch: what the likelihood treats pixel by pixel stays single.

    Args:
        samples: all of them.
        misfit: see `Batch.working`.
        merge: False leaves every pixel single.
    """

    def __init__(self, samples: Samples, misfit: float = 1.0, *, merge: bool = True) -> None:
        self.samples = samples
        self._misfit = misfit
        self._merge = merge

    @cached_property
    def pixels(self) -> np.ndarray:
        """Pixels of the smooth patches, row by row: indices into the surface [M, 49], ordered by block."""
        surface = self.samples.capture.scene.surface
        height, width = (size // SIDE for size in surface.shape)
        if not self._merge or len(surface) < _WORTH:
            return np.empty((0, PIXELS), dtype=np.int64)
        index = np.full(surface.shape, -1)
        index.flat[surface.pixels] = np.arange(len(surface))
        squares = index[: height * SIDE, : width * SIDE].reshape(height, SIDE, width, SIDE)
        cells = squares.transpose(0, 2, 1, 3).reshape(-1, PIXELS)
        cells = cells[(cells >= 0).all(axis=1)]
        cells = cells[self._smooth(cells)]
        return cells[np.argsort(self.samples.blocks[cells[:, PIXELS // 2]], kind="stable")]

    def _smooth(self, cells: np.ndarray) -> np.ndarray:
        """Which patches have a smooth surface."""
        scene = self.samples.capture.scene
        surface = scene.surface
        features = [surface.normals_as(torch.float32).detach()]
        if len(surface.view) > 1:
            features.append(surface.view.float())
        near = [light.position for lights in scene.lights for light in lights if isinstance(light, PointLight)]
        if near and surface.positions is not None:
            closest = min(float((surface.positions - position).norm(dim=-1).min()) for position in near)
            features.append((surface.positions.detach() / closest).float())
        if scene.unoccluded is not None:
            features.append(torch.from_numpy(scene.unoccluded).float()[:, None])
        smooth = np.ones(len(cells), dtype=bool)
        projection, columns = PROJECTION.float(), torch.from_numpy(np.ascontiguousarray(cells.T))
        for feature in features:
            values = feature[columns]
            bilinear = (projection @ values.flatten(1)).reshape(4, *values.shape[1:])
            smooth &= ((bilinear - values[list(NODES)]).abs().amax((0, 2)) < _SMOOTH).numpy()
        return smooth

    @cached_property
    def _owner(self) -> np.ndarray:
        """The patch that each pixel of the surface belongs to, M for none [N]."""
        owner = np.full(len(self.samples.capture.scene.surface), len(self.pixels))
        owner[self.pixels] = np.arange(len(self.pixels))[:, None]
        return owner

    @cached_property
    def _loose(self) -> np.ndarray:
        """Pixels of no patch."""
        return np.flatnonzero(self._owner == len(self.pixels))

    def _split(self, position: int) -> tuple[np.ndarray, np.ndarray]:
        """Patches whose pixels are all usable in the image at `position` [m, 49], and the other usable pixels."""
        usable = self.samples.usable(position)
        whole = np.ones(len(self.pixels) + 1, dtype=bool)
        whole[self._owner[np.flatnonzero(~usable)]] = False
        single = np.concatenate([self._loose, self.pixels[~whole[:-1]].ravel()])
        return self.pixels[whole[:-1]], single[usable[single]]

    def parts(self, position: int) -> int:
        """Number of tiles of the image at `position`."""
        return max(1, round((self.samples.counts[position] - len(self.pixels) * (PIXELS - 4)) / _TILE))

    def batch(self, position: int, part: int) -> Batch:
        """One of the tiles of an image: four samples for each patch that is merged, then the single pixels."""
        samples, parts = self.samples, self.parts(position)
        image = samples.images[position]
        patches, single = (np.array_split(chosen, parts)[part] for chosen in self._split(position))
        merged, radiance, scatter = self._merged(image, patches)
        single = np.concatenate([patches[~merged].ravel(), single])
        patches = patches[merged]
        if not patches.size:
            return self._single(position, single)
        count, centres = len(patches), patches[:, PIXELS // 2]
        blocks = samples.blocks[single]
        pixels = single[np.argsort(blocks, kind="stable")]
        index = np.concatenate([patches[:, NODES].ravel(), centres, pixels])
        like, clipped = samples.radiance(image, pixels), samples.clipped(image, pixels)
        number, channels = 5 * count, like.shape[1]
        runs = _runs(position, samples.blocks[centres], len(NODES))
        return Batch(
            points=samples.points(image, index),
            radiance=torch.cat([radiance.to(like), like.new_zeros(count, channels), like]),
            readout=samples.readout(image, index),
            limits=samples.limits(image, index),
            clipped=None if clipped is None else torch.cat([clipped.new_zeros(number, channels), clipped]),
            copies=torch.cat([
                like.new_full((len(NODES) * count, 1), SHARE), like.new_zeros(count, 1), like.new_ones(len(pixels), 1)
            ]),
            scatter=torch.cat([
                scatter.to(like).repeat_interleave(len(NODES), dim=0), like.new_zeros(count + len(pixels), channels)
            ]),
            runs=(*runs, (runs[-1][0], count), *_runs(position, blocks, 1)),
            merged=Merged(count, PIXELS, lambda some: self._single(position, patches[some.cpu().numpy()].ravel())),
        )  # fmt: skip

    def _single(self, position: int, pixels: np.ndarray) -> Batch:
        """The samples of some pixels of an image, ordered by block."""
        blocks = self.samples.blocks[pixels]
        order = np.argsort(blocks, kind="stable")
        batch = self.samples.at(self.samples.images[position], pixels[order])
        return replace(batch, runs=tuple(_runs(position, blocks, 1)))

    def _merged(self, image: int, patches: np.ndarray) -> tuple[np.ndarray, Tensor, Tensor]:
        """Which of some patches [m, 49] to merge; radiance [4 m', C] and mean square deviation [m', C] of those."""
        capture, projection = self.samples.capture, PROJECTION.float()
        nodes, largest, scatter = [], [], []
        for start in range(0, len(patches), _CHUNK):
            chunk = patches[start : start + _CHUNK].T.ravel()
            values = torch.from_numpy(capture.radiance(image, chunk)).reshape(PIXELS, -1)
            bilinear = projection @ values
            nodes.append(bilinear.reshape(len(NODES), -1, capture.channels).transpose(0, 1))
            # In place: memory is what limits this.
            deviation = values.addmm_(projection.T, bilinear, alpha=-SHARE)
            largest.append(torch.maximum(deviation.amax(0), -deviation.amin(0)).reshape(-1, capture.channels))
            scatter.append(deviation.square_().mean(0).reshape(-1, capture.channels))
        if not nodes:
            none = torch.zeros(0, capture.channels)
            return np.zeros(0, dtype=bool), none, none
        every = torch.cat(nodes)
        clean = self._clean(image, patches[:, PIXELS // 2], every, torch.cat(largest))
        return clean.numpy(), every[clean].flatten(0, 1), torch.cat(scatter)[clean]

    def _clean(self, image: int, centres: np.ndarray, nodes: Tensor, largest: Tensor) -> Tensor:
        """Patches whose pixels are all near the bilinear part and far from the ends of the sensor's range."""
        readout, limits = self.samples.readout(image, centres), self.samples.limits(image, centres)
        variance = readout.read.cpu() + readout.gain.cpu() * nodes.mean(1).clamp(min=0)
        far = TRUSTED * self._misfit * variance.sqrt()
        clean = largest <= far
        if limits is not None:
            clean &= (nodes.amin(1) - far >= limits.lower.cpu()) & (nodes.amax(1) + far <= limits.upper.cpu())
        return clean.all(dim=-1)


def _runs(position: int, blocks: np.ndarray, times: int) -> list[tuple[int, int]]:
    """Label and number of samples of each stretch of one block."""
    found, lengths = np.unique(blocks, return_counts=True)
    return [(position * BLOCKS + int(b), times * int(n)) for b, n in zip(found, lengths, strict=True)]
