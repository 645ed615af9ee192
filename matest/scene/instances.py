"""Objects of a file that stand below each other, or at several places: how many faces they have, and where they are."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from trimesh import Scene

# Bytes of a face in memory: three indices.
_FACE_BYTES = 24
# Bytes of faces that any file may have.
_SMALL = 64 << 20
# Most bytes of faces for each byte of a file: of a scan without instances they are four, of a forest fifty.
_TIGHTEST = 100


def check_instances(scene: Scene, file_bytes: int) -> None:
    """Refuse a file whose objects stand at so many places that they would fill the memory.

    Args:
        scene: as trimesh reads it.
        file_bytes: of the file.

    Raises:
        ValueError: there are too many faces for the file's size.
    """
    faces = sum(
        len(nodes) * len(getattr(scene.geometry[name], "faces", ()))
        for name, nodes in scene.graph.geometry_nodes.items()
        if name in scene.geometry
    )
    if faces * _FACE_BYTES > max(_SMALL, _TIGHTEST * file_bytes):
        raise ValueError(f"its objects stand at so many places that they have {faces:,} faces")


def flatten(scene: Scene) -> None:
    """Put every object directly below the root: of deep ones trimesh takes a time as the cube of the depth.

    Raises:
        ValueError: an object is below itself.
    """
    from trimesh.scene.transforms import SceneGraph

    graph = scene.graph
    flat = SceneGraph(base_frame=graph.base_frame)
    world: dict[Hashable, np.ndarray] = {graph.base_frame: np.eye(4)}
    parents, edges = graph.transforms.parents, graph.transforms.edge_data
    for geometry, nodes in graph.geometry_nodes.items():
        for node in nodes:
            for below in reversed(_unknown(node, parents, world)):
                step = edges[parents[below], below].get("matrix", np.eye(4))
                world[below] = world[parents[below]] @ step
            flat.update(frame_to=node, matrix=world[node], geometry=geometry)
    scene.graph = flat


def _unknown(
    node: Hashable, parents: Mapping[Hashable, Hashable], world: Mapping[Hashable, np.ndarray]
) -> list[Hashable]:
    """A node and those above it whose place is not known yet, upward.

    Raises:
        ValueError: a node is above itself, or below nothing.
    """
    path: dict[Hashable, None] = {}
    while node not in world:
        if node in path or node not in parents:
            raise ValueError("its objects stand below themselves")
        path[node] = None
        node = parents[node]
    return [*path]
