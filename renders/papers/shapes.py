"""The bodies that the papers photograph and render, as meshes: y is up, about 2 units high."""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.interpolate import PchipInterpolator
from trimesh.transformations import rotation_matrix

# Outlines from foot to lip, heights and radii. Oren & Nayar's clay vase is nearly a cylinder.
CLAY = (
    (-1.0, -0.97, -0.9, -0.6, -0.2, 0.2, 0.5, 0.7, 0.8, 0.88, 0.95, 1.0),
    (0.36, 0.40, 0.43, 0.54, 0.62, 0.60, 0.48, 0.335, 0.30, 0.31, 0.36, 0.40),
)
# Cook & Torrance's vase is slender in foot and neck, and open.
METAL = (
    (-1.0, -0.97, -0.9, -0.78, -0.5, -0.1, 0.25, 0.5, 0.68, 0.8, 0.92, 1.0),
    (0.34, 0.36, 0.30, 0.24, 0.40, 0.58, 0.54, 0.36, 0.24, 0.23, 0.31, 0.42),
)
WALL = 0.03  # thickness of the open vase's wall


def _revolved(outline: np.ndarray, sections: int) -> trimesh.Trimesh:
    """The surface that an outline [n, 2] of radius and height sweeps about the y axis."""
    mesh = trimesh.creation.revolve(outline, sections=sections)
    # trimesh revolves about z.
    mesh.apply_transform(rotation_matrix(-np.pi / 2, [1, 0, 0]))
    return mesh


def _profile(outline: tuple[tuple[float, ...], ...], rings: int) -> np.ndarray:
    """A smooth outline through its points: radius and height [rings, 2]."""
    height = np.linspace(outline[0][0], outline[0][-1], rings)
    return np.stack([PchipInterpolator(*outline)(height), height], axis=1)


def clay_vase(rings: int = 72, sections: int = 96) -> trimesh.Trimesh:
    """Oren & Nayar's figures 1, 12, 13 and 15: closed at the lip."""
    profile = _profile(CLAY, rings)
    return _revolved(np.concatenate([[[0, CLAY[0][0]]], profile, [[0, CLAY[0][-1]]]]), sections)


def open_vase(rings: int = 44, sections: int = 56) -> trimesh.Trimesh:
    """Cook & Torrance's figures 6 and 7: hollow from the lip to the widest place."""
    profile = _profile(METAL, rings)
    inside = profile[profile[:, 1] > -0.1][::-3] - [WALL, 0]
    return _revolved(np.concatenate([[[0, -1]], profile, inside, [[0, inside[-1, 1]]]]), sections)


def cylinder() -> trimesh.Trimesh:
    """The cylindrical block of Oren & Nayar's figure 15."""
    return _revolved(np.array([[0, -0.8], [0.6, -0.8], [0.6, 0.8], [0, 0.8]]), 96)


def cube() -> trimesh.Trimesh:
    """The cube of Oren & Nayar's figure 15, turned so that the viewer sees three faces."""
    mesh = trimesh.creation.box((1.2, 1.2, 1.2))
    mesh.apply_transform(rotation_matrix(np.radians(32), [0, 1, 0]))
    return mesh


def link(rings: int = 24, sections: int = 40) -> trimesh.Trimesh:
    """A link of a watch band: a bar with rounded edges and ends, a superellipsoid |x/a|⁴ + |y/b|⁴ + |z/c|⁴ = 1."""
    mesh = trimesh.creation.uv_sphere(count=(rings, sections))
    mesh.vertices /= (mesh.vertices**4).sum(axis=1, keepdims=True) ** 0.25
    mesh.vertices *= (1.0, 0.42, 0.3)
    return mesh


def ply(mesh: trimesh.Trimesh) -> bytes:
    """The mesh as a binary PLY; its coordinates rounded, so that the same libraries give the same bits."""
    mesh.vertices = mesh.vertices.round(7)
    return mesh.export(file_type="ply")
