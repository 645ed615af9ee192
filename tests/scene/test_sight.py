"""Geometry from barycentric coordinates against trimesh's own rays, and its precision."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

from matest.scene import Camera, Mesh, Surface
from matest.scene.sight import index_type
from matest.scene.surface import from_mesh

SHAPE = (90, 120)


def vase() -> trimesh.Trimesh:
    heights = np.linspace(-1, 1, 30)
    radii = 0.5 + 0.2 * np.cos(4 * heights)
    outline = np.concatenate([[[0, -1]], np.stack([radii, heights], axis=1), [[0, 1]]])
    return trimesh.creation.revolve(outline, sections=40)


def holed() -> trimesh.Trimesh:
    ball = trimesh.creation.icosphere(4)
    keep = np.random.default_rng(3).random(len(ball.faces)) < 0.9
    return trimesh.Trimesh(ball.vertices, ball.faces[keep])


MESHES = {"vase": vase(), "cube": trimesh.creation.box((1.0, 1.2, 0.9)), "holed": holed()}
CAMERAS = {
    "orthographic": Camera(position=(2, 1, 3), target=(0.1, 0, 0), height=2.5),
    "perspective": Camera(position=(2, 1, 3), target=(0.1, 0, 0), fov_y=0.6),
    "distorted": Camera(
        position=(2, 1, 3), matrix=((150, 0, 61), (0, 149, 44), (0, 0, 1)), distortion=(-0.1, 0.02, 1e-3, -1e-3)
    ),
}


def reference(mesh: Mesh, solid: trimesh.Trimesh, camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels, positions and normals by trimesh's rays, planes and barycentric coordinates."""
    origins, directions = camera.rays(SHAPE, np.arange(SHAPE[0] * SHAPE[1]))
    if camera.orthographic:
        origins = origins - 10 * directions
    faces = RayMeshIntersector(solid).intersects_first(origins, directions)
    pixels = np.flatnonzero(faces >= 0)
    faces, origins, directions = faces[pixels], origins[pixels], directions[pixels]
    plane = solid.face_normals[faces]
    height = ((solid.triangles[faces, 0] - origins) * plane).sum(axis=1)
    positions = origins + (height / (directions * plane).sum(axis=1))[:, None] * directions
    weights = trimesh.triangles.points_to_barycentric(solid.triangles[faces], positions)
    normals = np.einsum("nk,nkj->nj", weights.clip(0, 1), mesh.corner_normals[faces])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    seen = (normals * directions).sum(axis=1) < 0
    return pixels[seen], positions[seen], normals[seen]


@pytest.fixture(params=MESHES)
def solid(request) -> trimesh.Trimesh:
    return MESHES[request.param]


@pytest.fixture(params=CAMERAS)
def camera(request) -> Camera:
    return CAMERAS[request.param]


def test_what_a_pixel_sees_is_what_its_ray_meets(solid, camera):
    mesh = Mesh(solid.vertices, solid.faces)
    pixels, positions, normals = reference(mesh, solid, camera)
    surface = from_mesh(mesh, camera, SHAPE)
    assert len(pixels) > 1000
    np.testing.assert_array_equal(surface.pixels, pixels)
    # Single precision lets a ray pass its triangle by 1e-7 of the extent.
    np.testing.assert_allclose(surface.positions.numpy(), positions, atol=1e-6)
    np.testing.assert_allclose(surface.normals.numpy(), normals, atol=1e-6)
    assert np.median(np.abs(surface.positions.numpy() - positions)) < 1e-14
    assert np.median(np.abs(surface.normals.numpy() - normals)) < 1e-13


def test_single_precision_keeps_a_ten_thousandth_of_a_pixel(solid, camera):
    mesh = Mesh(solid.vertices, solid.faces)
    exact, single = from_mesh(mesh, camera, SHAPE), from_mesh(mesh, camera, SHAPE, None, np.float32)
    np.testing.assert_array_equal(single.pixels, exact.pixels)
    np.testing.assert_array_equal(single.rim, exact.rim)
    distance = np.linalg.norm(exact.positions.numpy() - np.array(camera.position), axis=1)
    pixel = camera.footprint(SHAPE, distance)
    error = np.linalg.norm(single.positions.double().numpy() - exact.positions.numpy(), axis=1)
    assert (error < 1e-4 * pixel).all()
    np.testing.assert_allclose(single.normals.double(), exact.normals, rtol=0, atol=6e-8)


def held(surface: Surface) -> int:
    """Bytes of the arrays that a surface holds."""
    values = [value.numpy() if hasattr(value, "numpy") else value for value in vars(surface).values()]
    arrays = [value for value in values if isinstance(value, np.ndarray)]
    return sum({array.ctypes.data: array.nbytes for array in arrays}.values())


def test_a_pixel_holds_33_bytes_of_geometry(solid, camera):
    surface = from_mesh(Mesh(solid.vertices, solid.faces), camera, SHAPE, None, np.float32)
    surface.toward_viewer()
    surface.normals_as(surface.normals.dtype)
    assert held(surface) <= 33 * len(surface) + 100


def test_positions_far_from_the_origin_stay_double():
    away = np.array([5e5, 4e6, 100.0])
    solid = MESHES["vase"].copy().apply_translation(away)
    mesh = Mesh(solid.vertices, solid.faces)
    moved = Camera((*away[:2], 105.0), tuple(away), height=2.5)
    surface = from_mesh(mesh, moved, SHAPE, None, np.float32)
    assert surface.positions.numpy().dtype == np.float64
    assert surface.normals.numpy().dtype == np.float32


def test_indices_take_32_bits_until_an_image_needs_more():
    assert index_type((46_340, 46_340)) == np.int32
    assert index_type((46_341, 46_342)) == np.int64
