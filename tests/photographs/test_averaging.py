"""What a pixel averages over."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from matest.photographs.averaging import slope_variance
from matest.scene import Camera, Mesh
from matest.scene.surface import from_mesh, from_normals
from tests.captures import sphere_normals, sphere_surface


def in_the_middle(radius: float) -> float:
    """Variance of the slopes within the middle pixel of a sphere, from many points in it."""
    points = (np.arange(64) + 0.5) / 64 - 0.5
    return 2 * float(np.var(np.tan(np.arcsin(points / radius))))


@pytest.mark.parametrize("size", [40, 200])
def test_the_variance_within_a_pixel_is_that_of_many_points_in_it(size: int) -> None:
    # Pixels beside the middle are foreshortened and hold a little more.
    assert 1.0 < slope_variance(sphere_surface(size)) / in_the_middle(0.45 * size) < 1.15


def test_a_mesh_has_the_variance_of_the_shape_that_it_stands_for() -> None:
    ball = trimesh.creation.icosphere(6)
    mesh = from_mesh(Mesh(ball.vertices, ball.faces), Camera(position=(0, 0, 10), height=2 / 0.9), (60, 60))
    assert slope_variance(mesh) == pytest.approx(slope_variance(sphere_surface(60)), rel=0.1)


def test_normals_that_were_measured_and_pixels_without_neighbours_say_nothing() -> None:
    assert slope_variance(from_normals(sphere_normals(), None)) == 0.0
    surface = sphere_surface(24)
    assert slope_variance(surface.take(np.arange(len(surface)) % 2 == 0)) == 0.0
