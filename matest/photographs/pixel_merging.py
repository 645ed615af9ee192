"""Tiles of samples in which a few samples replace the pixels of every smooth square."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from torch import Tensor

from matest.photographs.pixels import LitPixels
from matest.photographs.smooth_squares import (
    LARGE,
    LARGE_SIDE,
    LARGE_TO_SMALL,
    PIXELS_TO_SMALL,
    SMALL,
    SMALL_NODES,
    SMALL_PER_LARGE,
    SMALL_PIXELS,
    SMALL_SHARE,
    SMALL_TO_LARGE,
    SmoothSquares,
    no_squares,
    rows_of_large,
)
from matest.samples import Batch, Tile
from matest.samples.likelihood import TRUSTED, Means, MeasurementNoise, Readout
from matest.samples.merging import MergedSquares, Tier
from matest.samples.residual_scale import NOISE_ALONE, ResidualScale

# Small squares that are projected at once: their RGB values take 10 MB.
_SQUARES_AT_ONCE = 1 << 14
# Samples of a tile, about: so many that its overhead does not count, so few that all workers have tiles.
_TILE_SAMPLES = 98_304


@dataclass(frozen=True)
class _MeasuredSquares:
    """Squares of a part of one image, with their radiance; each channel is an array of its own.

    Attributes:
        position: of the image.
        small, large: as in `SmoothSquares`.
        values: radiance at the samples of the small squares [4, C, m].
        scatter: mean square deviation of their pixels from the bilinear function [C, m].
    """

    position: int
    small: np.ndarray
    large: np.ndarray
    values: Tensor
    scatter: Tensor

    def small_inside(self, large: np.ndarray) -> np.ndarray:
        """Indices of the small squares inside q large ones, place by place [9 q]."""
        return (np.arange(SMALL_PER_LARGE)[:, None] * self.large.shape[1] + large).ravel()

    def large_values(self, large: np.ndarray) -> tuple[Tensor, Tensor]:
        """Radiance at the samples of some large squares, and the mean square deviation of the pixels from it.

        Both [9, C, q]. Each of the nine samples takes the deviations of the small square that it lies in.
        """
        small = torch.from_numpy(self.small_inside(large))
        values = rows_of_large(self.values.index_select(2, small))
        merged = SMALL_TO_LARGE.to(values) @ values.flatten(1)
        squared = (values.flatten(1) - LARGE_TO_SMALL.to(values) @ merged).square()
        between = squared.reshape(3, 2, 3, 2, *values.shape[1:]).sum((1, 3))
        between = between.reshape(SMALL_PER_LARGE, *values.shape[1:])
        within = self.scatter.index_select(1, small).unflatten(1, (SMALL_PER_LARGE, -1)).transpose(0, 1)
        share = LARGE.shares.to(values)[:, None, None]
        return merged.reshape(between.shape), (SMALL_PIXELS * within + SMALL_SHARE * between) / share


@dataclass(frozen=True)
class _TierSamples:
    """The samples and checks of all squares of one size in a tile.

    Attributes:
        tier: the size.
        pixels: of the samples and then the checks of each square [k, n].
        values: radiance at the samples [s, C, n].
        scatter: mean square deviation of their pixels from it [s, C, n].
    """

    tier: Tier
    pixels: np.ndarray
    values: Tensor
    scatter: Tensor

    @property
    def count(self) -> int:
        """Number of squares."""
        return self.pixels.shape[1]

    @property
    def nodes(self) -> int:
        """Samples of a square."""
        return len(self.tier.shares)

    @property
    def order(self) -> np.ndarray:
        """Pixels of all samples, square by square, and then those of all checks."""
        return np.concatenate([self.pixels[: self.nodes].T.ravel(), self.pixels[self.nodes :].T.ravel()])

    def radiance(self) -> list[Tensor]:
        """At the samples as measured, at the checks as the polynomial says, each [C, ...]."""
        checks = self.tier.checks.to(self.values) @ self.values.flatten(1)
        return [_by_square(self.values), _by_square(checks.unflatten(1, self.values.shape[1:]))]

    def pixel_counts(self) -> list[Tensor]:
        """Pixels that each sample replaces; a check replaces none."""
        shares = self.tier.shares.to(self.values).repeat(self.count)
        return [shares, shares.new_zeros(len(self.tier.checks) * self.count)]

    def scatters(self) -> list[Tensor]:
        """Scatter of the pixels of each sample [C, ...]; 0 at checks."""
        channels, checks = self.scatter.shape[1], len(self.tier.checks) * self.count
        return [_by_square(self.scatter), self.scatter.new_zeros(channels, checks)]

    def labels(self, of_square: Tensor) -> Tensor:
        """Group of every sample and check, from those of the squares [n]."""
        # Checks add nothing to any sum: the label of the last square makes no further group.
        checks = of_square[-1:].expand(len(self.tier.checks) * self.count)
        return torch.cat([of_square.repeat_interleave(self.nodes), checks])


class PixelMerger:
    """Makes tiles of the pixels of photographs, with smooth squares merged into a few samples each.

    A small square is merged where all its pixels are usable, none is clipped or nearly so, and none is an outlier from
    the bilinear function: the likelihood treats those pixel by pixel. A large square is merged where all its small
    squares are.

    Args:
        pixels: of the photographs.
        residual_scale: by which outliers are judged.
        merge: False leaves every pixel single.
    """

    def __init__(self, pixels: LitPixels, residual_scale: ResidualScale = NOISE_ALONE, *, merge: bool = True) -> None:
        self.pixels = pixels
        self._residual_scale = residual_scale
        self._merge = merge

    @property
    def squares(self) -> SmoothSquares:
        """The smooth squares of the surface whose pixels may be merged."""
        return self.pixels.squares if self._merge else no_squares(len(self.pixels.photographs.scene.surface))

    def parts(self, position: int) -> int:
        """Number of tiles of the image at `position`."""
        small, large = self.squares.small.shape[1], self.squares.large.shape[1]
        saved_by_large = large * (LARGE_SIDE**2 - LARGE.size)
        saved_by_small = (small - SMALL_PER_LARGE * large) * (SMALL_PIXELS - SMALL.size)
        samples = (self.pixels.counts[position] - (saved_by_large + saved_by_small)) * self.pixels.crowd
        return max(1, round(samples / _TILE_SAMPLES))

    def tile(self, position: int, part: int) -> Tile:
        """One of the tiles of an image: samples of large squares, then of small squares, then single pixels."""
        small, large, single = self._part(part, self.parts(position))
        usable = self.pixels.usable(position)
        values, scatter, mergeable = self._projected(self.pixels.images[position], small)
        mergeable &= np.all(usable[small], axis=0)
        inside = SMALL_PER_LARGE * large.shape[1]
        large_mergeable = np.all(mergeable[:inside].reshape(SMALL_PER_LARGE, -1), axis=0)
        small_mergeable = mergeable.copy()
        small_mergeable[:inside].reshape(SMALL_PER_LARGE, -1)[:, large_mergeable] = False
        single = np.concatenate([small[:, ~mergeable].ravel(), single])
        squares = _MeasuredSquares(position, small, large, values, scatter)
        return self._tile(
            squares, np.flatnonzero(large_mergeable), np.flatnonzero(small_mergeable), single[usable[single]]
        )

    def _part(self, part: int, parts: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Small and large squares and single pixels, as in `SmoothSquares`, of one of `parts` parts of the surface."""
        small, large, single = self.squares.small, self.squares.large, self.squares.single
        inside, large_slice = SMALL_PER_LARGE * large.shape[1], _slice(large.shape[1], part, parts)
        if parts > 1:
            in_large = small[:, :inside].reshape(SMALL_PIXELS, SMALL_PER_LARGE, -1)[:, :, large_slice]
            in_large = in_large.reshape(SMALL_PIXELS, -1)
            others = small[:, inside:][:, _slice(small.shape[1] - inside, part, parts)]
            small = np.concatenate([in_large, others], axis=1)
        return small, large[:, large_slice], single[_slice(len(single), part, parts)]

    def _projected(self, image: int, small: np.ndarray) -> tuple[Tensor, Tensor, np.ndarray]:
        """Values and scatter of small squares [49, m] as in `_MeasuredSquares`, and which to merge [m]."""
        photographs, projection = self.pixels.photographs, PIXELS_TO_SMALL.float()
        nodes, largest, scatter = [], [], []
        for start in range(0, small.shape[1], _SQUARES_AT_ONCE):
            pixels = small[:, start : start + _SQUARES_AT_ONCE].ravel()
            values = torch.from_numpy(photographs.radiance(image, pixels)).reshape(SMALL_PIXELS, -1)
            bilinear = projection @ values
            # In place, because memory limits the size of a capture here.
            squared = values.addmm_(projection.T, bilinear, alpha=-SMALL_SHARE).square_()
            nodes.append(bilinear)
            largest.append(squared.amax(0))
            scatter.append(squared.mean(0))
        if not nodes:
            none = torch.zeros(photographs.channels, 0)
            return none.expand(len(SMALL_NODES), -1, -1), none, np.zeros(0, dtype=bool)
        at_nodes, largest_square, mean_square = (
            _by_channel(torch.cat(parts, dim=-1), photographs.channels) for parts in (nodes, largest, scatter)
        )
        mergeable = self._mergeable(image, small[SMALL_PIXELS // 2], at_nodes, largest_square.sqrt())
        return at_nodes, mean_square, mergeable.numpy()

    def _mergeable(self, image: int, centres: np.ndarray, values: Tensor, deviation: Tensor) -> Tensor:
        """Small squares with no outlier from the bilinear function, and far from the ends of the sensor's range [m]."""
        readout, limits = self.pixels.readout(image, centres), self.pixels.limits(image, centres)
        variance = Readout(*(part.cpu() for part in readout)).variance(values.mean(0).T).T
        allowed = TRUSTED * self._residual_scale.smallest * variance.sqrt()
        mergeable = deviation <= allowed
        if limits is not None:
            mergeable &= values.amin(0) - allowed >= limits.lower.cpu().T
            mergeable &= values.amax(0) + allowed <= limits.upper.cpu().T
        return mergeable.all(dim=0)

    def _tile(self, squares: _MeasuredSquares, large: np.ndarray, small: np.ndarray, single: np.ndarray) -> Tile:
        """Some large and small squares of a part of an image, and single pixels of it, in one tile."""
        pixels, position = self.pixels, squares.position
        image, blocks = pixels.images[position], pixels.blocks
        small = small[np.argsort(blocks[squares.small[SMALL_PIXELS // 2, small]], kind="stable")]
        single = single[np.argsort(blocks[single], kind="stable")]
        if not len(large) and not len(small):
            return Tile(pixels.at(position, single))
        both_tiers = (
            _TierSamples(LARGE, squares.large[:, large], *squares.large_values(large)),
            _TierSamples(
                SMALL,
                squares.small[[*SMALL_NODES, SMALL_PIXELS // 2]][:, small],
                squares.values[..., small],
                squares.scatter[:, small].expand(len(SMALL_NODES), -1, -1),
            ),
        )
        tiers = [tier for tier in both_tiers if tier.count]
        radiance, clipped = pixels.radiance(image, single), pixels.clipped(image, single)
        index = np.concatenate([*(tier.order for tier in tiers), single])
        if clipped is not None:
            clipped = torch.cat([clipped.new_zeros(len(index) - len(single), radiance.shape[1]), clipped])
        labels = [tier.labels(pixels.labels(position, tier.pixels[tier.nodes // 2])) for tier in tiers]
        batch = Batch(
            points=pixels.points(image, index),
            radiance=_joined([part for tier in tiers for part in tier.radiance()], radiance),
            noise=MeasurementNoise(pixels.readout(image, index), pixels.limits(image, index), clipped),
            pixels=torch.from_numpy(index.astype(np.int64)),
            groups=torch.cat([*labels, pixels.labels(position, single)]),
        )
        counts = [part.to(radiance) for tier in tiers for part in tier.pixel_counts()]
        means = Means(
            torch.cat([*counts, radiance.new_ones(len(single))])[:, None],
            _joined([part for tier in tiers for part in tier.scatters()], torch.zeros_like(radiance)),
        )
        merged = MergedSquares(
            tuple((tier.tier, tier.count) for tier in tiers), partial(self._split, squares, large, small)
        )
        return Tile(batch, means, merged)

    def _split(
        self, squares: _MeasuredSquares, large: np.ndarray, small: np.ndarray, selection: Mapping[Tier, np.ndarray]
    ) -> Tile:
        """The small squares of the selected large ones, and the pixels of the selected small ones."""
        split_large, split_small = (
            index[selection[tier]] if tier in selection else index[:0]
            for tier, index in ((LARGE, large), (SMALL, small))
        )
        return self._tile(squares, large[:0], squares.small_inside(split_large), squares.small[:, split_small].ravel())


def _by_channel(values: Tensor, channels: int) -> Tensor:
    """From values [..., m C], the channels of a square after each other, to [..., C, m]."""
    # NumPy transposes rows of three numbers several times faster than torch.
    return torch.from_numpy(np.ascontiguousarray(values.unflatten(-1, (-1, channels)).mT.numpy()))


def _by_square(values: Tensor) -> Tensor:
    """From values [k, C, n] of n squares to those of one square after another [C, n k]."""
    return values.permute(1, 2, 0).flatten(1)


def _joined(merged: list[Tensor], single: Tensor) -> Tensor:
    """Values [n, C] of merged samples [C, ...], then of single pixels [..., C]; each channel is an array of its own."""
    return torch.cat([*(part.to(single) for part in merged), single.T], dim=1).T


def _slice(length: int, part: int, parts: int) -> slice:
    """The slice of `range(length)` that is one of `parts` nearly equal parts."""
    return slice(part * length // parts, (part + 1) * length // parts)
