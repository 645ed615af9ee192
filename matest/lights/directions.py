"""Directions of lights from their images in a mirror sphere, with the errors of both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from matest.lights.highlight import Patch
from matest.lights.sphere import MirrorSphere

# Steps of derivatives, in pixels and in standard errors of the outline.
_PIXEL_STEP, _OUTLINE_STEP = 0.05, 1.0


@dataclass(frozen=True)
class Sighting:
    """A light as one sphere shows it in one image.

    Attributes:
        direction: unit vector to the light, the mean of its irradiance, in world coordinates [3].
        spot: where the sphere reflects it, in radii from its centre [3].
        by_place: covariance of the direction by the place of the highlight [3, 3].
        by_outline: change of the direction with one standard error along each axis of the outline's errors [3, 3],
            a row each: what all lights of a sphere have in common.
        place: of the highlight in the image (x, y), pixels.
        saturated: pixels of the highlight.
    """

    direction: np.ndarray
    spot: np.ndarray
    by_place: np.ndarray
    by_outline: np.ndarray
    place: tuple[float, float]
    saturated: int

    @property
    def covariance(self) -> np.ndarray:
        """Of the direction [3, 3]."""
        return self.by_place + self.by_outline.T @ self.by_outline


def sight(patch: Patch, sphere: MirrorSphere) -> Sighting:
    """The light whose image in a sphere a patch is.

    Every pixel reflects one direction and covers a solid angle; the mean of the directions by brightness times solid
    angle is that of the irradiance that arrives, whatever the mirror makes of the light's shape.

    Args:
        patch: of the sphere's image.
        sphere: that is seen.
    """

    def direction(dx: float = 0.0, dy: float = 0.0, outline: np.ndarray | None = None) -> np.ndarray:
        return _mean(patch, sphere, patch.x + dx, patch.y + dy, outline)[0]

    mean, spot = _mean(patch, sphere, patch.x, patch.y, None)
    step = _PIXEL_STEP
    moved = np.stack([direction(step) - direction(-step), direction(0, step) - direction(0, -step)]) / (2 * step)
    variances, axes = np.linalg.eigh(sphere.covariance)
    scales = _OUTLINE_STEP * np.sqrt(np.clip(variances, 0, None))
    by_outline = np.stack(
        [
            direction(outline=sphere.outline + scale * axis) - direction(outline=sphere.outline - scale * axis)
            for scale, axis in zip(scales, axes.T, strict=True)
        ]
    ) / (2 * _OUTLINE_STEP)
    return Sighting(mean, spot, moved.T @ patch.covariance @ moved, by_outline, patch.place, patch.saturated)


def _mean(
    patch: Patch, sphere: MirrorSphere, x: np.ndarray, y: np.ndarray, outline: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Mean direction of what places (x, y) reflect [3], and mean place on the sphere [3], by the patch's weights."""
    reflection = sphere.reflect(x, y, outline)

    def across(dx: float, dy: float) -> np.ndarray:
        ends = (sphere.reflect(x + sign * dx, y + sign * dy, outline).directions for sign in (0.5, -0.5))
        return np.subtract(*ends)

    solid_angles = np.linalg.norm(np.cross(across(1, 0), across(0, 1)), axis=1)
    weights = patch.weights * solid_angles
    mean = weights @ reflection.directions
    return mean / np.linalg.norm(mean), weights @ reflection.normals / weights.sum()
