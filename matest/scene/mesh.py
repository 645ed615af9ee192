"""Triangle meshes: reading them and casting rays at them (trimesh with Embree)."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np

from matest.errors import InputError


class Mesh:
    """A triangle mesh with smooth vertex normals, made for casting many rays at."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        import trimesh

        self._mesh = trimesh.Trimesh(vertices, faces, process=True)

    @classmethod
    def load(cls, path: Path) -> Mesh:
        """Read anything trimesh reads; scenes are joined into one mesh.

        Raises:
            InputError: unreadable, or without triangles.
        """
        import trimesh

        try:
            mesh = trimesh.load_mesh(path)
        except (ValueError, OSError, KeyError, IndexError, NotImplementedError, TypeError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise InputError(
                f"{path}: expected a triangle mesh that trimesh reads (PLY, OBJ, STL, GLB); got '{reason}'. Export the "
                "mesh again."
            ) from None
        if not len(getattr(mesh, "faces", ())) or not np.isfinite(mesh.vertices).all():
            raise InputError(
                f"{path}: expected a mesh with triangles and finite vertices; got "
                f"{len(getattr(mesh, 'faces', ()))} triangles. Export the surface, not only points or lines."
            )
        return cls(np.asarray(mesh.vertices), np.asarray(mesh.faces))

    @cached_property
    def convex(self) -> bool:
        """A convex body cannot shadow itself: its shadow rays need not be cast."""
        return bool(self._mesh.is_watertight and self._mesh.is_convex)

    @cached_property
    def extent(self) -> float:
        """Length of the bounding box's diagonal."""
        return float(self._mesh.scale)

    @property
    def bounds(self) -> np.ndarray:
        """Lowest and highest corner, [2, 3]."""
        return np.asarray(self._mesh.bounds)

    def first_hits(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Index of the first triangle along each ray (−1: none) and the distance to it (infinite: none).

        Embree finds the triangle in single precision; the distance is computed here in double.
        """
        faces = self._rays.intersects_first(origins, directions)
        distance = np.full(len(origins), np.inf)
        hit = faces >= 0
        normal = self._mesh.face_normals[faces[hit]]
        corner = self._mesh.triangles[faces[hit], 0]
        toward = np.einsum("ij,ij->i", directions[hit], normal)
        distance[hit] = np.einsum("ij,ij->i", corner - origins[hit], normal) / np.where(toward == 0, -1e-12, toward)
        return faces, distance

    def interpolated_normals(self, faces: np.ndarray, positions: np.ndarray) -> np.ndarray:
        """Unit normals [N, 3], smooth-shaded: vertex normals weighted by barycentric coordinates."""
        import trimesh

        weights = trimesh.triangles.points_to_barycentric(self._mesh.triangles[faces], positions)
        normals = np.einsum("nk,nkj->nj", weights.clip(0, 1), self._mesh.vertex_normals[self._mesh.faces[faces]])
        return normals / np.linalg.norm(normals, axis=1, keepdims=True)

    def face_normals(self, faces: np.ndarray) -> np.ndarray:
        return np.asarray(self._mesh.face_normals[faces])

    @cached_property
    def _rays(self):  # type: ignore[no-untyped-def]
        from trimesh.ray.ray_pyembree import RayMeshIntersector

        return RayMeshIntersector(self._mesh)
