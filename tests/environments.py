"""Maps of light around a scene, with known answers."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

# Spots of a studio: direction, width in radians, radiance.
SPOTS = (
    ((0.6, 0.5, 0.6), 0.15, 6.0),
    ((-0.8, 0.1, 0.4), 0.25, 3.0),
    ((0.2, 0.9, -0.4), 0.3, 1.5),
    ((0.3, -0.4, 0.9), 0.1, 2.0),
)


def directions(polar: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Unit vectors as Mitsuba's `envmap` has them, with the azimuth of the columns from 0 to 2π [..., 3]."""
    return np.stack([np.sin(polar) * np.sin(azimuth), np.cos(polar), -np.sin(polar) * np.cos(azimuth)], axis=-1)


def studio(toward: np.ndarray) -> np.ndarray:
    """Radiance of a pale sky and four spots [...]."""
    radiance = 0.1 + 0.3 * toward[..., 1].clip(0)
    for middle, width, peak in SPOTS:
        cosine = toward @ (np.array(middle) / np.linalg.norm(middle))
        radiance = radiance + peak * np.exp((cosine - 1) / width**2)
    return radiance


def grid(rows: int) -> np.ndarray:
    """Unit vectors to the texels of a map [R, 2 R, 3]."""
    polar, azimuth = np.meshgrid(
        (np.arange(rows) + 0.5) * math.pi / rows, (np.arange(2 * rows) + 0.5) * math.pi / rows, indexing="ij"
    )
    return directions(polar, azimuth)


def solid_angles(rows: int) -> np.ndarray:
    """Of the texels of each row, sr [R]."""
    edges = np.cos(np.linspace(0, math.pi, rows + 1))
    return (edges[:-1] - edges[1:]) * math.pi / rows


def studio_map(rows: int = 64, channels: int = 1) -> Tensor:
    """A map of the studio [R, 2 R, C]."""
    return torch.from_numpy(studio(grid(rows)))[..., None].repeat(1, 1, channels)


def normals(count: int) -> Tensor:
    """Unit vectors spread evenly over the sphere [N, 3]."""
    number = np.arange(count) + 0.5
    z, angle = 1 - 2 * number / count, number * math.pi * (3 - math.sqrt(5))
    radius = np.sqrt(1 - z * z)
    return torch.from_numpy(np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1))
