"""Images in bands of rows: from values at a surface's rays to the pixels that are means over them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

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
        rays: their flat place in the band at the resolution of rays [n].
    """

    rows: range
    width: int
    factor: int
    index: range
    rays: np.ndarray

    @property
    def coverage(self) -> np.ndarray:
        """Share of the rays of each pixel that meet the surface [h, W]."""
        return self._averaged(np.ones((len(self.rays), 1), dtype=bool))[..., 0]

    @property
    def covered(self) -> np.ndarray:
        """Flat places in the band of the pixels whose rays meet the surface, at least one of them [m]."""
        return self.rays if self.factor == 1 else np.flatnonzero(self.coverage)

    def means(self, values: np.ndarray) -> np.ndarray:
        """Values [n, C] at the rays averaged over each covered pixel [m, C]; rays that miss the surface count as 0."""
        if self.factor == 1:
            return values
        return self._averaged(values).reshape(-1, values.shape[1])[self.covered]

    def image(self, values: np.ndarray) -> np.ndarray:
        """Values [m, C] of the covered pixels laid out [h, W, C], 0 elsewhere."""
        image = np.zeros((len(self.rows) * self.width, values.shape[1]), values.dtype)
        image[self.covered] = values
        return image.reshape(len(self.rows), self.width, -1)

    def _averaged(self, values: np.ndarray) -> np.ndarray:
        """Means [h, W, C] over the rays of each pixel of values [n, C]."""
        height, width, factor = len(self.rows), self.width, self.factor
        fine = np.zeros((height * width * factor**2, values.shape[1]), values.dtype)
        fine[self.rays] = values
        return fine.reshape(height, factor, width, factor, -1).mean(axis=(1, 3))


def bands(surface: Surface, factor: int) -> Iterator[Band]:
    """The bands of an image of a surface that has `factor` times the image's resolution, from top to bottom."""
    height, width = (side // factor for side in surface.shape)
    row_rays = width * factor**2
    count = max(_BAND_RAYS // row_rays, 1)
    for first in range(0, height, count):
        rows = range(first, min(first + count, height))
        start, stop = np.searchsorted(surface.pixels, [rows.start * row_rays, rows.stop * row_rays]).tolist()
        rays = surface.pixels[start:stop] - rows.start * row_rays
        yield Band(rows, width, factor, range(start, stop), rays)
