"""The samples of a capture with smooth patches of neighbouring pixels merged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
import torch
from torch import Tensor

from matest.photographs.samples import BLOCKS, Samples
from matest.photographs.squares import (
    NINE,
    NODES,
    PATCH,
    PIXELS,
    PROJECTION,
    QUILT,
    QUILT_SIDE,
    SEW,
    SHARE,
    UNPICK,
    Layout,
    by_rows,
    lay_out,
    nothing_laid_out,
)
from matest.samples.batch import TRUSTED, Batch, Merged, Readout, Tier

# Surfaces of fewer pixels are not worth it.
_WORTH = 1 << 15
# Patches that are worked on at once; a tile has about this many samples.
_CHUNK, _TILE = 4096, 98_304


@dataclass(frozen=True)
class _Tile:
    """Patches of one image.

    Attributes:
        position: of the image.
        patches, quilts: as in `Layout`.
        values: radiance of the patches at their nodes [4, m, C].
        scatter: mean square of what their pixels deviate from that [m, C].
    """

    position: int
    patches: np.ndarray
    quilts: np.ndarray
    values: Tensor
    scatter: Tensor


class Patches:
    """The samples of a capture, as few for every smooth stretch of pixels as carry what all of them say.

    A patch is merged where all its pixels are usable, none is clipped or nearly so, and none is far from the bilinear
    part of the patch: what the likelihood treats pixel by pixel stays single. A quilt is where all its patches are.

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
    def layout(self) -> Layout:
        """Where patches can be."""
        scene = self.samples.photographs.scene
        if not self._merge or len(scene.surface) < _WORTH:
            return nothing_laid_out(len(scene.surface))
        return lay_out(scene, self.samples.blocks)

    def parts(self, position: int) -> int:
        """Number of tiles of the image at `position`."""
        patches, quilts = self.layout.patches.shape[1], self.layout.quilts.shape[1]
        merged = quilts * (QUILT_SIDE**2 - QUILT.size) + (patches - NINE * quilts) * (PIXELS - PATCH.size)
        return max(1, round((self.samples.counts[position] - merged) / _TILE))

    def batch(self, position: int, part: int) -> Batch:
        """One of the tiles of an image: what stands for quilts, then for patches, then single pixels."""
        layout, image, parts = self.layout, self.samples.images[position], self.parts(position)
        sewn = NINE * layout.quilts.shape[1]
        own = _stretch(layout.quilts.shape[1], part, parts)
        quilts, loose = layout.quilts[:, own], layout.loose[_stretch(len(layout.loose), part, parts)]
        patches = layout.patches
        if parts > 1:
            others = patches[:, sewn:][:, _stretch(patches.shape[1] - sewn, part, parts)]
            patches = np.concatenate([patches[:, NINE * own.start : NINE * own.stop], others], axis=1)
        usable = self.samples.usable(position)
        values, scatter, clean = self._projected(image, patches)
        clean &= np.all(usable[patches], axis=0)
        whole = np.all(clean[: NINE * quilts.shape[1]].reshape(-1, NINE), axis=1)
        alone = clean.copy()
        alone[: NINE * quilts.shape[1]][np.repeat(whole, NINE)] = False
        single = np.concatenate([patches[:, ~clean].ravel(), loose])
        tile = _Tile(position, patches, quilts, values, scatter)
        return self._batch(tile, np.flatnonzero(whole), np.flatnonzero(alone), single[usable[single]])

    def _projected(self, image: int, patches: np.ndarray) -> tuple[Tensor, Tensor, np.ndarray]:
        """Values and scatter of patches [49, m] as in `_Tile`, and which to merge [m]."""
        photographs, projection = self.samples.photographs, PROJECTION.float()
        nodes, largest, scatter = [], [], []
        for start in range(0, patches.shape[1], _CHUNK):
            pixels = patches[:, start : start + _CHUNK].ravel()
            values = torch.from_numpy(photographs.radiance(image, pixels)).reshape(PIXELS, -1)
            bilinear = projection @ values
            # In place: memory is what limits this.
            squares = values.addmm_(projection.T, bilinear, alpha=-SHARE).square_()
            nodes.append(bilinear)
            largest.append(squares.amax(0))
            scatter.append(squares.mean(0))
        if not nodes:
            none = torch.zeros(0, photographs.channels)
            return none.expand(len(NODES), -1, -1), none, np.zeros(0, dtype=bool)
        shape = (patches.shape[1], photographs.channels)
        every = torch.cat(nodes, dim=1).unflatten(1, shape)
        clean = self._clean(image, patches[PIXELS // 2], every, torch.cat(largest).reshape(shape).sqrt())
        return every, torch.cat(scatter).reshape(shape), clean.numpy()

    def _clean(self, image: int, middles: np.ndarray, values: Tensor, largest: Tensor) -> Tensor:
        """Patches whose pixels are all near the bilinear part and far from the ends of the sensor's range."""
        readout, limits = self.samples.readout(image, middles), self.samples.limits(image, middles)
        variance = Readout(*(part.cpu() for part in readout)).variance(values.mean(0))
        far = TRUSTED * self._misfit * variance.sqrt()
        clean = largest <= far
        if limits is not None:
            clean &= (values.amin(0) - far >= limits.lower.cpu()) & (values.amax(0) + far <= limits.upper.cpu())
        return clean.all(dim=-1)

    def _batch(self, tile: _Tile, quilts: np.ndarray, patches: np.ndarray, single: np.ndarray) -> Batch:
        """Some quilts and patches of a tile, and single pixels of its image, in one batch."""
        samples, position = self.samples, tile.position
        image, blocks = samples.images[position], samples.blocks
        patches = patches[np.argsort(blocks[tile.patches[PIXELS // 2, patches]], kind="stable")]
        single = single[np.argsort(blocks[single], kind="stable")]
        if not len(quilts) and not len(patches):
            return replace(samples.at(image, single), runs=tuple(_runs(position, blocks[single], 1)))
        like, clipped = samples.radiance(image, single), samples.clipped(image, single)
        pixels, radiance, scatter, copies, runs, tiers = [], [], [], [], [], []
        for tier, own, values, spread in (
            (QUILT, tile.quilts[:, quilts], *_sewn(tile, quilts)),
            (
                PATCH,
                tile.patches[[*NODES, PIXELS // 2]][:, patches],
                tile.values[:, patches],
                tile.scatter[patches].expand(len(NODES), -1, -1),
            ),
        ):
            count, nodes = own.shape[1], len(tier.shares)
            if not count:
                continue
            checks = tier.checks.to(values) @ values.flatten(1)
            pixels += [own[:nodes].T.ravel(), own[nodes:].T.ravel()]
            radiance += [_by_square(values), _by_square(checks.reshape(-1, *values.shape[1:]))]
            scatter += [_by_square(spread), spread.new_zeros(len(checks) * count, like.shape[1])]
            copies += [tier.shares.to(values).repeat(count), values.new_zeros(len(checks) * count)]
            runs += _runs(position, blocks[own[nodes // 2]], nodes)
            runs.append((runs[-1][0], len(checks) * count))
            tiers.append((tier, count))
        index = np.concatenate([*pixels, single])
        merged = sum(len(part) for part in pixels)
        return Batch(
            points=samples.points(image, index),
            radiance=torch.cat([*(part.to(like) for part in radiance), like]),
            readout=samples.readout(image, index),
            limits=samples.limits(image, index),
            clipped=None if clipped is None else torch.cat([clipped.new_zeros(merged, like.shape[1]), clipped]),
            copies=torch.cat([*(part.to(like) for part in copies), like.new_ones(len(single))])[:, None],
            scatter=torch.cat([*(part.to(like) for part in scatter), torch.zeros_like(like)]),
            runs=(*runs, *_runs(position, blocks[single], 1)),
            merged=Merged(tuple(tiers), partial(self._finer, tile, quilts, patches)),
        )

    def _finer(self, tile: _Tile, quilts: np.ndarray, patches: np.ndarray, bent: Mapping[Tier, np.ndarray]) -> Batch:
        """The patches of bent quilts and the pixels of bent patches."""
        bent_quilts, bent_patches = (
            own[bent[tier]] if tier in bent else own[:0] for tier, own in ((QUILT, quilts), (PATCH, patches))
        )
        parts = (NINE * bent_quilts[:, None] + np.arange(NINE)).ravel()
        return self._batch(tile, quilts[:0], parts, tile.patches[:, bent_patches].ravel())


def _sewn(tile: _Tile, quilts: np.ndarray) -> tuple[Tensor, Tensor]:
    """Radiance of quilts at their samples, and the mean square of what the pixels that these stand for deviate from it.

    Both [9, q, C]. Each of the nine takes the deviations of the patch that it lies in.
    """
    parts = (NINE * quilts[:, None] + np.arange(NINE)).ravel()
    values = by_rows(tile.values[:, parts])
    sewn = SEW.to(values) @ values.flatten(1)
    off = (values.flatten(1) - UNPICK.to(values) @ sewn).square()
    between = off.reshape(3, 2, 3, 2, *values.shape[1:]).sum((1, 3)).reshape(NINE, *values.shape[1:])
    within = tile.scatter[parts].unflatten(0, (-1, NINE)).transpose(0, 1)
    share = QUILT.shares.to(values)[:, None, None]
    return sewn.reshape(between.shape), (PIXELS * within + SHARE * between) / share


def _by_square(values: Tensor) -> Tensor:
    """Values [k, n, C] of n squares, one square after another [n k, C]."""
    return values.transpose(0, 1).flatten(0, 1)


def _stretch(length: int, part: int, parts: int) -> slice:
    """One of so many stretches of about the same length."""
    return slice(part * length // parts, (part + 1) * length // parts)


def _runs(position: int, blocks: np.ndarray, times: int) -> list[tuple[int, int]]:
    """Label and number of samples of each stretch of one block."""
    found, lengths = np.unique(blocks, return_counts=True)
    return [(position * BLOCKS + int(b), times * int(n)) for b, n in zip(found, lengths, strict=True)]
