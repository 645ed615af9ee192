"""Photographs of mirror balls under discs of light, traced with numpy alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.ndimage import binary_dilation, gaussian_filter

# Rays per pixel and axis where a pixel may hold an edge.
_SUBPIXELS = 6


class Lamp(NamedTuple):
    """A disc of even radiance far away; saturation is 1."""

    direction: tuple[float, ...]
    half_angle: float
    radiance: float


class Ball(NamedTuple):
    """A mirror ball and the camera that sees it, along −z with y up.

    Attributes:
        size: width and height of the image, pixels.
        circle: x, y and radius in pixels, for a distant camera.
        fov: vertical field of view of a camera at the origin, rad; None: a distant one.
        centre: of the ball for that camera.
        radius: of the ball for that camera.
    """

    size: int
    circle: tuple[float, float, float] = (0.0, 0.0, 1.0)
    fov: float | None = None
    centre: tuple[float, ...] = (0.0, 0.0, 0.0)
    radius: float = 1.0

    def trace(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Whether rays through places of the image hit, where (radii from the centre), and where they go on to."""
        if self.fov is None:
            u, v = (x - self.circle[0]) / self.circle[2], (self.circle[1] - y) / self.circle[2]
            squared = u**2 + v**2
            normals = np.stack([u, v, np.sqrt(np.clip(1 - squared, 0, None))], -1)
            rays, hit = np.broadcast_to([0.0, 0.0, -1.0], normals.shape), squared < 1
        else:
            focal = self.size / 2 / np.tan(self.fov / 2)
            rays = np.stack([(x - self.size / 2) / focal, (self.size / 2 - y) / focal, -np.ones_like(x)], -1)
            rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
            centre = np.array(self.centre) / self.radius
            along = rays @ centre
            discriminant = along**2 - centre @ centre + 1
            hit = discriminant > 0
            normals = rays * (along - np.sqrt(np.clip(discriminant, 0, None)))[..., None] - centre
        return hit, normals, rays - 2 * (rays * normals).sum(-1, keepdims=True) * normals

    def photograph(
        self,
        lamps: Sequence[Lamp],
        *,
        blur: float = 1.0,
        noise: float = 0.0,
        seed: int = 0,
        background: float = 0.02,
        at: tuple[float, ...] | None = None,
    ) -> np.ndarray:
        """A photograph of values 0 to 1 in steps of 1/255.

        Args:
            lamps: a later one hides an earlier one.
            blur: standard deviation of a Gaussian, pixels.
            noise: standard deviation.
            seed: of the noise.
            background: radiance of everything else that the ball shows.
            at: where the last lamp stands if it is near, in the camera's units.
        """

        def radiance(x: np.ndarray, y: np.ndarray, margin: float = 0.0) -> np.ndarray:
            hit, normals, reflected = self.trace(x, y)
            values = np.where(hit, background, 0.0)
            for k, lamp in enumerate(lamps):
                target = np.array(lamp.direction, dtype=float)
                if at is not None and k == len(lamps) - 1:
                    target = np.array(at) - (np.array(self.centre) + self.radius * normals)
                target = target / np.linalg.norm(target, axis=-1, keepdims=True)
                inside = (reflected * target).sum(-1) > np.cos(lamp.half_angle + margin)
                values = np.where(hit & inside, lamp.radiance, values)
            return values

        rows, columns = np.indices((self.size, self.size)) + 0.5
        image = radiance(columns, rows)
        pixel = 4 / (self.circle[2] if self.fov is None else self.size / 4)
        near = binary_dilation(radiance(columns, rows, margin=pixel) != image, iterations=2)
        for lamp in lamps:
            near |= binary_dilation(image == lamp.radiance, iterations=2)
        offsets = (np.arange(_SUBPIXELS) + 0.5) / _SUBPIXELS - 0.5
        x = columns[near][:, None] + np.tile(offsets, _SUBPIXELS)
        y = rows[near][:, None] + np.repeat(offsets, _SUBPIXELS)
        image[near] = radiance(x, y).mean(axis=1)
        image = gaussian_filter(image, blur) + noise * np.random.default_rng(seed).standard_normal(image.shape)
        return np.round(255 * np.clip(image, 0, 1)) / 255

    def mask(self) -> np.ndarray:
        """The share of every pixel that the ball covers."""
        rows, columns = np.indices((self.size, self.size)) + 0.5
        covered = self.trace(columns, rows)[0].astype(float)
        edge = binary_dilation(covered > 0, iterations=2) & binary_dilation(covered == 0, iterations=2)
        offsets = (np.arange(_SUBPIXELS) + 0.5) / _SUBPIXELS - 0.5
        x = columns[edge][:, None] + np.tile(offsets, _SUBPIXELS)
        y = rows[edge][:, None] + np.repeat(offsets, _SUBPIXELS)
        covered[edge] = self.trace(x, y)[0].mean(axis=1)
        return covered


def unit(*vector: float) -> tuple[float, ...]:
    return tuple(np.array(vector) / np.linalg.norm(vector))


def degrees_between(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Angles between unit vectors [..., 3]."""
    return np.degrees(2 * np.arcsin(np.linalg.norm(np.asarray(first) - np.asarray(second), axis=-1) / 2))
