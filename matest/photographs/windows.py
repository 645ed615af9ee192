"""A random sample of small windows of photographs: enough to judge a camera by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from matest.photographs.strata import one_per_stratum
from matest.scene import Surface

# Windows of a photograph, at most: those of eight photographs give the gain to about two per cent.
_WINDOWS = 4_096
# Photographs that are looked at, at most: one more says little that eight have not said.
_IMAGES = 8


def windows(surface: Surface) -> np.ndarray:
    """Windows of 3×3 pixels that lie on the object, off its rim: indices into the surface's pixels [n, 9]."""
    count = len(surface)
    centres = one_per_stratum(count, min(count, _WINDOWS), np.random.default_rng(0))
    height, width = surface.shape
    rows, columns = np.divmod(surface.pixels[centres], width)
    inside = (rows > 0) & (rows < height - 1) & (columns > 0) & (columns < width - 1)
    offsets = np.array([[-width], [0], [width]]) + np.array([-1, 0, 1])
    # A row of windows' pixels is ascending, which makes the search quick.
    places = surface.pixels[centres[inside]] + offsets.reshape(9, 1)
    index = np.searchsorted(surface.pixels, places.astype(surface.pixels.dtype)).clip(max=count - 1)
    whole = (surface.pixels[index] == places) & ~surface.rim[index]
    return index[:, whole.all(axis=0)].T.copy()


def chosen_images(stored: Sequence[np.ndarray]) -> list[int]:
    """Numbers of a few photographs, from the first to the last."""
    return np.unique(np.linspace(0, len(stored) - 1, min(len(stored), _IMAGES)).round().astype(int)).tolist()
