"""The samples of a capture with smooth patches of neighbouring pixels merged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
import torch
from torch import Tensor

from matest.photographs.pixels import LitPixels
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
from matest.samples import Batch, Tile
from matest.samples.likelihood import TRUSTED, Means, MeasurementNoise, Readout
from matest.samples.merging import Merged, Tier

# Surfaces of fewer pixels are not worth it.
_WORTH = 1 << 15
# Patches that are worked on at once; a tile has about this many samples.
_CHUNK, _TILE = 4096, 98_304


@dataclass(frozen=True)
class _Squares:
    """Patches of a part of one image.

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
        pixels: that the samples are of.
        residual_scale: see `likelihood.about`.
        merge: False leaves every pixel single.
    """

    def __init__(self, pixels: LitPixels, residual_scale: float = 1.0, *, merge: bool = True) -> None:
        self.pixels = pixels
        self._residual_scale = residual_scale
        self._merge = merge

    @cached_property
    def layout(self) -> Layout:
        """Where patches can be."""
        scene = self.pixels.photographs.scene
        if not self._merge or len(scene.surface) < _WORTH:
            return nothing_laid_out(len(scene.surface))
        return lay_out(scene, self.pixels.blocks)

    def parts(self, position: int) -> int:
        """Number of tiles of the image at `position`."""
        patches, quilts = self.layout.patches.shape[1], self.layout.quilts.shape[1]
        merged = quilts * (QUILT_SIDE**2 - QUILT.size) + (patches - NINE * quilts) * (PIXELS - PATCH.size)
        return max(1, round((self.pixels.counts[position] - merged) / _TILE))

    def tile(self, position: int, part: int) -> Tile:
        """One of the tiles of an image: what stands for quilts, then for patches, then single pixels."""
        layout, parts = self.layout, self.parts(position)
        sewn = NINE * layout.quilts.shape[1]
        stretch = _stretch(layout.quilts.shape[1], part, parts)
        quilts, loose = layout.quilts[:, stretch], layout.loose[_stretch(len(layout.loose), part, parts)]
        patches = layout.patches
        if parts > 1:
            others = patches[:, sewn:][:, _stretch(patches.shape[1] - sewn, part, parts)]
            patches = np.concatenate([patches[:, NINE * stretch.start : NINE * stretch.stop], others], axis=1)
        usable = self.pixels.usable(position)
        values, scatter, clean = self._projected(self.pixels.images[position], patches)
        clean &= np.all(usable[patches], axis=0)
        whole = np.all(clean[: NINE * quilts.shape[1]].reshape(-1, NINE), axis=1)
        alone = clean.copy()
        alone[: NINE * quilts.shape[1]][np.repeat(whole, NINE)] = False
        single = np.concatenate([patches[:, ~clean].ravel(), loose])
        squares = _Squares(position, patches, quilts, values, scatter)
        return self._tile(squares, np.flatnonzero(whole), np.flatnonzero(alone), single[usable[single]])

    def _projected(self, image: int, patches: np.ndarray) -> tuple[Tensor, Tensor, np.ndarray]:
        """Values and scatter of patches [49, m] as in `_Tile`, and which to merge [m]."""
        photographs, projection = self.pixels.photographs, PROJECTION.float()
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
        readout, limits = self.pixels.readout(image, middles), self.pixels.limits(image, middles)
        variance = Readout(*(part.cpu() for part in readout)).variance(values.mean(0))
        far = TRUSTED * self._residual_scale * variance.sqrt()
        clean = largest <= far
        if limits is not None:
            clean &= (values.amin(0) - far >= limits.lower.cpu()) & (values.amax(0) + far <= limits.upper.cpu())
        return clean.all(dim=-1)

    def _tile(self, squares: _Squares, quilts: np.ndarray, patches: np.ndarray, single: np.ndarray) -> Tile:
        """Some quilts and patches of a part of an image, and single pixels of it, in one tile."""
        pixels, position = self.pixels, squares.position
        image, blocks = pixels.images[position], pixels.blocks
        patches = patches[np.argsort(blocks[squares.patches[PIXELS // 2, patches]], kind="stable")]
        single = single[np.argsort(blocks[single], kind="stable")]
        if not len(quilts) and not len(patches):
            return Tile(pixels.at(position, single))
        like, clipped = pixels.radiance(image, single), pixels.clipped(image, single)
        places, radiance, scatter, shares, labels, tiers = [], [], [], [], [], []
        for tier, of_square, values, spread in (
            (QUILT, squares.quilts[:, quilts], *_sewn(squares, quilts)),
            (
                PATCH,
                squares.patches[[*NODES, PIXELS // 2]][:, patches],
                squares.values[:, patches],
                squares.scatter[patches].expand(len(NODES), -1, -1),
            ),
        ):
            count, nodes = of_square.shape[1], len(tier.shares)
            if not count:
                continue
            checks = tier.checks.to(values) @ values.flatten(1)
            places += [of_square[:nodes].T.ravel(), of_square[nodes:].T.ravel()]
            radiance += [_by_square(values), _by_square(checks.reshape(-1, *values.shape[1:]))]
            scatter += [_by_square(spread), spread.new_zeros(len(checks) * count, like.shape[1])]
            shares += [tier.shares.to(values).repeat(count), values.new_zeros(len(checks) * count)]
            of_block = pixels.labels(position, of_square[nodes // 2])
            # Checks add nothing to any sum: with the last label they make no group more.
            labels += [of_block.repeat_interleave(nodes), of_block[-1:].expand(len(checks) * count)]
            tiers.append((tier, count))
        index = np.concatenate([*places, single])
        merged = sum(len(part) for part in places)
        if clipped is not None:
            clipped = torch.cat([clipped.new_zeros(merged, like.shape[1]), clipped])
        batch = Batch(
            points=pixels.points(image, index),
            radiance=torch.cat([*(part.to(like) for part in radiance), like]),
            noise=MeasurementNoise(pixels.readout(image, index), pixels.limits(image, index), clipped),
            groups=torch.cat([*labels, pixels.labels(position, single)]),
        )
        means = Means(
            pixels=torch.cat([*(part.to(like) for part in shares), like.new_ones(len(single))])[:, None],
            scatter=torch.cat([*(part.to(like) for part in scatter), torch.zeros_like(like)]),
        )
        return Tile(batch, means, Merged(tuple(tiers), partial(self._finer, squares, quilts, patches)))

    def _finer(
        self, squares: _Squares, quilts: np.ndarray, patches: np.ndarray, bent: Mapping[Tier, np.ndarray]
    ) -> Tile:
        """The patches of bent quilts and the pixels of bent patches."""
        bent_quilts, bent_patches = (
            own[bent[tier]] if tier in bent else own[:0] for tier, own in ((QUILT, quilts), (PATCH, patches))
        )
        parts = (NINE * bent_quilts[:, None] + np.arange(NINE)).ravel()
        return self._tile(squares, quilts[:0], parts, squares.patches[:, bent_patches].ravel())


def _sewn(squares: _Squares, quilts: np.ndarray) -> tuple[Tensor, Tensor]:
    """Radiance of quilts at their samples, and the mean square of what the pixels that these stand for deviate from it.

    Both [9, q, C]. Each of the nine takes the deviations of the patch that it lies in.
    """
    parts = (NINE * quilts[:, None] + np.arange(NINE)).ravel()
    values = by_rows(squares.values[:, parts])
    sewn = SEW.to(values) @ values.flatten(1)
    off = (values.flatten(1) - UNPICK.to(values) @ sewn).square()
    between = off.reshape(3, 2, 3, 2, *values.shape[1:]).sum((1, 3)).reshape(NINE, *values.shape[1:])
    within = squares.scatter[parts].unflatten(0, (-1, NINE)).transpose(0, 1)
    share = QUILT.shares.to(values)[:, None, None]
    return sewn.reshape(between.shape), (PIXELS * within + SHARE * between) / share


def _by_square(values: Tensor) -> Tensor:
    """Values [k, n, C] of n squares, one square after another [n k, C]."""
    return values.transpose(0, 1).flatten(0, 1)


def _stretch(length: int, part: int, parts: int) -> slice:
    """One of so many stretches of about the same length."""
    return slice(part * length // parts, (part + 1) * length // parts)
