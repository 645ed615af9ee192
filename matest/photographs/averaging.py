"""What a pixel averages over: the slope of the surface within it."""

from __future__ import annotations

import math

import torch

from matest.photographs.windows import windows
from matest.scene import Surface

# Cosine of the angle to the viewer from which on a pixel counts: highlights of lights up to 60° off lie there, and
# farther out the normals of a pixel differ more.
_FACING = math.cos(math.radians(30))
# Place of the middle in a window of 3×3 pixels.
_MIDDLE = 4
# Places of its neighbours on opposite sides, two pixels from each other: left and right, above and below.
_OPPOSITE = ((3, 5), (1, 7))


def slope_variance(surface: Surface) -> float:
    """Variance of the slope of a surface within a pixel, of its two directions together.

    Where normals turn by δ from a pixel to the next, they have a variance of δ²/12 within each. The median of the
    pixels that face the viewer; 0 without such pixels, and for a normal map, since noise turns its normals too.
    """
    if surface.mesh is None and not surface.convex:
        return 0.0
    index = torch.from_numpy(windows(surface))
    normals = surface.normals_as(torch.float32).detach()
    middle = index[:, _MIDDLE]
    index = index[(normals[middle] * surface.toward_viewer(middle).detach()).sum(-1) > _FACING]
    if not len(index):
        return 0.0
    across, down = (normals[index[:, end]] - normals[index[:, start]] for start, end in _OPPOSITE)
    return float((across.square() + down.square()).sum(-1).median()) / 4 / 12
