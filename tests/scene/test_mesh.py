from __future__ import annotations

import os
import struct
import subprocess
import sys

import numpy as np
import pytest
import trimesh

from matest.scene import Camera, Mesh
from matest.scene.surface import from_mesh
from tests.captures import refusal

EXTENTS = np.array([2.0, 1.0, 0.5])
BALL = trimesh.creation.icosphere(3)


def as_mesh(*parts: trimesh.Trimesh) -> Mesh:
    joined = trimesh.util.concatenate(parts)
    return Mesh(joined.vertices, joined.faces)


def random_rays(rng: np.random.Generator, count: int, spread: float) -> tuple[np.ndarray, np.ndarray]:
    """Rays from a sphere of radius 5 to random points within `spread` of the origin."""
    origins = rng.normal(size=(count, 3))
    origins *= 5 / np.linalg.norm(origins, axis=1, keepdims=True)
    directions = rng.uniform(-spread, spread, (count, 3)) - origins
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


def slab_distance(origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Distance to the box of `EXTENTS` around the origin by the slab method, infinite where missed."""
    first, second = (-EXTENTS / 2 - origins) / directions, (EXTENTS / 2 - origins) / directions
    enter, leave = np.minimum(first, second).max(axis=1), np.maximum(first, second).min(axis=1)
    return np.where(enter < leave, enter, np.inf)


def first_hits(mesh: Mesh, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first triangle along each ray and the distance to its plane, infinite where there is none."""
    faces = mesh.first_faces(origins, directions)
    normals, corners = mesh.face_normals(faces), mesh.triangles[faces, 0]
    distance = ((corners - origins) * normals).sum(axis=1) / (directions * normals).sum(axis=1)
    return faces, np.where(faces < 0, np.inf, distance)


def test_a_missing_texture_of_a_mesh_is_no_concern(tmp_path):
    file = tmp_path / "ball.ply"
    BALL.export(file, encoding="ascii")
    text = file.read_text("utf-8")
    file.write_text(text.replace("element vertex", "comment TextureFile scan.jpg\nelement vertex"), "utf-8")
    command = f"from matest.scene import Mesh; from pathlib import Path; Mesh.load(Path({str(file)!r}))"
    done = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_first_hits_on_a_box_agree_with_the_slab_method(rng):
    origins, directions = random_rays(rng, 20_000, 1.0)
    faces, distance = first_hits(as_mesh(trimesh.creation.box(EXTENTS)), origins, directions)
    expected = slab_distance(origins, directions)
    # Embree decides in single precision which side of an edge a ray passes; no ray of this seed is that near to one.
    np.testing.assert_array_equal(faces >= 0, np.isfinite(expected))
    assert 0.2 < np.isfinite(expected).mean() < 0.9
    np.testing.assert_allclose(distance, expected, rtol=1e-9)


def test_first_hits_on_an_icosphere_are_within_its_sagitta_of_the_sphere(rng):
    origins, _ = random_rays(rng, 5_000, 1.0)
    ball = trimesh.creation.icosphere(5)
    _, distance = first_hits(as_mesh(ball), origins, -origins / 5)
    edge = ball.edges_unique_length.max()
    sagitta = 1 - np.sqrt(1 - edge**2 / 3)
    assert sagitta < 3e-4 < edge / 10
    assert (distance >= 4 - 1e-9).all()
    assert (distance <= 4 + sagitta).all()


def test_rays_that_pass_a_sphere_by_hit_nothing(rng):
    origins, directions = random_rays(rng, 5_000, 3.0)
    impact = np.linalg.norm(np.cross(origins, directions), axis=1)
    faces, distance = first_hits(as_mesh(trimesh.creation.icosphere(5)), origins, directions)
    assert (faces[impact > 1] == -1).all()
    assert np.isinf(distance[impact > 1]).all()
    assert (faces[impact < 0.999] >= 0).all()


def test_the_nearer_of_two_surfaces_is_hit():
    low, high = trimesh.creation.box((2, 2, 0.1)), trimesh.creation.box((1, 1, 0.1))
    high.apply_translation((0, 0, 1))
    origins = np.array([[0.1, 0.2, 5.0], [0.8, 0.7, 5.0]])
    _, distance = first_hits(as_mesh(low, high), origins, np.broadcast_to([0.0, 0.0, -1.0], (2, 3)))
    np.testing.assert_allclose(distance, [3.95, 4.95], rtol=1e-12)


def test_a_ray_is_blocked_by_what_lies_within_its_reach(rng):
    origins, directions = random_rays(rng, 5_000, 1.0)
    box = as_mesh(trimesh.creation.box(EXTENTS))
    expected = slab_distance(origins, directions)
    np.testing.assert_array_equal(box.blocked(origins, directions), np.isfinite(expected))
    reach = rng.uniform(3, 7, len(origins))
    near = np.abs(reach - expected) < 1e-5
    np.testing.assert_array_equal(box.blocked(origins, directions, reach)[~near], (expected < reach)[~near])


def test_smooth_normals_of_an_icosphere_are_those_of_the_sphere():
    mesh = as_mesh(trimesh.creation.icosphere(5))
    surface = from_mesh(mesh, Camera(position=(1.0, 2.0, 4.5), fov_y=0.4), (120, 120))
    positions, smooth, flat = surface.positions.numpy(), surface.normals.numpy(), mesh.face_normals(surface.faces)
    exact = positions / np.linalg.norm(positions, axis=1, keepdims=True)
    np.testing.assert_allclose(np.linalg.norm(smooth, axis=1), 1, atol=1e-14)
    error = np.linalg.norm(smooth - exact, axis=1)
    # The vertex normals, means over irregular fans of triangles, are off by up to 0.075° at this subdivision.
    assert error.max() < np.radians(0.1)
    assert np.sqrt(np.mean(error**2)) < 0.05 * np.sqrt(np.mean(np.linalg.norm(flat - exact, axis=1) ** 2))


@pytest.mark.parametrize(
    ("mesh", "convex"),
    [
        (as_mesh(BALL), True),
        (as_mesh(trimesh.creation.box(EXTENTS)), True),
        (as_mesh(trimesh.creation.torus(1.0, 0.3)), False),
        (as_mesh(trimesh.creation.box(EXTENTS), trimesh.creation.box(EXTENTS).apply_translation((0, 0, 2))), False),
        (Mesh(BALL.vertices, BALL.faces[BALL.triangles_center[:, 2] < 0]), False),
    ],
    ids=["icosphere", "box", "torus", "two boxes", "open bowl"],
)
def test_only_closed_convex_bodies_are_convex(mesh, convex):
    assert mesh.convex is convex


def test_extent_is_the_diagonal_of_the_bounds():
    mesh = as_mesh(trimesh.creation.box(EXTENTS))
    np.testing.assert_allclose(mesh.bounds, [-EXTENTS / 2, EXTENTS / 2])
    assert mesh.extent == pytest.approx(np.linalg.norm(EXTENTS), rel=1e-14)


@pytest.mark.parametrize("suffix", ["ply", "obj", "stl", "glb", "off"])
def test_a_written_mesh_is_read_back(tmp_path, suffix):
    path = tmp_path / f"ball.{suffix}"
    ball = trimesh.creation.icosphere(2)
    ball.export(path)
    mesh = Mesh.load(path)
    np.testing.assert_allclose(mesh.bounds, ball.bounds, atol=1e-6)
    assert mesh.convex  # corners shared by triangles were joined


def test_the_parts_of_a_scene_are_joined(tmp_path):
    path = tmp_path / "two.glb"
    parts = [trimesh.creation.box((1, 1, 1)).apply_translation((x, 0, 0)) for x in (-3, 3)]
    trimesh.Scene(parts).export(path)
    np.testing.assert_allclose(Mesh.load(path).bounds, [[-3.5, -0.5, -0.5], [3.5, 0.5, 0.5]], atol=1e-6)


@pytest.mark.parametrize("suffix", ["ply", "obj", "stl", "glb", "off"])
def test_a_truncated_mesh_is_refused(tmp_path, suffix):
    path = tmp_path / f"cut.{suffix}"
    trimesh.creation.icosphere(2).export(path)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    assert str(path) in refusal(lambda: Mesh.load(path))


@pytest.mark.parametrize("name", ["empty.ply", "empty.obj", "empty.stl", "empty.glb", "empty.vase"])
def test_an_empty_or_unknown_file_is_refused(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(b"")
    assert str(path) in refusal(lambda: Mesh.load(path))


def test_points_without_triangles_are_refused(tmp_path):
    path = tmp_path / "cloud.ply"
    trimesh.PointCloud(np.eye(3)).export(path)
    message = refusal(lambda: Mesh.load(path))
    assert str(path) in message
    assert "0 triangles" in message


def test_vertices_that_are_not_finite_are_refused(tmp_path):
    path = tmp_path / "nan.stl"
    triangles = np.zeros((1, 4, 3), np.float32)
    triangles[0, 1:] = [[0, 0, 0], [1, 0, np.nan], [0, 1, 0]]
    path.write_bytes(bytes(80) + struct.pack("<I", 1) + triangles.tobytes() + bytes(2))
    assert str(path) in refusal(lambda: Mesh.load(path))


@pytest.mark.parametrize("suffix", ["obj", "ply", "glb"])
def test_texture_coordinates_of_a_file_are_those_of_the_corners(tmp_path, suffix):
    box = trimesh.creation.icosphere(1)
    uv = np.random.default_rng(0).random((len(box.vertices), 2)).astype(np.float32)
    path = tmp_path / f"ball.{suffix}"
    trimesh.Trimesh(box.vertices, box.faces, visual=trimesh.visual.TextureVisuals(uv=uv), process=False).export(path)
    np.testing.assert_allclose(Mesh.load(path).corner_uv, uv[box.faces], atol=1e-6)


def test_meshes_without_texture_coordinates_and_scenes_of_several_have_none(tmp_path):
    trimesh.creation.icosphere(1).export(tmp_path / "ball.ply")
    assert Mesh.load(tmp_path / "ball.ply").corner_uv is None
    visual = trimesh.visual.TextureVisuals(uv=np.zeros((8, 2)))
    parts = [trimesh.Trimesh(*_cube(x), visual=visual.copy(), process=False) for x in (-3, 3)]
    trimesh.Scene(parts).export(tmp_path / "two.glb")
    assert Mesh.load(tmp_path / "two.glb").corner_uv is None


def _cube(x: float) -> tuple[np.ndarray, np.ndarray]:
    cube = trimesh.creation.box((1, 1, 1)).apply_translation((x, 0, 0))
    return cube.vertices, cube.faces


TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def a_ply(face: tuple[int, int, int]) -> str:
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    faces = "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    return f"{head}{faces}0 0 0\n1 0 0\n0 1 0\n3 {' '.join(map(str, face))}\n"


@pytest.mark.parametrize("vertex", [3, 10**6, 2**31 - 1, -1])
def test_a_face_of_a_vertex_that_is_not_there_is_refused(tmp_path, vertex):
    path = tmp_path / "mesh.ply"
    path.write_text(a_ply((0, 1, vertex)))
    assert f"expected faces of its 3 vertices; one names the vertex {vertex}" in refusal(lambda: Mesh.load(path))


def test_a_face_of_a_vertex_that_is_not_there_is_refused_in_glb(tmp_path):
    content = bytearray(trimesh.creation.box().export(file_type="glb"))
    place = content.index(np.uint32([1, 3, 0]).tobytes())
    content[place : place + 4] = struct.pack("<I", 10**8)
    path = tmp_path / "mesh.glb"
    path.write_bytes(bytes(content))
    assert "one names the vertex 100000000" in refusal(lambda: Mesh.load(path))


def test_a_mesh_with_comments_in_latin_1_is_read(tmp_path):
    path = tmp_path / "mesh.obj"
    path.write_bytes(f"# Müller\n{TRIANGLE}f 1 2 3\n".encode("latin-1"))
    assert Mesh.load(path).triangles.shape == (1, 3, 3)


@pytest.mark.parametrize("reference", ["pipe.mtl", "../secret.mtl", "/etc/hostname", "no.mtl"])
def test_a_mesh_reads_only_regular_files_beside_it(tmp_path, reference):
    folder = tmp_path / "folder"
    folder.mkdir()
    os.mkfifo(folder / "pipe.mtl")
    (tmp_path / "secret.mtl").write_text("newmtl a\n")
    path = folder / "mesh.obj"
    path.write_text(f"mtllib {reference}\n{TRIANGLE}usemtl a\nf 1 2 3\n")
    assert Mesh.load(path).triangles.shape == (1, 3, 3)


@pytest.mark.parametrize("suffix", [".zip", ".tar.gz"])
def test_an_archive_is_not_unpacked(tmp_path, suffix):
    path = tmp_path / f"mesh{suffix}"
    path.write_bytes(b"PK")
    assert "not an archive" in refusal(lambda: Mesh.load(path))


@pytest.mark.parametrize("unit", [1e-12, 1e-8, 1e8, 1e14])
def test_a_mesh_is_the_same_in_any_unit(tmp_path, unit):
    ball = trimesh.creation.icosphere(subdivisions=1)
    ball.export(tmp_path / "one.stl")
    ball.apply_scale(unit).export(tmp_path / "other.stl")
    one, other = (Mesh.load(tmp_path / f"{name}.stl") for name in ("one", "other"))
    np.testing.assert_array_equal(one.faces, other.faces)
    np.testing.assert_allclose(unit * one.vertices, other.vertices, rtol=1e-6, atol=1e-6 * unit)
    np.testing.assert_allclose(one.corner_normals, other.corner_normals, atol=1e-5)
    assert other.convex
    assert other.extent == pytest.approx(unit * one.extent)
    rays = np.tile([[0.0, 0, -1]], (2, 1))
    hits = other.first_faces(unit * np.array([[0.1, 0.2, 3], [1.5, 0, 3]]), rays)
    assert (hits[0] >= 0, hits[1]) == (True, -1)


def test_a_flat_mesh_is_not_convex(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 3 2 1\n")
    assert not Mesh.load(tmp_path / "a.obj").convex


@pytest.mark.parametrize(
    ("vertices", "says"),
    [
        ("v 0 0\nv 1 0\nv 0 1\n", "three numbers"),
        ("v 0 0 0\nv 1e30 0 0\nv 0 1 0\n", "below 1e+15"),
        ("v 1 2 3\nv 1 2 3\nv 1 2 3\n", "at one place"),
        ("v 0 0 0\nv 1e-40 0 0\nv 0 1e-40 0\n", "1e-40 long"),
    ],
)
def test_vertices_that_are_no_places_are_refused(tmp_path, vertices, says):
    (tmp_path / "a.obj").write_text(vertices + "f 1 2 3\n")
    assert says in refusal(lambda: Mesh.load(tmp_path / "a.obj"))
