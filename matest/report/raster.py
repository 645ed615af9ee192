"""Which pixels of a photograph a picture shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from matest.report.picture_size import PictureSize
from matest.scene import Surface

# Share of the sides of a photograph below which pictures show no more than the part about the object.
_SMALL = 0.5
# Share of the object's size that they show on either side of it.
_MARGIN = 0.1


class Window(NamedTuple):
    """The part of a photograph that pictures show.

    Attributes:
        first: row and column of its corner.
        shape: height and width.
    """

    first: tuple[int, int]
    shape: tuple[int, int]

    @staticmethod
    def of(surface: Surface, size: PictureSize = PictureSize.PREVIEW) -> Window:
        """All of a photograph, or but for full-size pictures the part about an object that fills little of it."""
        whole = Window((0, 0), surface.shape)
        if size is PictureSize.FULL:
            return whole
        first, shape = [], []
        for places, side in zip(np.divmod(surface.pixels, surface.shape[1]), surface.shape, strict=True):
            low, high = int(places.min()), int(places.max()) + 1
            margin = round(_MARGIN * (high - low)) + 1
            low, high = max(low - margin, 0), min(high + margin, side)
            first.append(low)
            shape.append(high - low)
        if all(length < _SMALL * side for length, side in zip(shape, surface.shape, strict=True)):
            return Window((first[0], first[1]), (shape[0], shape[1]))
        return whole


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
    def of(surface: Surface, step: int, window: Window | None = None) -> Raster:
        """One pixel of every `step`×`step` of a surface's image or a window, from the middle of each square."""
        window = window or Window((0, 0), surface.shape)
        rows, columns = (
            np.arange(first + min(step, side) // 2, first + side, step)
            for first, side in zip(window.first, window.shape, strict=True)
        )
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
