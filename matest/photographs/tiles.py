"""The samples of photographs tile by tile."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

from matest.photographs.pixel_merging import PixelMerger
from matest.photographs.pixels import LitPixels
from matest.samples.batch import join
from matest.samples.residual_scale import NOISE_ALONE, ResidualScale
from matest.samples.tiles import Tile

# Images whose pixels are in memory at once: they have tiles for all workers, and memory does not grow with the images.
_IMAGES_AT_ONCE = 4
# Samples of the largest capture of two tiles: a tile of its own for each image would cost more than it holds.
_TWO_TILES = 1 << 18


@dataclass(frozen=True)
class ImageTiles:
    """Functions that make the tiles of all samples, in lists of a few images each.

    Attributes:
        pixels: of the photographs.
        residual_scale: by which outliers are judged.
        merge: whether a few samples replace the pixels of a smooth square (`PixelMerger`).
    """

    pixels: LitPixels
    residual_scale: ResidualScale = NOISE_ALONE
    merge: bool = True

    @property
    def source(self) -> LitPixels:
        """See `matest.division.Divisible`."""
        return self.pixels

    @cached_property
    def merger(self) -> PixelMerger:
        return PixelMerger(self.pixels, self.residual_scale, merge=self.merge)

    def __iter__(self) -> Iterator[list[Callable[[], Tile]]]:
        images, merger = range(len(self.pixels.images)), self.merger
        tiles = [[partial(merger.tile, k, part) for part in range(merger.parts(k))] for k in images]
        if not merger.squares.small.size and len(self.pixels) * self.pixels.crowd < _TWO_TILES:
            half = (len(images) + 1) // 2
            yield [partial(_join_tiles, some) for some in (tiles[:half], tiles[half:]) if some]
            return
        for first in range(0, len(images), _IMAGES_AT_ONCE):
            yield [tile for some in tiles[first : first + _IMAGES_AT_ONCE] for tile in some]
            for k in images[first : first + _IMAGES_AT_ONCE]:
                self.pixels.photographs.release(self.pixels.images[k])


def _join_tiles(tiles: Sequence[Sequence[Callable[[], Tile]]]) -> Tile:
    """One tile of several, without the empty ones."""
    parts = [tile().batch for some in tiles for tile in some]
    return Tile(join([part for part in parts if len(part)] or parts[:1]))
