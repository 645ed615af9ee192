"""A part of a sphere whose albedo and slope vary smoothly: its textures, and their exact values at any place of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from matest.brdf import Brdf
from matest.estimation.parameter_map import TexelStatus
from matest.export.atlas import Atlas
from matest.export.texture import Coverage, Texture
from matest.export.textured import Textured
from matest.scene import Camera
from matest.scene.mesh import Mesh
from matest.scene.surface import Surface, from_mesh

# Squares along a side of the mesh: normals between its vertices are those of a sphere to 1e-5.
_SQUARES = 96
# Tangent of the angle between the middle of a side and the axis.
_WIDTH = 0.7
# Texels along a side: the maps below are straight between their centres to 1e-5.
_TEXELS = 256
# World units across the image of the camera that looks along the axis, which sees the whole patch.
_HEIGHT = 1.4
# Mean and swing of the maps: of the body's albedo by channel, and of the slope.
_ALBEDO, _ALBEDO_SWING = (0.4, 0.3, 0.2), (0.2, -0.15, 0.1)
_SLOPE, _SLOPE_SWING = 0.15, 0.05
# Standard error of the maps: they are exact.
_STD = 1e-6


@dataclass(frozen=True, eq=False)
class Patch:
    """A mapped material on its mesh, and what a camera sees of it.

    Attributes:
        textured: the material with textures of `diffuse` and `slope`.
        camera: along the axis, orthographic.
        surface: the pixels that it sees.
        material: with the maps' values at every one of them.
    """

    textured: Textured
    camera: Camera
    surface: Surface
    material: Brdf


def patch(material: Brdf, size: int) -> Patch:
    """The patch of a material that has `diffuse` and `slope`, before a camera of size×size pixels."""
    u, v = (part.ravel() for part in np.meshgrid(*2 * [np.linspace(0, 1, _SQUARES + 1)]))
    vertices = np.stack([_WIDTH * (2 * u - 1), _WIDTH * (2 * v - 1), np.ones_like(u)], axis=1)
    vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    corner = np.arange(_SQUARES**2) + np.arange(_SQUARES**2) // _SQUARES
    right, above, both = corner + 1, corner + _SQUARES + 1, corner + _SQUARES + 2
    faces = np.concatenate([np.stack([corner, right, both], axis=1), np.stack([corner, both, above], axis=1)])
    mesh = Mesh(vertices, faces, normals=vertices, uv=np.stack([u, v], axis=1))
    assert mesh.corner_uv is not None
    centres = (np.arange(_TEXELS) + 0.5) / _TEXELS
    maps = {name: _texture(values) for name, values in _maps(*np.meshgrid(centres, centres[::-1])).items()}
    means = {name: torch.from_numpy(each.mean) for name, each in maps.items()}
    textured = Textured(
        material.replace(means), Atlas(mesh, mesh.corner_uv, "texture coordinates of the mesh"), maps,
        Coverage(1.0, 0.0, None),
    )  # fmt: skip
    camera = Camera((0.0, 0.0, 3.0), height=_HEIGHT)
    surface = from_mesh(mesh, camera, (size, size))
    assert surface.positions is not None
    x, y, z = surface.positions.numpy().T
    at_pixels = _maps(*((side / z / _WIDTH + 1) / 2 for side in (x, y)))
    own = material.replace({name: torch.from_numpy(values) for name, values in at_pixels.items()})
    return Patch(textured, camera, surface, own)


def _maps(u: np.ndarray, v: np.ndarray) -> dict[str, np.ndarray]:
    """Values of the maps [..., C] at texture coordinates."""
    along, across = np.sin(2 * np.pi * u)[..., None], np.cos(2 * np.pi * v)[..., None]
    return {"diffuse": _ALBEDO + along * _ALBEDO_SWING, "slope": _SLOPE + _SLOPE_SWING * across}


def _texture(values: np.ndarray) -> Texture:
    """Exact values at all texels [S, S, C]."""
    std = np.full(values.shape, _STD, np.float32)
    status = np.full(values.shape[:2], TexelStatus.DETERMINED, np.uint8)
    return Texture(values.astype(np.float32), std, status, values.mean(axis=(0, 1)))
