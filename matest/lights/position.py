"""Positions of near lights: where the rays that several mirror spheres reflect meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from matest.errors import InputError
from matest.lights.directions import Ray, Sighting
from matest.lights.sphere import MirrorSphere

# Largest standard error of a position, as a share of the distance from the spheres, that is worth stating.
_LARGEST_ERROR = 0.5


@dataclass(frozen=True)
class Placement:
    """Where spheres stand in the world.

    Attributes:
        radius: of every sphere, world units.
        centres: of the spheres, world units [K, 3]; None: as the perspective camera sees them.
    """

    radius: float
    centres: np.ndarray | None = None

    def check(self, spheres: Sequence[MirrorSphere]) -> None:
        """Refuse spheres whose places are not known.

        Raises:
            InputError: fewer than two spheres, or centres that are missing, superfluous or too many.
        """
        if not 0 < self.radius < np.inf:
            raise InputError(f"--radius must be positive world units; got {self.radius:g}.")
        if len(spheres) < 2:
            raise InputError(
                "--radius gives positions of lights from two spheres or more; got one. Give a second capture, or "
                "--circle once for each sphere."
            )
        distant = any(sphere.camera.orthographic for sphere in spheres)
        if self.centres is None and distant:
            raise InputError(
                "positions of lights need to know where the spheres stand: give --centre X,Y,Z for each, or a "
                "perspective camera ([camera] or --fov-y)."
            )
        if self.centres is not None and not distant:
            raise InputError("--centre is for orthographic cameras; in perspective the outline tells the place.")
        if self.centres is not None and len(self.centres) != len(spheres):
            raise InputError(f"--centre: expected {len(spheres)}, one for each sphere; got {len(self.centres)}.")


@dataclass(frozen=True)
class Position:
    """Of a near light.

    Attributes:
        point: world units [3].
        covariance: of it [3, 3].
    """

    point: np.ndarray
    covariance: np.ndarray

    @property
    def std(self) -> np.ndarray:
        """Standard error of each coordinate [3]."""
        return np.sqrt(np.diagonal(self.covariance))


def intersect(sightings: Sequence[Sighting], spheres: Sequence[MirrorSphere], placement: Placement) -> Position | None:
    """Where the rays to a light meet, with its errors; None where they do not, or only far away.

    The nearest point to all rays, each weighted by its error at the light.

    Args:
        sightings: of one light, one for each sphere.
        spheres: that show it.
        placement: of the spheres.
    """
    rays = [sighting.ray for sighting in sightings]
    origins = _origins(rays, spheres, placement)
    directions = np.stack([ray.direction for ray in rays])
    point = _nearest_point(origins, directions, np.ones(len(rays)))
    if point is None:
        return None
    along = ((point - origins) * directions).sum(axis=1)
    if not (along > 0).all():
        return None
    weights = 1 / (along**2 * [max(sighting.variance, 1e-30) for sighting in sightings])
    point = _nearest_point(origins, directions, weights)
    if point is None:
        return None
    covariance = np.zeros((3, 3))
    for k, sighting in enumerate(sightings):
        turns = np.concatenate([sighting.by_place.direction, sighting.by_outline.direction])
        shifts = np.concatenate([sighting.by_place.spot, sighting.by_outline.spot])
        for turn, shift in zip(turns, shifts, strict=True):
            moved_origins, moved = origins.copy(), directions.copy()
            moved_origins[k] += placement.radius * shift
            moved[k] = (moved[k] + turn) / np.linalg.norm(moved[k] + turn)
            other = _nearest_point(moved_origins, moved, weights)
            if other is None:
                return None
            covariance += np.outer(other - point, other - point)
    if np.sqrt(np.trace(covariance)) > _LARGEST_ERROR * along.min():
        return None
    return Position(point, covariance)


def _origins(rays: Sequence[Ray], spheres: Sequence[MirrorSphere], placement: Placement) -> np.ndarray:
    """Where the rays leave the spheres, world units [K, 3]."""
    if placement.centres is not None:
        starts = placement.centres
    else:
        starts = np.array([sphere.camera.position for sphere in spheres], dtype=np.float64)
    return starts + placement.radius * np.stack([ray.spot for ray in rays])


def _nearest_point(origins: np.ndarray, directions: np.ndarray, weights: np.ndarray) -> np.ndarray | None:
    """The point with the least weighted sum of squared distances from rays; None where they are parallel."""
    across = weights[:, None, None] * (np.eye(3) - directions[:, :, None] * directions[:, None, :])
    normal = across.sum(axis=0)
    if not np.linalg.cond(normal) < 1e12:
        return None
    point: np.ndarray = np.linalg.solve(normal, (across @ origins[..., None]).sum(axis=0)[:, 0])
    return point
