"""The samples of photographs texel by texel: a few thousand pixels of the object in all images at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch

from matest.photographs.pixels import LitPixels
from matest.samples.batch import join
from matest.samples.texels import TexelTile
from matest.workers import processors

# Samples of a tile, about: so many that its overhead does not count, so few that they stay in the cache.
_TILE_SAMPLES = 98_304


@dataclass(frozen=True)
class TexelTiles:
    """Functions that make the tiles of all texels, in lists of as many as there are workers.

    Attributes:
        pixels: of the photographs.
    """

    pixels: LitPixels

    def __iter__(self) -> Iterator[list[Callable[[], TexelTile]]]:
        total, images = len(self.pixels.photographs.scene.surface), len(self.pixels.images)
        size = max(_TILE_SAMPLES // max(images, 1), 1)
        starts = range(0, total, size)
        for first in range(0, len(starts), processors()):
            some = starts[first : first + processors()]
            yield [partial(texel_tile, self.pixels, np.arange(start, min(start + size, total))) for start in some]


def texel_tile(pixels: LitPixels, index: np.ndarray) -> TexelTile:
    """The samples of all images at some of the object's pixels, `index` [n]."""
    parts = [pixels.at(position, index) for position in range(len(pixels.images))]
    batch = join(parts)
    usable = np.concatenate([pixels.usable(position)[index] for position in range(len(pixels.images))])
    return TexelTile(
        texels=torch.from_numpy(index.astype(np.int64)),
        # An array of each channel: torch is several times slower where the innermost loop is over three channels.
        batch=replace(batch, radiance=batch.radiance.T.contiguous().T),
        usable=torch.from_numpy(usable),
    )
