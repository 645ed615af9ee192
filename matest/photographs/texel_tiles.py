"""The samples of photographs texel by texel: a few thousand pixels of the object in all images at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from torch import Tensor

from matest.directions import to_local
from matest.photographs.pixels import LitPixels
from matest.samples.batch import join
from matest.samples.likelihood import Limits, MeasurementNoise, Readout
from matest.samples.texels import TexelTile
from matest.scene import Points
from matest.workers import processors

# Samples of a tile, about: so many that the overhead of its small systems does not count, so few that they fit a cache.
_TILE_SAMPLES = 196_608


@dataclass(frozen=True)
class TexelTiles:
    """Functions that make the tiles of all texels, in lists of as many as there are workers.

    Attributes:
        pixels: of the photographs.
    """

    pixels: LitPixels

    def __iter__(self) -> Iterator[list[Callable[[], TexelTile]]]:
        total, images = len(self.pixels.photographs.scene.surface), len(self.pixels.images)
        size = max(_TILE_SAMPLES // max(images * self.pixels.crowd, 1), 1)
        starts = range(0, total, size)
        for first in range(0, len(starts), processors()):
            some = starts[first : first + processors()]
            yield [partial(texel_tile, self.pixels, np.arange(start, min(start + size, total))) for start in some]


def texel_tile(pixels: LitPixels, index: np.ndarray) -> TexelTile:
    """The samples of all images at some of the object's pixels, `index` [n]."""
    some = _in_one_piece(index)
    radiance = torch.empty(pixels.photographs.channels, len(pixels.images), len(index), dtype=pixels.dtype)
    for position, image in enumerate(pixels.images):
        radiance[:, position] = torch.from_numpy(pixels.photographs.radiance(image, some).T)
    usable = torch.from_numpy(np.concatenate([_usable(pixels, position, some) for position in range(len(radiance[0]))]))
    return TexelTile(
        texels=torch.from_numpy(index.astype(np.int64)),
        points=_points(pixels, index),
        radiance=radiance.flatten(1).T.to(pixels.device),
        noise=_noise(pixels, some, usable),
        usable=usable.to(pixels.device),
    )


def _in_one_piece(index: np.ndarray) -> np.ndarray | slice:
    """Ascending pixels as a slice where they lie in a row, which takes no copy."""
    is_row = len(index) and index[-1] - index[0] == len(index) - 1
    return slice(int(index[0]), int(index[-1]) + 1) if is_row else index


def _usable(pixels: LitPixels, position: int, index: np.ndarray | slice) -> np.ndarray:
    """Whether pixels are usable in the image at `position` [n]."""
    return pixels.usable(position, index) if isinstance(index, slice) else pixels.usable(position)[index]


def _points(pixels: LitPixels, index: np.ndarray) -> Points:
    """Geometry and light of pixels in all images, a grid [I, n]."""
    scene, places = pixels.photographs.scene, torch.from_numpy(index.astype(np.int64))
    lights = [scene.lights[image] for image in pixels.images]
    if scene.surrounded or bool((scene.ambient > 0).any()) or any(len(some) != 1 for some in lights):
        parts = [pixels.at(position, index) for position in range(len(pixels.images))]
        points, grid = join(parts).points, (len(parts), len(index))
        ambient = None if points.ambient is None else points.ambient.expand(grid[0] * grid[1], -1).unflatten(0, grid)
        wo = points.wo.unflatten(0, grid)[:1]
        return Points(points.wi.unflatten(0, grid), wo, points.irradiance.unflatten(0, grid), ambient)
    # A pixel in the shadow of the only light is not usable: its irradiance does not matter.
    dtype, device = pixels.dtype, pixels.device
    lit = []
    for image, (light,) in zip(pixels.images, lights, strict=True):
        positions = scene.near_positions(image, places)
        lit.append(light.to(dtype, device).at(None if positions is None else positions.to(device, dtype)))
    normals = scene.surface.normals_as(dtype)[places].to(device)
    toward, power = (torch.stack(torch.broadcast_tensors(*parts)) for parts in zip(*lit, strict=True))
    wi, wo = to_local(normals[None], toward, scene.surface.toward_viewer(places).to(device, dtype)[None])
    return Points(wi[:, :, None], wo, power[:, :, None])


def _noise(pixels: LitPixels, index: np.ndarray | slice, usable: Tensor) -> MeasurementNoise:
    """The noise of pixels in all images, one after another [I·n]; those that do not count are not clipped."""
    images, by_image = pixels.images, usable.unflatten(0, (len(pixels.images), -1))
    count = by_image.shape[1]
    clipped = [_clipped(pixels, image, index, some) for image, some in zip(images, by_image, strict=True)]
    # Images of one exposure have the same noise.
    exposures = [pixels.photographs.exposures[image] for image in images]
    first = {exposure: image for image, exposure in zip(reversed(images), reversed(exposures), strict=True)}
    limits = {exposure: pixels.limits(image, index) for exposure, image in first.items()}
    readouts = {exposure: pixels.readout(image, index) for exposure, image in first.items()}
    ends = None
    if all(end is not None for end in limits.values()):
        each = [end for end in map(limits.__getitem__, exposures) if end]
        ends = Limits(*(_in_a_row(parts, count) for parts in zip(*each, strict=True)))
    readout = Readout(*(_in_a_row(parts, count) for parts in zip(*map(readouts.__getitem__, exposures), strict=True)))
    if all(part is None for part in clipped):
        return MeasurementNoise(readout, ends)
    channels = pixels.photographs.channels
    nothing = torch.zeros(count, channels, dtype=torch.int8, device=pixels.device)
    return MeasurementNoise(readout, ends, torch.cat([nothing if part is None else part for part in clipped]))


def _clipped(pixels: LitPixels, image: int, index: np.ndarray | slice, usable: Tensor) -> Tensor | None:
    """Which values of the usable pixels of an image are clipped [n, C]; None where there are none."""
    clipped = pixels.clipped(image, index)
    if clipped is None:
        return None
    clipped = clipped * usable.to(clipped)[:, None]
    return clipped if bool(clipped.any()) else None


def _in_a_row(parts: Sequence[Tensor], count: int) -> Tensor:
    """Values [1 or n, 1 or C] of every image one after another, or once if they are the same."""
    first = parts[0]
    if len(first) == 1 and all(part is first or torch.equal(part, first) for part in parts):
        return first
    width = max(part.shape[-1] for part in parts)
    return torch.cat([part.expand(count, width) for part in parts])
