"""glTF files: a mesh of one material, with images inside."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from matest.export.atlas import Atlas

# Facets of the sphere that shows a material without textures, from pole to pole and around.
_SPHERE = (32, 64)
# Distance from the axis, radii, below which a vertex is a pole.
_POLE = 1e-6
# WebGL's number for a linear look-up in images.
_LINEAR = 9729
# The same over levels of detail too.
_LINEAR_LEVELS = 9987
# Its number for none beyond the edge.
_CLAMPED = 33071


@dataclass(frozen=True, eq=False)
class Shape:
    """A mesh as glTF has it.

    Attributes:
        positions: [V, 3], float32.
        normals: unit [V, 3], float32.
        uv: texture coordinates, v downward [V, 2], float32; None: it has none.
        triangles: [F, 3], counter-clockwise seen from outside.
        tangents: unit [V, 4], float32, the fourth 1 (bitangent = normal × tangent); None: it has none.
    """

    positions: np.ndarray
    normals: np.ndarray
    uv: np.ndarray | None
    triangles: np.ndarray
    tangents: np.ndarray | None = None

    @classmethod
    def of(cls, atlas: Atlas) -> Shape:
        """The mesh of an atlas."""
        vertices, triangles = atlas.corners
        uv = np.stack([vertices[:, 6], 1 - vertices[:, 7]], axis=1)
        positions, normals = vertices[:, :3].astype("<f4"), vertices[:, 3:6].astype("<f4")
        return cls(positions, normals, uv.astype("<f4"), triangles.astype("<u4"))


def sphere(*, tangents: bool = False) -> Shape:
    """A sphere of unit radius, about y; its tangents, if asked for, go round it."""
    import trimesh

    ball = trimesh.creation.uv_sphere(radius=1.0, count=list(_SPHERE))
    # The normals of a unit sphere are its vertices.
    vertices = (ball.vertices / np.linalg.norm(ball.vertices, axis=1, keepdims=True)).astype("<f4")
    faces = ball.faces.astype("<u2")
    if not tangents:
        return Shape(vertices, vertices, None, faces)
    around = np.stack([vertices[:, 2], np.zeros(len(vertices)), -vertices[:, 0], np.ones(len(vertices))], axis=1)
    length = np.linalg.norm(around[:, :3], axis=1, keepdims=True)
    # At the poles every direction goes round.
    around[:, :3] = np.where(length > _POLE, around[:, :3] / np.maximum(length, _POLE), (1, 0, 0))
    return Shape(vertices, vertices, None, faces, around.astype("<f4"))


def save(pygltflib: Any, material: dict[str, Any], path: Path, shape: Shape, images: Mapping[str, np.ndarray]) -> None:
    """Write a mesh of a material: programs do not read a material that nothing is made of.

    Args:
        pygltflib: the library.
        material: its entry in the file.
        path: a `.glb` or `.gltf` file, which has the images inside.
        shape: the mesh.
        images: of `pbrMetallicRoughness` by their names there, 8 bits [H, W, 3].

    Raises:
        OSError: the file cannot be written.
    """
    g = pygltflib
    blob = _Blob(g)
    small = shape.triangles.dtype.itemsize == 2
    indices = blob.accessor(
        shape.triangles.reshape(-1), g.ELEMENT_ARRAY_BUFFER, g.UNSIGNED_SHORT if small else g.UNSIGNED_INT, g.SCALAR
    )
    positions = blob.accessor(shape.positions, g.ARRAY_BUFFER, g.FLOAT, g.VEC3, bounded=True)
    shared = shape.normals is shape.positions
    normals = positions if shared else blob.accessor(shape.normals, g.ARRAY_BUFFER, g.FLOAT, g.VEC3)
    uv = None if shape.uv is None else blob.accessor(shape.uv, g.ARRAY_BUFFER, g.FLOAT, g.VEC2)
    textures = {name: g.TextureInfo(index=number) for number, name in enumerate(images)}
    tangents = None if shape.tangents is None else blob.accessor(shape.tangents, g.ARRAY_BUFFER, g.FLOAT, g.VEC4)
    attributes = g.Attributes(POSITION=positions, NORMAL=normals, TANGENT=tangents, TEXCOORD_0=uv)
    pictures = [
        g.Image(bufferView=blob.view(_png(image)), mimeType="image/png", name=name) for name, image in images.items()
    ]
    sampler = g.Sampler(magFilter=_LINEAR, minFilter=_LINEAR_LEVELS, wrapS=_CLAMPED, wrapT=_CLAMPED)
    document = g.GLTF2(
        asset=g.Asset(version="2.0", generator="matest"),
        scene=0,
        scenes=[g.Scene(nodes=[0])],
        nodes=[g.Node(mesh=0, name=material["name"])],
        meshes=[g.Mesh(primitives=[g.Primitive(attributes=attributes, indices=indices, material=0)])],
        accessors=blob.accessors,
        bufferViews=blob.views,
        buffers=[g.Buffer(byteLength=len(blob.content))],
        images=pictures,
        samplers=[sampler] if images else [],
        textures=[g.Texture(sampler=0, source=number) for number in range(len(images))],
        materials=[
            g.Material(
                name=material["name"],
                pbrMetallicRoughness=g.PbrMetallicRoughness(**material["pbrMetallicRoughness"], **textures),
                extensions=material["extensions"],
                extras=material["extras"],
                alphaCutoff=None,
            )
        ],
        extensionsUsed=list(material["extensions"]),
    )  # fmt: skip
    document.set_binary_blob(bytes(blob.content))
    if path.suffix.lower() == ".gltf":
        document.convert_buffers(g.BufferFormat.DATAURI)
    document.save(str(path))


class _Blob:
    """The binary part of a file, and what its parts are."""

    def __init__(self, pygltflib: Any) -> None:
        self._g = pygltflib
        self.content = bytearray()
        self.views: list[Any] = []
        self.accessors: list[Any] = []

    def view(self, part: bytes, target: int | None = None) -> int:
        """Append a part, and number it."""
        # Numbers must lie at multiples of their size.
        self.content.extend(bytes(-len(self.content) % 4))
        place = len(self.content)
        self.content.extend(part)
        self.views.append(self._g.BufferView(buffer=0, byteOffset=place, byteLength=len(part), target=target))
        return len(self.views) - 1

    def accessor(self, values: np.ndarray, target: int, kind: int, shape: str, *, bounded: bool = False) -> int:
        """Append numbers [n] or [n, C], and number them."""
        view = self.view(np.ascontiguousarray(values).tobytes(), target)
        bounds = {"min": values.min(0).tolist(), "max": values.max(0).tolist()} if bounded else {}
        accessor = self._g.Accessor(bufferView=view, componentType=kind, count=len(values), type=shape, **bounds)
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def _png(image: np.ndarray) -> bytes:
    import imagecodecs

    return bytes(imagecodecs.png_encode(np.ascontiguousarray(image)))
