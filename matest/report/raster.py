"""Which pixels of a photograph a picture shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from matest.scene import Surface


@dataclass(frozen=True)
class Raster:
    """One pixel of every `step`×`step` of the photographs, as a picture.

    The pixels are taken as they are, not averaged: a mean would show less noise in the difference than there is.

    Attributes:
        shape: of the picture.
        index: the surface's pixels that it shows [n].
        sources: for each pixel of the picture, row by row, its place in `index`; n on the background.
    """

    shape: tuple[int, int]
    index: np.ndarray
    sources: np.ndarray

    @staticmethod
    def of(surface: Surface, step: int) -> Raster:
        """One pixel of every `step`×`step` of a surface, from the middle of each square."""
        rows, columns = (np.arange(min(step, side) // 2, side, step) for side in surface.shape)
        shown = (rows[:, None] * surface.shape[1] + columns).ravel()
        nearest = np.searchsorted(surface.pixels, shown.astype(surface.pixels.dtype)).clip(max=len(surface) - 1)
        on_object = surface.pixels[nearest] == shown
        index = nearest[on_object]
        sources = np.full(len(shown), len(index))
        sources[on_object] = np.arange(len(index))
        return Raster((len(rows), len(columns)), index, sources)

    def picture(self, colours: np.ndarray, background: int) -> np.ndarray:
        """Colours [n, C] of the pixels as a picture."""
        with_background = np.concatenate([colours, np.full((1, colours.shape[1]), background, dtype=np.uint8)])
        return np.take(with_background, self.sources, axis=0, mode="clip").reshape(*self.shape, -1)
