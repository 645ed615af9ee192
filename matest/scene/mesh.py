"""Triangle meshes: reading them and casting rays at them (trimesh and Embree)."""

from __future__ import annotations

import io
import logging
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from matest.errors import InputError
from matest.scene.instances import check_instances, flatten

# trimesh logs the tracebacks of what shapes do not need, such as a missing texture; without a handler they are printed.
logging.getLogger("trimesh").addHandler(logging.NullHandler())

# Most faces of a mesh that is tested for convexity: the hull of more takes longer than shadow rays.
_MAX_HULL_FACES = 50_000
# Share of its hull's volume that a convex mesh may lack: rounding of its vertices.
_CONVEX_TOLERANCE = 1e-4
# Largest angle between two faces (rad) whose normals are averaged: sharper edges are edges of the object.
_SMOOTH_ANGLE = np.deg2rad(45)
# Subdivisions of the icosahedron that stands for a sphere: 81,920 facets.
_SUBDIVISIONS = 6
# Suffixes of archives that trimesh would unpack, however large what is in them.
_ARCHIVES = ("zip", "gz", "bz2", "tar", "tgz")
# Suffixes of meshes that are text.
_TEXT = (".obj", ".off")
# Largest coordinate of a vertex: squares of lengths must stay within single precision.
_LARGEST = 1e15
# Extent of a mesh as Embree sees it, so that what it takes for small does not depend on the unit of length.
_EMBREE_EXTENT = 100.0


