"""Texture coordinates of a mesh: those of its file where every texel is one place on it, or unwrapped by xatlas.

Textures have S×S texels; the upper row is at v = 1. Texel centres lie half a texel from the edge.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from matest.errors import InputError
from matest.scene.mesh import Mesh
from matest.workers import in_threads

# Share of texels on which faces may lie above each other: those on the edges between two.
_SHARED_EDGES = 0.01
# Share of the surface's area that may have no area in the texture.
_WITHOUT_TEXELS = 0.01
# How far texture coordinates may lie outside the square, which files round.
_OUTSIDE = 1e-4
# Texels along a side at which a mesh is unwrapped.
_UNWRAP_RESOLUTION = 1024
# Texels between charts there.
_GAP = 8
# Texels a side at which texture coordinates are judged.
_JUDGED = 512
# Share of a texel by which rays pass its centre, which may lie on an edge between faces.
_NUDGE = (1.3e-3, 0.7e-3)
# Rays that are cast at a time.
_AT_ONCE = 1 << 15


@dataclass(frozen=True, eq=False)
class Texels:
    """Places on a mesh that T of the texels of an S×S texture show.

    Attributes:
        size: S.
        places: flat row-major indices, ascending [T].
        faces: triangle of each [T].
        shares: barycentric coordinates in it [T, 3].
    """

    size: int
    places: np.ndarray
    faces: np.ndarray
    shares: np.ndarray

    def __len__(self) -> int:
        return len(self.places)

    def mixed(self, corners: np.ndarray, index: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Values at some of the texels [n, C] of values at the corners of triangles [F, 3, C]."""
        return np.einsum("tk,tkc->tc", self.shares[index], corners[self.faces[index]])


@dataclass(frozen=True, eq=False)
class Atlas:
    """A mesh with texture coordinates in which every texel is one place on it.

    Attributes:
        mesh: in world units.
        corner_uv: texture coordinates of the corners of the faces, v upward, in [0, 1] [F, 3, 2].
        origin: where they come from, as a clause.
    """

    mesh: Mesh
    corner_uv: np.ndarray
    origin: str

    @cached_property
    def area(self) -> np.ndarray:
        """Of the faces, in square world units [F]."""
        triangles = self.mesh.triangles
        return 0.5 * np.linalg.norm(
            np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1
        )

    def resolution(self, width: float) -> float:
        """Texels a side at which a texel is as wide as `width` in world units."""
        return float(np.sqrt(self.area.sum() / _uv_area(self.corner_uv).sum()) / width)

    def texels(self, size: int) -> Texels:
        """The texels of a texture of size×size whose centres lie in a face."""
        places, faces = _cast(_flat(self.corner_uv), size, from_below=False)
        return Texels(size, places, faces, _barycentric(self.corner_uv[faces], _centres(size, places)))

    def texel_area(self, texels: Texels) -> np.ndarray:
        """Area of the surface that each texel stands for, in square world units [T]."""
        counts = np.bincount(texels.faces, minlength=len(self.area))
        return (self.area / np.maximum(counts, 1))[texels.faces]

    @cached_property
    def corners(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices that have one position, normal and texture coordinate [V, 8], and the faces of them [F, 3]."""
        normals = self.mesh.corner_normals
        length = np.linalg.norm(normals, axis=2, keepdims=True)
        corners = np.concatenate([self.mesh.triangles, normals / np.where(length > 0, length, 1), self.corner_uv], -1)
        rows = corners.reshape(-1, 8).astype(np.float32)
        # As bytes, which sort faster than rows do.
        _, first, inverse = np.unique(rows.view("V32")[:, 0], return_index=True, return_inverse=True)
        return rows[first], inverse.reshape(-1, 3)

    def save(self, path: Path) -> None:
        """Write the mesh with normals and texture coordinates as OBJ.

        Raises:
            OSError: the file cannot be written.
        """
        vertices, faces = self.corners
        with path.open("w", encoding="ascii") as file:
            file.write("# A mesh with texture coordinates, by matest.\n")
            for word, columns in (("v", vertices[:, :3]), ("vt", vertices[:, 6:]), ("vn", vertices[:, 3:6])):
                np.savetxt(file, columns, fmt=f"{word}{' %.9g' * columns.shape[1]}")
            np.savetxt(file, np.repeat(faces + 1, 3, axis=1), fmt=f"f{' %d/%d/%d' * 3}")


def atlas_of(mesh: Mesh, path: str) -> Atlas:
    """The mesh with texture coordinates of its own, or where they do not serve, unwrapped.

    Args:
        mesh: in world units.
        path: that a refusal names.

    Raises:
        InputError: it must be unwrapped, and xatlas is not installed.
    """
    fault = "the mesh has no texture coordinates" if mesh.corner_uv is None else _fault(mesh)
    if not fault:
        assert mesh.corner_uv is not None
        return Atlas(mesh, mesh.corner_uv.clip(0, 1), "texture coordinates of the mesh")
    return Atlas(mesh, _unwrapped(mesh, path, fault), f"{fault}: unwrapped by xatlas")


def _fault(mesh: Mesh) -> str:
    """What is wrong with a mesh's own texture coordinates, as a clause; empty where a texel is one place on it."""
    uv = mesh.corner_uv
    assert uv is not None
    if uv.min() < -_OUTSIDE or uv.max() > 1 + _OUTSIDE:
        return "the texture coordinates of the mesh leave the square from 0 to 1"
    triangles = mesh.triangles
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    flat = _uv_area(uv) <= 1e-6 * _uv_area(uv).mean()
    if area[flat].sum() > _WITHOUT_TEXELS * area.sum():
        return "the texture coordinates of the mesh leave a part of it without texels"
    flattened = _flat(uv)
    above, below = (_cast(flattened, _JUDGED, from_below=side) for side in (False, True))
    if len(above[0]) != len(below[0]) or np.mean(above[1] != below[1]) > _SHARED_EDGES:
        return "parts of the mesh share texture coordinates"
    return ""


def _unwrapped(mesh: Mesh, path: str, fault: str) -> np.ndarray:
    """Texture coordinates of the corners by xatlas [F, 3, 2].

    Raises:
        InputError: xatlas is not installed.
    """
    try:
        import xatlas
    except ImportError:
        raise InputError(
            f'{path}: {fault}, and xatlas, which unwraps it, is not installed: pip install "matest-brdf[uv]".'
        ) from None
    atlas = xatlas.Atlas()
    atlas.add_mesh(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32))
    options = xatlas.PackOptions()
    options.padding, options.resolution = _GAP, _UNWRAP_RESOLUTION
    atlas.generate(pack_options=options)
    _, faces, uv = atlas[0]
    # Width and height are each scaled to 1; texels shall be square.
    uv = uv * np.array([atlas.width, atlas.height]) / max(atlas.width, atlas.height)
    return uv[faces].astype(float)


