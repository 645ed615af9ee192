"""Mesh and camera of a capture, found without its photographs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from matest import load_capture
from matest.capture.viewpoint import Viewpoint, load_viewpoint
from tests.captures import CENTRE, RADIUS, SHAPE, refusal, sphere_folder, sphere_normals

RENDERS = Path(__file__).parents[2] / "renders"


def misplaced(seen: Viewpoint) -> float:
    """Largest distance, in pixels, between a pixel's centre and where the camera has its position."""
    surface = seen.surface
    assert surface.positions is not None
    width = surface.shape[1]
    centres = np.stack([surface.pixels % width, surface.pixels // width], axis=1) + 0.5
    return float(np.abs(seen.camera.project(surface.shape, surface.positions.double().numpy()) - centres).max())


def test_the_surface_is_that_of_the_capture_and_the_camera_sees_it_so():
    seen, there = load_viewpoint(RENDERS / "vase", (256, 192)), load_capture(RENDERS / "vase").scene.surface
    np.testing.assert_array_equal(seen.surface.pixels, there.pixels)
    np.testing.assert_array_equal(seen.surface.normals, there.normals)
    assert seen.mesh is seen.surface.mesh
    assert misplaced(seen) < 1e-4


def test_a_sphere_gets_a_mesh_and_the_camera_that_sees_it_at_its_circle(tmp_path):
    seen = load_viewpoint(sphere_folder(tmp_path).save(), SHAPE)
    assert misplaced(seen) < 1e-4
    np.testing.assert_allclose(seen.camera.project(SHAPE, np.zeros((1, 3)))[0], CENTRE, atol=1e-4)
    np.testing.assert_allclose(seen.camera.project(SHAPE, np.array([[1.0, 0, 0]]))[0, 0], CENTRE[0] + RADIUS, atol=1e-4)


def test_the_mesh_of_a_sphere_is_closed_and_faces_outward(tmp_path):
    mesh = load_viewpoint(sphere_folder(tmp_path).save(), SHAPE).mesh
    triangles = mesh.triangles
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    assert (np.einsum("ij,ij->i", normals, triangles.mean(axis=1)) > 0).all()
    assert 0.5 * np.linalg.norm(normals, axis=1).sum() == pytest.approx(4 * np.pi, rel=5e-4)
    assert mesh.convex


def test_a_normal_map_has_no_mesh(tmp_path):
    folder = sphere_folder(tmp_path)
    folder.put("normals.npy", sphere_normals())
    folder.tables["geometry"] = {"normals": "normals.npy"}
    message = refusal(lambda: load_viewpoint(folder.save(), SHAPE))
    assert "capture.toml: the object's shape is a normal map" in message
    assert "textures need a mesh" in message
