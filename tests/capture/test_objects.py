"""Several objects before one camera: their tables, and where they stand."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest
import trimesh

from matest.capture.objects import object_faults, objects_mesh
from matest.capture.schema import CaptureFile, ObjectTable, Transform
from matest.errors import InputError, refuse
from tests.captures import refusal

BALL = {"name": "ball", "shape": "sphere", "radius": 0.5}
FLAT = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]]
MIRROR = [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
# A quarter turn about z and a shift.
TURNED = [[0, -1, 0, 2], [1, 0, 0, 3], [0, 0, 1, 4], [0, 0, 0, 1]]


def file_of(*objects: dict, **tables: object) -> CaptureFile:
    return msgspec.convert({"object": list(objects), "image": [{}], **tables}, CaptureFile)


@pytest.mark.parametrize(
    ("objects", "expected"),
    [
        ([BALL, BALL], "two objects have the name 'ball'"),
        ([BALL, BALL | {"name": "Ball"}], "two objects have the name 'Ball'"),
        ([BALL | {"name": "a/b"}], "object 0: its name is also that of a folder; got 'a/b'"),
        ([BALL | {"name": ".."}], "its name is also that of a folder"),
        ([{"name": "x"}], "object 'x': needs one of mesh and shape"),
        ([BALL | {"mesh": "x.ply"}], "needs one of mesh and shape"),
        ([{"name": "x", "shape": "sphere"}], "a sphere needs a radius"),
        ([BALL | {"transform": TURNED}], "a sphere has position and radius"),
        ([{"name": "x", "mesh": "x.ply", "radius": 1.0}], "a radius is that of shape = 'sphere'"),
        ([{"name": "x", "mesh": "x.ply", "position": [0, 0, 1], "transform": TURNED}], "leave out position"),
        ([{"name": "x", "mesh": "x.ply", "transform": FLAT}], "neither flatten nor mirror"),
        ([{"name": "x", "mesh": "x.ply", "transform": MIRROR}], "neither flatten nor mirror"),
        ([BALL | {"name": f"{number}"} for number in range(256)], "at most 255 objects; got 256"),
    ],
)
def test_objects_that_make_no_sense_are_refused_in_one_sentence(objects: list[dict], expected: str) -> None:
    message = refusal(lambda: refuse("capture.toml", object_faults(file_of(*objects))))
    assert expected in message


def test_geometry_beside_objects_is_refused() -> None:
    tables = file_of(BALL, geometry={"mesh": "x.ply"})
    with pytest.raises(InputError, match=r"\[geometry\] is that of one object"):
        refuse("capture.toml", object_faults(tables))


def test_meshes_stand_where_their_transform_puts_them(tmp_path: Path) -> None:
    box = trimesh.creation.box([2.0, 4.0, 6.0])
    box.export(tmp_path / "box.ply")
    tables = [
        ObjectTable("box", mesh="box.ply", transform=msgspec.convert(TURNED, Transform)),
        ObjectTable("ball", shape="sphere", position=(0.0, 10.0, 0.0), radius=0.5),
    ]
    mesh, objects = objects_mesh(tables, lambda name, _: tmp_path / name)
    corners = mesh.triangles[objects == 0].reshape(-1, 3)
    np.testing.assert_allclose([corners.min(0), corners.max(0)], [[0, 2, 1], [4, 4, 7]], atol=1e-6)
    ball = mesh.triangles[objects == 1].reshape(-1, 3) - (0.0, 10.0, 0.0)
    np.testing.assert_allclose(np.linalg.norm(ball, axis=1), 0.5, rtol=1e-6)
    normals = mesh.corner_normals[objects == 1].reshape(-1, 3)
    np.testing.assert_allclose(normals / np.linalg.norm(normals, axis=1, keepdims=True), ball / 0.5, atol=1e-6)


def test_a_stretched_mesh_has_the_normals_of_the_stretched_shape(tmp_path: Path) -> None:
    trimesh.creation.icosphere(subdivisions=4).export(tmp_path / "ball.ply")
    stretched = ((3.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    mesh, _ = objects_mesh([ObjectTable("x", mesh="ball.ply", transform=stretched)], lambda name, _: tmp_path / name)
    normals = mesh.corner_normals.reshape(-1, 3)
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    # The gradient of x²/9 + y² + z².
    gradient = mesh.triangles.reshape(-1, 3) / (9, 1, 1)
    gradient /= np.linalg.norm(gradient, axis=1, keepdims=True)
    # Normals of the ball are averages over facets of 0.07 rad.
    assert np.abs(normals - gradient).max() < 0.01