def _uv_area(uv: np.ndarray) -> np.ndarray:
    """Of faces in the texture, whose whole is 1 [F]."""
    sides = uv[:, 1:] - uv[:, :1]
    return 0.5 * np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])


def _flat(uv: np.ndarray) -> Mesh:
    """The faces as they lie in the texture, one above the other."""
    height = np.linspace(0, 1, len(uv))
    points = np.concatenate([uv, np.broadcast_to(height[:, None, None], (*uv.shape[:2], 1))], axis=2)
    return Mesh(points.reshape(-1, 3), np.arange(3 * len(uv)).reshape(-1, 3))


def _cast(flat: Mesh, size: int, *, from_below: bool) -> tuple[np.ndarray, np.ndarray]:
    """Flat indices of the texels whose centres lie in a face, and the face that is nearest from one side [T] each."""

    def part(first: int) -> np.ndarray:
        places = np.arange(first, min(first + _AT_ONCE, size * size))
        centres = _centres(size, places) + np.array(_NUDGE) / size
        origins = np.concatenate([centres, np.full((len(centres), 1), -1.0 if from_below else 2.0)], axis=1)
        return flat.first_faces(origins, np.broadcast_to([0, 0, 1.0 if from_below else -1.0], origins.shape))

    faces = np.concatenate(list(in_threads(part, range(0, size * size, _AT_ONCE))))
    places = np.flatnonzero(faces >= 0)
    return places, faces[places]


def _centres(size: int, places: np.ndarray) -> np.ndarray:
    """Texture coordinates of the centres of texels [n, 2]."""
    rows = places // size
    return np.stack([(places - rows * size + 0.5) / size, 1 - (rows + 0.5) / size], axis=1)


def _barycentric(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Barycentric coordinates of points [n, 2] in triangles [n, 3, 2], [n, 3]."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = points - corners[:, 0]
    area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    area = np.where(area == 0, np.inf, area)
    second = (p[:, 0] * b[:, 1] - p[:, 1] * b[:, 0]) / area
    third = (a[:, 0] * p[:, 1] - a[:, 1] * p[:, 0]) / area
    shares = np.stack([1 - second - third, second, third], axis=1).clip(0, 1)
    return shares / shares.sum(axis=1, keepdims=True)
