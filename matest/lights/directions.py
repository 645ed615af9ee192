"""Directions of lights from their images in a mirror sphere, with the errors of both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from matest.lights.extent import Extent, measure_extent
from matest.lights.highlight import Patch
from matest.lights.sphere import MirrorSphere, standard_errors

# Step of derivatives by the place of a highlight, pixels: far less than the sphere's radius.
_STEP = 0.05


@dataclass(frozen=True)
class Ray:
    """The ray by which a sphere reflects a light, or the change of one.

    Attributes:
        direction: unit vector to the light, the mean of its irradiance, in world coordinates [..., 3].
        spot: where it leaves the sphere, in radii: from a perspective camera, or from the sphere's centre where the
            viewer is distant [..., 3].
    """

    direction: np.ndarray
    spot: np.ndarray


@dataclass(frozen=True)
class Sighting:
    """A light as one sphere shows it in one image.

    Attributes:
        ray: that the sphere reflects.
        by_place: changes of the ray with one standard error along each axis of the error of the highlight [2, 3].
        by_outline: the same of the sphere's outline, which all lights of a sphere have in common [3, 3].
        place: of the highlight in the image (x, y), pixels.
        saturated: pixels of the highlight.
        extent: solid angle of the light; None where the highlight does not tell it.
    """

    ray: Ray
    by_place: Ray
    by_outline: Ray
    place: tuple[float, float]
    saturated: int
    extent: Extent | None = None

    @property
    def variance(self) -> float:
        """Of each of two tangential angles of the direction, rad²."""
        changes = np.concatenate([self.by_place.direction, self.by_outline.direction])
        return float((changes**2).sum()) / 2


def sight(patch: Patch, sphere: MirrorSphere) -> Sighting:
    """The light whose image in a sphere a patch is.

    Every pixel reflects one direction and covers a solid angle; the mean of the directions by brightness times solid
    angle is that of the irradiance that arrives, however the sphere distorts the light's shape.

    Args:
        patch: of the sphere's image.
        sphere: that is seen.
    """

    def ray(place: np.ndarray, outline: np.ndarray = sphere.outline) -> np.ndarray:
        return _mean_ray(patch, sphere, patch.x + place[0], patch.y + place[1], outline)

    here = np.zeros(2)
    slopes = np.stack([ray(step) - ray(-step) for step in _STEP * np.eye(2)]) / (2 * _STEP)
    by_place = standard_errors(patch.covariance) @ slopes
    steps = standard_errors(sphere.covariance)
    by_outline = np.stack([ray(here, sphere.outline + step) - ray(here, sphere.outline - step) for step in steps]) / 2
    return Sighting(
        ray=_split(ray(here)),
        by_place=_split(by_place),
        by_outline=_split(by_outline),
        place=patch.place,
        saturated=patch.saturated,
        extent=measure_extent(patch, sphere),
    )


def _split(numbers: np.ndarray) -> Ray:
    return Ray(numbers[..., :3], numbers[..., 3:])


def _mean_ray(patch: Patch, sphere: MirrorSphere, x: np.ndarray, y: np.ndarray, outline: np.ndarray) -> np.ndarray:
    """Mean direction of what places (x, y) reflect, and mean place on the sphere, by the patch's weights [6]."""
    reflection = sphere.reflect(x, y, outline)
    weights = patch.weights * sphere.solid_angles(x, y, outline)
    mean = weights @ reflection.directions
    spot = weights @ reflection.normals / weights.sum()
    if not sphere.camera.orthographic:
        spot = spot + sphere.centre(outline)
    return np.concatenate([mean / np.linalg.norm(mean), spot])
