"""Light of rectangles and discs by sums over many points of them, with numpy alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

_POINTS = 200


def radiance(
    middle: np.ndarray,
    sides: np.ndarray,
    *,
    disc: bool,
    axis: np.ndarray,
    intensity: float,
    normals: np.ndarray,
    brdf: Callable[[np.ndarray, np.ndarray], np.ndarray],
) -> np.ndarray:
    """Radiance toward z that leaves the origin, for several normals [n].

    Args:
        middle: of the source [3].
        sides: half its width and height, or radii of a disc [2, 3].
        disc: whether it is one.
        axis: along which it radiates most, by the cosine [3].
        intensity: irradiance at unit distance on the axis, of all of it.
        normals: [n, 3].
        brdf: of directions in the local frame [m, 3].
    """
    steps = (np.arange(_POINTS) + 0.5) / _POINTS * 2 - 1
    u, v = (grid.ravel() for grid in np.meshgrid(steps, steps, indexing="ij"))
    if disc:
        u, v = u[u**2 + v**2 < 1], v[u**2 + v**2 < 1]
    places = middle + u[:, None] * sides[0] + v[:, None] * sides[1]
    squared = (places**2).sum(axis=1)
    toward = places / np.sqrt(squared)[:, None]
    power = intensity / len(u) * np.clip(-toward @ axis, 0, None) / squared
    values = []
    for normal in normals:
        tangent = np.cross([0.3, 0.9, 0.1], normal)
        tangent /= np.linalg.norm(tangent)
        frame = np.stack([tangent, np.cross(normal, tangent), normal])
        wi = toward @ frame.T
        wo = np.broadcast_to(frame @ np.array([0.0, 0.0, 1.0]), wi.shape)
        up = wi[:, 2] > 0
        values.append((brdf(wi[up], wo[up]) * wi[up, 2] * power[up]).sum())
    return np.array(values)
