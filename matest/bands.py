"""Images in bands of rows: from values at a surface's rays to the pixels that are means over them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from matest.scene import Surface

# Rays of a band: enough to be worth a thread, few enough for memory to stay small.
_BAND_RAYS = 1 << 17


@dataclass(frozen=True, eq=False)
class Band:
    """Some rows of an image each of whose pixels stands for `factor` × `factor` rays.

    Attributes:
        rows: of the image.
        width: of the image in pixels.
        factor: rays per pixel and axis.
        index: the surface's pixels, that is rays, which lie in the band: a range of theirs.
        pixels: flat place in the band of the pixel that each ray belongs to [n].
    """

    rows: range
    width: int
    factor: int
    index: range
    pixels: np.ndarray

    @cached_property
    def coverage(self) -> np.ndarray:
        """Share of the rays of each pixel that meet the surface [h, W]."""
        count = np.bincount(self.pixels, minlength=len(self.rows) * self.width)
        return count.reshape(len(self.rows), self.width) / self.factor**2

    @cached_property
    def covered(self) -> np.ndarray:
        """Flat places in the band of the pixels whose rays meet the surface, at least one of them [m]."""
        return self.pixels if self.factor == 1 else np.flatnonzero(self.coverage)

    def means(self, values: np.ndarray, index: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Values [n, C] at the rays averaged over each covered pixel [m, C]; rays that miss the surface count as 0.

        Args:
            values: at the rays [n, C], or at some of them.
            index: of these; the others count as 0.
        """
        if self.factor == 1:
            return values
        pixels, size = self.pixels[index], len(self.rows) * self.width
        sums = [np.bincount(pixels, column, size)[self.covered] for column in values.T]
        return np.stack(sums, axis=1) / self.factor**2

    def image(self, values: np.ndarray) -> np.ndarray:
        """Values [m, C] of the covered pixels laid out [h, W, C], 0 elsewhere."""
        image = np.zeros((len(self.rows) * self.width, values.shape[1]), values.dtype)
        image[self.covered] = values
        return image.reshape(len(self.rows), self.width, -1)


def bands(surface: Surface, factor: int) -> Iterator[Band]:
    """The bands of an image of a surface that has `factor` times the image's resolution, from top to bottom."""
    height, width = (side // factor for side in surface.shape)
    row_rays = width * factor**2
    count = max(_BAND_RAYS // row_rays, 1)
    for first in range(0, height, count):
        rows = range(first, min(first + count, height))
        start, stop = np.searchsorted(surface.pixels, [rows.start * row_rays, rows.stop * row_rays]).tolist()
        rays = surface.pixels[start:stop] - rows.start * row_rays
        yield Band(rows, width, factor, range(start, stop), rays if factor == 1 else _pixels(rays, width, factor))


def _pixels(rays: np.ndarray, width: int, factor: int) -> np.ndarray:
    """Flat places in a band of the pixels that rays belong to [n], from their own flat places [n]."""
    # In 32 bits, which divide several times as fast.
    row, column = np.divmod(rays.astype(np.uint32), np.uint32(width * factor))
    return (row // np.uint32(factor) * np.uint32(width) + column // np.uint32(factor)).astype(np.int64)
