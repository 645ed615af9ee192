"""Triangle meshes: reading them and casting rays at them (trimesh with Embree)."""

from __future__ import annotations

import logging
from functools import cached_property
from pathlib import Path

import numpy as np

from matest.errors import InputError

# trimesh logs the tracebacks of what shapes do not need, such as a missing texture; without a handler they are printed.
logging.getLogger("trimesh").addHandler(logging.NullHandler())

# Most faces of a mesh that is tested for convexity: the hull of more takes longer than shadow rays.
_MAX_HULL_FACES = 50_000
# Share of its hull's volume that a convex mesh may lack: rounding of its vertices.
_CONVEX_TOLERANCE = 1e-4
# Largest angle between two faces (rad) whose normals are averaged: sharper edges are edges of the object.
_SMOOTH_ANGLE = np.deg2rad(45)


class Mesh:
    """A triangle mesh with smooth normals that many rays can be cast at.

    Args:
        vertices: [V, 3].
        faces: vertex indices [F, 3].
        normals: of the vertices [V, 3], as a file gives them; None: averaged over the faces around each vertex,
            weighted by angle, but not across edges sharper than 45°.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, normals: np.ndarray | None = None) -> None:
        import trimesh

        # Merging vertices keeps the faces and their order.
        self._mesh = trimesh.Trimesh(vertices, faces, process=True)
        self._file_normals = None if normals is None else normals[faces]

    @classmethod
    def load(cls, path: Path) -> Mesh:
        """Read any file that trimesh reads; several objects become one mesh.

        Raises:
            InputError: unreadable, or without triangles.
        """
        import trimesh

        try:
            scene = trimesh.load_scene(path, process=False)
            mesh = scene.to_mesh()
        except Exception as error:  # trimesh passes on whatever its many parsers raise
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
        return cls(np.asarray(mesh.vertices), np.asarray(mesh.faces), _normals_of_file(scene))

    @cached_property
    def _corner_normals(self) -> np.ndarray:
        """A normal for every corner of every face, [F, 3, 3]."""
        if self._file_normals is not None:
            return self._file_normals
        from scipy.sparse import coo_matrix
        from scipy.sparse.csgraph import connected_components

        mesh = self._mesh
        smooth = mesh.face_adjacency_angles < _SMOOTH_ANGLE
        pairs, edges = mesh.face_adjacency[smooth], mesh.face_adjacency_edges[smooth]
        # Corners (3·face + index in the face) of two faces on a smooth edge share their normal at both of its vertices.
        corners = [
            3 * pairs[:, side] + (mesh.faces[pairs[:, side]] == edges[:, end, None]).argmax(axis=1)
            for end in (0, 1)
            for side in (0, 1)
        ]
        rows, columns = np.concatenate(corners[0::2]), np.concatenate(corners[1::2])
        size = 3 * len(mesh.faces)
        _, group = connected_components(coo_matrix((np.ones(len(rows)), (rows, columns)), (size, size)), directed=False)
        weighted = mesh.face_angles[:, :, None] * mesh.face_normals[:, None, :]
        sums = np.stack([np.bincount(group, weighted[..., axis].ravel()) for axis in range(3)], axis=1)
        return sums[group].reshape(-1, 3, 3)

    @cached_property
    def convex(self) -> bool:
        """A convex body cannot shadow itself: its shadow rays need not be cast.

        Its volume is compared with that of its convex hull. A mesh of many faces counts as not convex.
        """
        mesh = self._mesh
        if len(mesh.faces) > _MAX_HULL_FACES or not mesh.is_watertight:
            return False
        return bool(mesh.volume >= (1 - _CONVEX_TOLERANCE) * mesh.convex_hull.volume)

    @cached_property
    def extent(self) -> float:
        """Length of the bounding box's diagonal."""
        return float(self._mesh.scale)

    @property
    def bounds(self) -> np.ndarray:
        """Lowest and highest corner, [2, 3]."""
        return np.asarray(self._mesh.bounds)

    def nearest_depth(self, direction: np.ndarray) -> float:
        """Smallest coordinate of a vertex along a unit vector [3]."""
        return float((self._mesh.vertices @ direction).min())

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

    def blocked(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Whether each ray meets any triangle."""
        return np.asarray(self._rays.intersects_any(origins, directions))

    def interpolated_normals(self, faces: np.ndarray, positions: np.ndarray) -> np.ndarray:
        """Unit normals [N, 3], smooth-shaded: normals of the corners weighted by barycentric coordinates."""
        import trimesh

        weights = trimesh.triangles.points_to_barycentric(self._mesh.triangles[faces], positions)
        normals = np.einsum("nk,nkj->nj", weights.clip(0, 1), self._corner_normals[faces])
        return normals / np.linalg.norm(normals, axis=1, keepdims=True)

    def face_normals(self, faces: np.ndarray) -> np.ndarray:
        return np.asarray(self._mesh.face_normals[faces])

    @cached_property
    def _rays(self):  # type: ignore[no-untyped-def]
        from trimesh.ray.ray_pyembree import RayMeshIntersector

        return RayMeshIntersector(self._mesh)


def _normals_of_file(scene) -> np.ndarray | None:  # type: ignore[no-untyped-def]
    """Vertex normals stored in the file, or None.

    trimesh keeps them in the cache of a single geometry, and drops them when it joins several.
    """
    geometries = list(scene.geometry.values())
    if len(geometries) != 1 or "vertex_normals" not in geometries[0]._cache:
        return None
    nodes = scene.graph.nodes_geometry
    transform = scene.graph.get(nodes[0])[0]
    normals = np.asarray(geometries[0].vertex_normals, dtype=float)
    if len(nodes) != 1 or not np.allclose(transform, np.eye(4)) or not np.isfinite(normals).all():
        return None
    return normals
