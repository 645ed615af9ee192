"""Objects of a file that stand below each other, or at many places."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from matest.scene.instances import check_instances, flatten
from matest.scene.mesh import Mesh
from tests.captures import refusal


def with_nodes(path: Path, nodes: list[dict[str, Any]], roots: list[int], subdivisions: int = 0) -> Path:
    """A GLB of one ball, the mesh 0, that stands where the nodes say."""
    whole = trimesh.creation.icosphere(subdivisions=subdivisions).export(file_type="glb")
    (length,) = struct.unpack_from("<I", whole, 12)
    content = json.loads(whole[20 : 20 + length]) | {"nodes": nodes, "scenes": [{"nodes": roots}]}
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    rest = whole[20 + length :]
    head = struct.pack("<4sII", b"glTF", 2, 20 + len(text) + len(rest)) + struct.pack("<I4s", len(text), b"JSON")
    path.write_bytes(head + text + rest)
    return path


def test_a_thousand_objects_below_each_other_are_where_they_are(tmp_path: Path) -> None:
    count, step = 1000, 0.25
    nodes = [{"mesh": 0, "translation": [step, 0, 0], "children": [k + 1]} for k in range(count)]
    del nodes[-1]["children"]
    mesh = Mesh.load(with_nodes(tmp_path / "a.glb", nodes, [0]))
    assert len(mesh.faces) == 20 * count
    np.testing.assert_allclose(mesh.bounds[:, 0].sum() / 2, step * (count + 1) / 2, rtol=1e-6)


def test_turns_and_scales_of_objects_above_hold(tmp_path: Path) -> None:
    half = 0.5**0.5
    nodes = [
        {"rotation": [0, 0, half, half], "scale": [2, 2, 2], "children": [1]},
        {"mesh": 0, "translation": [3, 0, 0]},
    ]
    mesh = Mesh.load(with_nodes(tmp_path / "a.glb", nodes, [0], subdivisions=2))
    # Moved along x, made twice as large, and turned from x to y.
    np.testing.assert_allclose(mesh.bounds.mean(axis=0), [0, 6, 0], atol=1e-5)
    np.testing.assert_allclose(np.ptp(mesh.bounds, axis=0), 4, rtol=0.02)


def test_an_object_below_itself_is_refused() -> None:
    scene = trimesh.Scene([trimesh.creation.box()])
    (node,) = scene.graph.nodes_geometry
    scene.graph.transforms.parents.update({node: "above", "above": node})
    with pytest.raises(ValueError, match="below themselves"):
        flatten(scene)


def test_objects_at_so_many_places_that_they_fill_the_memory_are_refused(tmp_path: Path) -> None:
    nodes = [{"mesh": 0} for _ in range(3000)]
    path = with_nodes(tmp_path / "a.glb", nodes, [*range(3000)], subdivisions=4)
    # 3000 × 5120 faces of 24 bytes are 370 MB; the file has 0.2 MB.
    message = refusal(lambda: Mesh.load(path))
    assert "15,360,000 faces" in message
    assert str(path) in message


def test_a_large_scan_is_not_refused() -> None:
    scene = trimesh.Scene([trimesh.creation.icosphere(subdivisions=3)])
    check_instances(scene, 20)