class Mesh:
    """A triangle mesh with smooth normals that many rays can be cast at.

    Args:
        vertices: [V, 3].
        faces: vertex indices [F, 3].
        normals: of the vertices [V, 3], as a file gives them; None: averaged over the faces around each vertex,
            weighted by angle, but not across edges sharper than 45°.
        uv: texture coordinates of the vertices [V, 2], v upward; None: the mesh has none.
    """

    def __init__(
        self,
        vertices: np.ndarray,
        faces: np.ndarray,
        normals: np.ndarray | None = None,
        uv: np.ndarray | None = None,
    ) -> None:
        import trimesh

        vertices = np.asarray(vertices, dtype=float)
        extent = np.linalg.norm(np.ptp(vertices, axis=0)) if len(vertices) else 0.0
        # trimesh takes lengths for small or equal by fixed measures: it sees a mesh about as large as 1. A power of two
        # changes no digits.
        self._unit = 2.0 ** round(np.log2(extent)) if extent > 0 else 1.0
        # Merging vertices keeps the faces and their order.
        self._mesh = trimesh.Trimesh(vertices / self._unit, faces, process=True)
        self._file_normals = None if normals is None else normals[faces]
        self.corner_uv = None if uv is None else uv[faces]

    @classmethod
    def load(cls, path: Path) -> Mesh:
        """Read any file that trimesh reads; several objects become one mesh.

        Raises:
            InputError: unreadable, or without triangles.
        """
        import trimesh

        kind = path.suffix.lower().removeprefix(".")
        if kind in _ARCHIVES:
            raise InputError(f"{path}: expected a mesh, not an archive; unpack it and give the mesh in it.")
        if not path.is_file():
            raise InputError(f"{path}: no such mesh; put it there or correct its name.")
        # trimesh asks it for files by name, as it asks a mapping.
        resolver: Any = _Beside(path.parent)
        try:
            with _opened(path) as file:
                scene = trimesh.load_scene(file, file_type=kind, resolver=resolver, process=False)
            check_instances(scene, path.stat().st_size)
            flatten(scene)
            mesh = scene.to_mesh()
        except MemoryError:
            raise
        except Exception as error:  # trimesh passes on whatever its many parsers raise
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            if isinstance(error, ImportError):
                reason = f"a damaged file, or one that needs a package: {reason}"
            raise InputError(
                f"{path}: expected a triangle mesh that trimesh reads (PLY, OBJ, STL, GLB); got '{reason}'. Export the "
                "mesh again."
            ) from None
        faces = np.asarray(getattr(mesh, "faces", ()))
        if not len(faces):
            raise InputError(
                f"{path}: expected a mesh with triangles; got 0 triangles. Export the surface, not only points."
            )
        vertices = np.asarray(mesh.vertices)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or not (np.abs(vertices) < _LARGEST).all():
            raise InputError(
                f"{path}: expected vertices of three numbers below {_LARGEST:g}; got others. Export the mesh again."
            )
        if not np.ptp(vertices, axis=0).any():
            raise InputError(f"{path}: all vertices are at one place; export the mesh again.")
        if (extent := float(np.ptp(vertices, axis=0).max())) * _LARGEST < 1:
            # Rays begin further away than single precision holds beside it.
            raise InputError(f"{path}: the mesh is {extent:.2g} long; expected {1 / _LARGEST:g} or more. Scale it.")
        if faces.min() < 0 or faces.max() >= len(mesh.vertices):
            raise InputError(
                f"{path}: expected faces of its {len(mesh.vertices):,} vertices; one names the vertex "
                f"{faces.min() if faces.min() < 0 else faces.max()} (from 0). Export the mesh again."
            )
        return cls(vertices, faces, _normals_of_file(scene), _uv_of_file(scene))

    @classmethod
    def sphere(cls) -> Mesh:
        """The unit sphere about the origin, of facets that lie within 4e-5 of it."""
        import trimesh

        ball = trimesh.creation.icosphere(subdivisions=_SUBDIVISIONS)
        return cls(np.asarray(ball.vertices), np.asarray(ball.faces), np.asarray(ball.vertices))

    @classmethod
    def together(cls, parts: Sequence[Mesh], transforms: Sequence[np.ndarray]) -> Mesh:
        """One mesh of several, whose faces follow each other; normals are not averaged from one to another.

        Args:
            parts: the meshes.
            transforms: [4, 4] of each, from its own coordinates to the common ones.
        """
        vertices, faces, normals, count = [], [], [], 0
        for part, matrix in zip(parts, transforms, strict=True):
            vertices.append(part.vertices @ matrix[:3, :3].T + matrix[:3, 3])
            faces.append(part.faces + count)
            normals.append(part.corner_normals @ np.linalg.inv(matrix[:3, :3]))
            count += len(part.vertices)
        mesh = cls(np.concatenate(vertices), np.concatenate(faces))
        mesh._file_normals = np.concatenate(normals)
        return mesh

    @cached_property
    def corner_normals(self) -> np.ndarray:
        """A normal for every corner of every face, of any length, [F, 3, 3]."""
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
        from scipy.spatial import QhullError

        mesh = self._mesh
        if len(mesh.faces) > _MAX_HULL_FACES or not mesh.is_watertight:
            return False
        try:
            hull = mesh.convex_hull
        except QhullError:
            return False  # it is flat
        return bool(mesh.volume >= (1 - _CONVEX_TOLERANCE) * hull.volume)

    @cached_property
    def extent(self) -> float:
        """Length of the bounding box's diagonal."""
        return self._unit * float(self._mesh.scale)

    @cached_property
    def bounds(self) -> np.ndarray:
        """Lowest and highest corner, [2, 3]."""
        return self._unit * np.asarray(self._mesh.bounds)

    def nearest_depth(self, direction: np.ndarray) -> float:
        """Smallest coordinate of the bounding box along a unit vector [3]."""
        return float((self.bounds * direction).min(axis=0).sum())

    def first_faces(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Index of the first triangle along each ray, −1: none, int32 [n].

        Embree finds it in single precision.

        Args:
            origins: of the rays [n, 3].
            directions: of any length [n, 3].
        """
        return self._embree.run(self._scaled(origins), _single(directions))

    def blocked(self, origins: np.ndarray, directions: np.ndarray, reach: np.ndarray | None = None) -> np.ndarray:
        """Whether each ray meets any triangle, within a distance [n] if given."""
        distances = None if reach is None else _single(reach * self._scale)
        hits = self._embree.run(self._scaled(origins), _single(directions), dists=distances, query="OCCLUDED")
        return np.asarray(hits >= 0)

    @cached_property
    def vertices(self) -> np.ndarray:
        """Positions that faces share [V, 3]."""
        return self._unit * np.asarray(self._mesh.vertices)

    @property
    def faces(self) -> np.ndarray:
        """Indices of the vertices of each triangle [F, 3]."""
        return np.asarray(self._mesh.faces)

    @property
    def triangles(self) -> np.ndarray:
        """Corners of the faces [F, 3, 3]."""
        return self.vertices[self.faces]

    def face_normals(self, faces: np.ndarray) -> np.ndarray:
        return np.asarray(self._mesh.face_normals[faces])

    def _scaled(self, points: np.ndarray) -> np.ndarray:
        """Points in the coordinates that Embree sees: the bounding box at the origin, with a diagonal of 100."""
        return _single((points - self.bounds[0]) * self._scale)

    @property
    def _scale(self) -> float:
        return _EMBREE_EXTENT / self.extent

    def __getstate__(self) -> dict[str, Any]:
        # What traces rays is made again where it is needed.
        return {name: part for name, part in self.__dict__.items() if name != "_embree"}

    @cached_property
    def _embree(self):  # type: ignore[no-untyped-def]
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        scene = EmbreeScene()
        TriangleMesh(scene=scene, vertices=self._scaled(self.vertices), indices=self._mesh.faces.astype(np.int32))
        return scene


class _Beside:
    """Files that a mesh refers to, such as buffers and materials, as trimesh asks for them.

    Only regular files in the folder of the mesh or below are read: others may be devices, or somebody else's.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder.resolve()

    def get(self, name: str) -> bytes:
        path = (self._folder / name.strip()).resolve()
        if not path.is_relative_to(self._folder) or not path.is_file():
            raise FileNotFoundError(f"the file '{name}' that it refers to is not beside it")
        return path.read_bytes()

    def __getitem__(self, name: str) -> bytes:
        return self.get(name)


def _opened(path: Path) -> BinaryIO:
    """The content of a mesh file; text that is no UTF-8 is taken for that of Western Windows."""
    content = path.read_bytes()
    if path.suffix.lower() in _TEXT:
        try:
            content.decode("utf-8")
        except UnicodeDecodeError:
            content = content.decode("cp1252", errors="replace").encode("utf-8")
    return io.BytesIO(content)


def _single(values: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(values, dtype=np.float32)


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


def _uv_of_file(scene) -> np.ndarray | None:  # type: ignore[no-untyped-def]
    """Texture coordinates of a file's vertices, or None; those of several objects may lie on each other."""
    geometries = list(scene.geometry.values())
    if len(geometries) != 1 or len(scene.graph.nodes_geometry) != 1:
        return None
    uv = getattr(geometries[0].visual, "uv", None)
    if uv is None or np.shape(uv) != (len(geometries[0].vertices), 2) or not np.isfinite(uv).all():
        return None
    return np.asarray(uv, dtype=float)
