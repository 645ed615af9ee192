"""Radiance of pixels that are means over several rays, each ray shaded only where those of a pixel differ."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import cv2
import numpy as np
import torch

from matest.bands import Band, bands
from matest.scene import Scene, Surface
from matest.scene.bits import Bits
from matest.shading import Material, render_pixels
from matest.workers import in_threads

# Error of the radiance at a mean normal as a share of the second difference between pixels: 1/24 where the surface is
# smooth, up to 1/8 where it has an edge.
_CURVATURE_ERROR = 1 / 8
# Variance of the numbers of objects in a pixel of 16 × 16 rays below which all of them are equal.
_SAME_OBJECT = 1e-3


def radiance_of_rays(scene: Scene, factor: int, image: int, material: Material) -> np.ndarray:
    """Radiance [m, C] of the pixels of an image, float64, each the mean over its `factor` × `factor` rays."""

    def shade(band: Band) -> np.ndarray:
        index = torch.arange(band.index.start, band.index.stop)
        return band.means(_shaded(scene, image, material, index))

    return np.concatenate(list(in_threads(shade, bands(scene.surface, factor))))


@dataclass(frozen=True, eq=False)
class PixelMeans:
    """A scene of a surface seen by `factor` × `factor` rays a pixel, and the same with one point for each pixel.

    Attributes:
        rays: the scene of all rays.
        factor: rays per pixel and axis.
        points: the scene whose m points have the mean normals and positions of the rays that each pixel has on the
            surface.
        whole: whether all rays of a pixel meet the surface, and one object of it [m].
        spread: what the mean of a pixel's unit normals lacks to length 1 [m].
        half_shadowed: per image, whether a light reaches some rays of a pixel only [m].
    """

    rays: Scene
    factor: int
    points: Scene
    whole: np.ndarray
    spread: np.ndarray
    half_shadowed: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, scene: Scene, factor: int) -> PixelMeans:
        """The means over the rays of each pixel."""
        surface, strips = scene.surface, list(bands(scene.surface, factor))
        width = surface.shape[1] // factor
        coverage = np.concatenate([band.coverage.ravel()[band.covered] for band in strips])

        def mean(values: np.ndarray) -> np.ndarray:
            """Means [m, …] of values [n, …] over the rays of each pixel that meet the surface."""
            flat = values.reshape(len(values), -1)
            parts = [band.means(flat[band.index.start : band.index.stop]) for band in strips]
            return (np.concatenate(parts) / coverage[:, None]).reshape(-1, *values.shape[1:])

        normals = mean(surface.normals.numpy())
        length = np.linalg.norm(normals, axis=1)
        positions = None if surface.positions is None else torch.from_numpy(mean(surface.positions.numpy()))
        points = Surface(
            shape=(surface.shape[0] // factor, width),
            pixels=np.concatenate([band.covered + band.rows.start * width for band in strips]),
            normals=torch.from_numpy(normals / length[:, None]),
            sightlines=None if surface.sightlines is None else surface.sightlines[:1],
            positions=positions,
            rim=np.zeros(len(normals), dtype=bool),
            eye=surface.eye,
            objects=None if surface.objects is None else surface.objects.take(_first_rays(strips)),
        )
        shares = [
            None if shadows is None else np.stack([mean(np.asarray(shadow)) for shadow in shadows])
            for shadows in scene.shadows
        ]
        coarse = dataclasses.replace(
            scene,
            surface=points,
            shadows=tuple(
                None if share is None else tuple(Bits.of(of_light > 0) for of_light in share) for share in shares
            ),
            shadow_edge=(),
            unoccluded=None if scene.unoccluded is None else mean(scene.unoccluded),
        )
        return cls(
            rays=scene,
            factor=factor,
            points=coarse,
            whole=(coverage == 1) & _of_one_object(surface, strips),
            spread=1 - length,
            half_shadowed=tuple(_partial(share, len(normals)) for share in shares),
        )

    def radiance(self, image: int, material: Material, tolerance: float, full_scale: float | None = None) -> np.ndarray:
        """Radiance [m, C] of the pixels of an image, float64.

        A pixel is shaded once, at its mean normal, where that differs little from the mean over its rays, judged by the
        pixels about it.

        Args:
            image: number of the image.
            material: of the surface.
            tolerance: most by which they may differ, as a share of full scale.
            full_scale: radiance; None: the highest of the image.
        """
        strips = list(bands(self.rays.surface, self.factor))
        ends = np.cumsum([0, *(len(band.covered) for band in strips)]).tolist()
        values = np.empty((ends[-1], self.rays.channels))

        def shade(number: int) -> None:
            index = torch.arange(ends[number], ends[number + 1])
            values[index.numpy()] = _shaded(self.points, image, material, index)

        list(in_threads(shade, range(len(strips))))
        # An error that is not a number is too large as well.
        coarse = ~(self._error(values) <= tolerance * (full_scale or values.max(initial=0)))
        coarse |= ~self.whole | self.half_shadowed[image]

        def refine(number: int) -> None:
            some = coarse[ends[number] : ends[number + 1]]
            part = values[ends[number] : ends[number + 1]]
            part[some] = self._mean_of_rays(image, material, strips[number], some)

        list(in_threads(refine, range(len(strips))))
        return values

    def _mean_of_rays(self, image: int, material: Material, band: Band, some: np.ndarray) -> np.ndarray:
        """Means over the rays of some of the m covered pixels of a band (boolean [m])."""
        chosen = np.zeros(band.coverage.size, dtype=bool)
        chosen[band.covered] = some
        rays = np.flatnonzero(chosen[band.pixels])
        shaded = _shaded(self.rays, image, material, torch.from_numpy(rays + band.index.start))
        return band.means(shaded, rays)[some]

    def _error(self, values: np.ndarray) -> np.ndarray:
        """Most by which the radiance of each pixel [m, C] differs from the mean over its rays, judged from [m]."""
        picture = self.points.surface.image(values)
        # The edge of the image counts as even: what lies beyond is not known.
        padded = np.pad(picture, ((1, 1), (1, 1), (0, 0)), "edge")
        across = padded[1:-1, :-2] - 2 * picture + padded[1:-1, 2:]
        along = padded[:-2, 1:-1] - 2 * picture + padded[2:, 1:-1]
        bend = cv2.dilate((np.abs(across) + np.abs(along)).max(axis=2), np.ones((3, 3), np.uint8))
        return _CURVATURE_ERROR * bend.flat[self.points.surface.pixels] + self.spread * values.max(axis=1)


def _first_rays(strips: list[Band]) -> np.ndarray:
    """The first of the rays that meet the surface in each pixel [m]."""
    return np.concatenate([band.index.start + np.unique(band.pixels, return_index=True)[1] for band in strips])


def _of_one_object(surface: Surface, strips: list[Band]) -> np.ndarray:
    """Whether all rays of a pixel that meet the surface meet one object [m]."""
    if surface.objects is None:
        return np.ones(1, dtype=bool)
    alike = []
    for band in strips:
        index = surface.objects.index[band.index.start : band.index.stop].astype(np.float64)[:, None]
        mean, square = (band.means(values) / band.coverage.ravel()[band.covered, None] for values in (index, index**2))
        alike.append((square - mean**2 < _SAME_OBJECT)[:, 0])
    return np.concatenate(alike)


def _partial(share: np.ndarray | None, count: int) -> np.ndarray:
    """Whether a light reaches some rays of a pixel only [m], from the share that is in its shadow [L, m]."""
    if share is None:
        return np.zeros(count, dtype=bool)
    return np.asarray(((share > 0) & (share < 1)).any(axis=0))


def _shaded(scene: Scene, image: int, material: Material, index: torch.Tensor) -> np.ndarray:
    """Radiance [n, C] of some of a surface's pixels in double precision."""
    if not len(index):
        return np.zeros((0, scene.channels))
    with torch.no_grad():
        return render_pixels(scene, image, material, index, dtype=torch.float64).numpy()
