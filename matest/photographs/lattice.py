"""Photographs thinned to a square lattice of their pixels."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from matest.scene import Scene
from matest.scene.bits import Bits

if TYPE_CHECKING:
    from matest.photographs.photographs import Photographs


def on_lattice(photographs: Photographs, count: int) -> Photographs:
    """The photographs at about `count` pixels of the surface, evenly spaced; at all if there are fewer.

    The lattice makes images of its own: its neighbours are neighbours there.
    """
    scene, encoding = photographs.scene, photographs.encoding
    surface = scene.surface
    step = max(math.ceil(math.sqrt(len(surface) / count)), 1)
    if step == 1:
        return photographs
    rows, columns = np.divmod(surface.pixels, surface.shape[1])
    kept = (rows % step == 0) & (columns % step == 0)
    height, width = (-(-side // step) for side in surface.shape)
    places = (rows[kept] // step * width + columns[kept] // step).astype(surface.pixels.dtype)
    thin = replace(surface.take(kept), shape=(height, width), pixels=places)
    some = np.flatnonzero(kept)
    black = encoding.black if isinstance(encoding.black, float) else encoding.black[some]
    flat = None if encoding.flat is None else encoding.flat[some]
    return replace(
        photographs,
        scene=_of_pixels(replace(scene, surface=thin), some),
        encoding=replace(encoding, black=black, flat=flat),
        stored=tuple(_values(photographs, image, some) for image in range(len(photographs))),
    )


def _values(photographs: Photographs, image: int, some: np.ndarray) -> np.ndarray:
    """Stored values of some pixels of an image, of which no more stays in memory."""
    values = np.take(photographs.stored[image], some, axis=0)
    photographs.release(image)
    return values


def _of_pixels(scene: Scene, some: np.ndarray) -> Scene:
    """A scene whose shadows are those of some of the pixels that they were traced for."""
    return replace(
        scene,
        shadows=tuple(
            None if shadows is None else tuple(Bits.of(shadow[some]) for shadow in shadows) for shadows in scene.shadows
        ),
        shadow_edge=tuple(None if edge is None else Bits.of(edge[some]) for edge in scene.shadow_edge),
        unoccluded=None if scene.unoccluded is None else scene.unoccluded[some],
    )
