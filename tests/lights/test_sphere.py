from __future__ import annotations

import numpy as np
import pytest

from matest.lights.sphere import MirrorSphere
from matest.scene.camera import Camera
from tests.captures import refusal
from tests.lights.mirror_ball import Ball

CAMERA = Camera((0, 0, 0), (0, 0, -1), fov_y=0.5)


def test_the_outline_in_perspective_gives_where_the_sphere_stands() -> None:
    centre = np.array([0.5, -0.3, -6.0])
    subject = Ball(200, fov=0.5, centre=tuple(centre))
    sphere = MirrorSphere.from_mask(subject.mask(), CAMERA)
    np.testing.assert_allclose(sphere.centre(), centre, atol=0.01)
    assert sphere.distance == pytest.approx(np.linalg.norm(centre), rel=2e-3)


@pytest.mark.parametrize("fov", [None, 0.5], ids=["orthographic", "perspective"])
def test_a_sphere_reflects_as_rays_that_are_traced(fov: float | None) -> None:
    subject = Ball(100, (48.0, 53.0, 40.0), fov=fov, centre=(0.1, 0.2, -5.0))
    sphere = MirrorSphere.from_mask(subject.mask(), Camera() if fov is None else CAMERA)
    x, y = np.random.default_rng(0).uniform(30, 70, (2, 50))
    traced = subject.trace(x, y)
    reflection = sphere.reflect(x, y)
    np.testing.assert_allclose(reflection.normals, traced[1], atol=2e-3)
    np.testing.assert_allclose(reflection.directions, traced[2], atol=4e-3)


def test_directions_follow_the_pose_of_the_camera() -> None:
    """Seen from the right, what the middle of the sphere shows lies to the right."""
    for camera in (Camera((5, 0, 0), (0, 0, 0)), Camera((5, 0, 0), (0, 0, 0), fov_y=0.5)):
        sphere = MirrorSphere.from_circle((50.0, 50.0, 40.0), (100, 100), camera)
        seen = sphere.reflect(np.array([50.0]), np.array([50.0])).directions[0]
        np.testing.assert_allclose(seen, [1, 0, 0], atol=1e-6)


@pytest.mark.parametrize("camera", [Camera(), CAMERA], ids=["orthographic", "perspective"])
def test_what_lies_inside_the_outline_is_what_the_mask_covers(camera: Camera) -> None:
    subject = Ball(100, (48.0, 53.0, 40.0), fov=None if camera.orthographic else 0.5, centre=(0.1, 0.2, -5.0))
    mask = subject.mask()
    sphere = MirrorSphere.from_mask(mask, camera)
    rows, columns = np.indices(mask.shape) + 0.5
    inside = sphere.contains(columns.ravel(), rows.ravel()).reshape(mask.shape)
    clear = (mask == 0) | (mask == 1)
    assert (inside == (mask == 1))[clear].all()


@pytest.mark.parametrize("camera", [Camera(), CAMERA], ids=["orthographic", "perspective"])
def test_a_mask_that_is_no_outline_of_a_sphere_is_refused(camera: Camera) -> None:
    mask = np.zeros((100, 100))
    mask[20:80, 20:80] = 1
    assert "mask's edge is no" in refusal(lambda: MirrorSphere.from_mask(mask, camera))


def test_a_wider_error_of_the_edge_is_a_wider_error_of_the_outline() -> None:
    generator, smooth = np.random.default_rng(1), Ball(120, (60.0, 60.0, 45.0)).mask()
    rough = ((smooth + 0.4 * generator.standard_normal(smooth.shape)) > 0.5).astype(float)
    rough[smooth == 0], rough[smooth == 1] = 0, 1
    exact, coarse = (MirrorSphere.from_mask(mask, CAMERA) for mask in (smooth, rough))
    assert np.trace(coarse.covariance) > 4 * np.trace(exact.covariance)
