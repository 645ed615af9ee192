from __future__ import annotations

import cv2
import numpy as np
import pytest

from matest.scene import Camera
from tests.captures import refusal

POSE = {"position": (2.0, -3.0, 4.0), "target": (0.5, 0.2, -0.1), "up": (0.1, 1.0, 0.3)}
SHAPE = (41, 61)
MATRIX = ((70.0, 0.0, 29.0), (0.0, 66.0, 22.5), (0.0, 0.0, 1.0))


def all_rays(camera: Camera, shape: tuple[int, int] = SHAPE) -> tuple[np.ndarray, np.ndarray]:
    """Origins and directions, H×W×3."""
    origins, directions = camera.rays(shape, np.arange(shape[0] * shape[1]))
    return origins.reshape(*shape, 3), directions.reshape(*shape, 3)


def project(camera: Camera, points: np.ndarray) -> np.ndarray:
    """Pixel coordinates (x, y) of world points by OpenCV, whose camera looks along +z with y down."""
    forward = np.subtract(camera.target, camera.position)
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, camera.up)
    right = right / np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    translation = -rotation @ np.array(camera.position)
    pixels, _ = cv2.projectPoints(
        points, cv2.Rodrigues(rotation)[0], translation, camera.pixel_matrix(SHAPE), np.array(camera.distortion)
    )
    return pixels[:, 0]


def test_orthographic_pixel_centres_lie_half_a_pixel_from_the_corner():
    origins, directions = all_rays(Camera(position=(0, 0, 5), height=2.0), (4, 6))
    np.testing.assert_allclose(origins[0, 0], [-1.25, 0.75, 5])
    np.testing.assert_allclose(origins[3, 5], [1.25, -0.75, 5])
    np.testing.assert_allclose(directions, np.broadcast_to([0, 0, -1.0], (4, 6, 3)), atol=1e-15)


def test_orthographic_height_is_the_extent_of_the_image_in_world_units():
    origins, _ = all_rays(Camera(**POSE, height=3.5))
    between_first_and_last = np.linalg.norm(origins[0, 0] - origins[-1, 0])
    assert between_first_and_last * SHAPE[0] / (SHAPE[0] - 1) == pytest.approx(3.5, rel=1e-12)
    assert np.linalg.norm(origins[0, 0] - origins[0, 1]) == pytest.approx(3.5 / SHAPE[0], rel=1e-12)


@pytest.mark.parametrize("projection", [{"height": 2.0}, {"fov_y": 0.6}])
def test_the_central_ray_passes_through_the_target(projection):
    origins, directions = all_rays(Camera(**POSE, **projection))
    centre = SHAPE[0] // 2, SHAPE[1] // 2
    np.testing.assert_allclose(origins[centre], POSE["position"], atol=1e-12)
    toward = np.subtract(POSE["target"], POSE["position"])
    np.testing.assert_allclose(directions[centre], toward / np.linalg.norm(toward), atol=1e-12)


@pytest.mark.parametrize("projection", [{"height": 2.0}, {"fov_y": 0.6}])
def test_columns_grow_to_the_right_and_rows_downward(projection):
    origins, directions = all_rays(Camera(**POSE, **projection))
    seen = origins + 5 * directions
    forward = np.subtract(POSE["target"], POSE["position"])
    right = np.cross(forward, POSE["up"])
    upward = np.cross(right, forward)
    assert (seen[20, 31] - seen[20, 30]) @ right > 0
    assert (seen[20, 31] - seen[20, 30]) @ upward == pytest.approx(0, abs=1e-12)
    assert (seen[21, 30] - seen[20, 30]) @ upward < 0
    assert (seen[21, 30] - seen[20, 30]) @ right == pytest.approx(0, abs=1e-12)


def test_fov_is_the_angle_between_the_upper_and_lower_edge():
    camera = Camera(position=(0, 0, 0), target=(0, 0, -1), fov_y=0.8)
    _, directions = all_rays(camera)
    tangent = directions[:, 30, 1] / -directions[:, 30, 2]
    rows = np.arange(SHAPE[0]) + 0.5
    np.testing.assert_allclose(tangent, (1 - 2 * rows / SHAPE[0]) * np.tan(0.4), atol=1e-14)


def test_fov_and_its_matrix_give_the_same_rays():
    focal = SHAPE[0] / 2 / np.tan(0.3)
    matrix = ((focal, 0, SHAPE[1] / 2), (0, focal, SHAPE[0] / 2), (0, 0, 1))
    by_angle, by_matrix = all_rays(Camera(**POSE, fov_y=0.6)), all_rays(Camera(**POSE, matrix=matrix))
    np.testing.assert_allclose(by_angle[1], by_matrix[1], atol=1e-14)
    np.testing.assert_array_equal(by_angle[0], by_matrix[0])


@pytest.mark.parametrize(
    "distortion",
    [
        (),
        (-0.25, 0.08, 0.002, -0.003),
        (0.2, -0.05, 0.001, 0.002, 0.01),
        (-0.2, 0.05, 1e-3, 2e-3, 0.0, 0.01, 0.02, 0.0),
    ],
    ids=["none", "barrel", "pincushion", "rational"],
)
def test_opencv_projects_points_on_a_ray_back_to_its_pixel_centre(distortion, rng):
    camera = Camera(**POSE, matrix=MATRIX, distortion=distortion)
    pixels = np.arange(SHAPE[0] * SHAPE[1])
    origins, directions = camera.rays(SHAPE, pixels)
    points = origins + rng.uniform(1, 9, (len(pixels), 1)) * directions
    centres = np.stack([pixels % SHAPE[1] + 0.5, pixels // SHAPE[1] + 0.5], axis=1)
    np.testing.assert_allclose(project(camera, points), centres, atol=1e-6)


def test_directions_are_unit_vectors():
    for camera in (Camera(**POSE, height=1.0), Camera(**POSE, matrix=MATRIX, distortion=(-0.2, 0.1, 0, 0))):
        np.testing.assert_allclose(np.linalg.norm(all_rays(camera)[1], axis=-1), 1, atol=1e-14)


@pytest.mark.parametrize("projection", [{"height": 2.0}, {"fov_y": 0.6}])
def test_footprint_is_the_distance_between_neighbouring_pixels(projection):
    camera = Camera(**POSE, **projection)
    origins, directions = all_rays(camera)
    depth = 7.0
    seen = (origins + depth * directions)[[19, 20, 21], 30]
    width = np.linalg.norm(np.diff(seen, axis=0), axis=1)
    np.testing.assert_allclose(camera.footprint(SHAPE, np.full(2, depth)), width, rtol=1e-3)


@pytest.mark.parametrize(
    "pose",
    [
        {"position": (1.0, 2.0, 3.0), "target": (1.0, 2.0, 3.0)},
        {"position": (0.0, 5.0, 0.0), "up": (0.0, 1.0, 0.0)},
        {"position": (0.0, 5.0, 0.0), "up": (0.0, -2.0, 0.0)},
        {"position": (0.1, 0.2, 0.3), "up": (1.0, 2.0, 3.0)},
        {"up": (0.0, 0.0, 0.0)},
        {"position": (float("nan"), 0.0, 1.0)},
        {"target": (float("inf"), 0.0, 1.0)},
    ],
    ids=["position is target", "up along view", "up against view", "parallel but for rounding", "no up", "NaN", "inf"],
)
def test_a_pose_without_direction_is_refused(pose):
    message = refusal(lambda: Camera(**pose, height=1.0))
    assert "position" in message
    assert "up" in message


@pytest.mark.parametrize(
    "projection",
    [{"fov_y": 0.6}, {"matrix": MATRIX}, {"matrix": MATRIX, "distortion": (-0.2, 0.05, 0.001, -0.002)}],
)
def test_points_appear_where_opencv_has_them(projection):
    camera = Camera(**POSE, **projection)
    points = np.random.default_rng(0).uniform(-1, 1, (50, 3))
    expected = project(camera, points)
    np.testing.assert_allclose(camera.project(SHAPE, points), expected, atol=1e-9)


@pytest.mark.parametrize("projection", [{"height": 2.0}, {"fov_y": 0.6}])
def test_a_point_on_the_ray_of_a_pixel_appears_at_its_centre(projection):
    camera = Camera(**POSE, **projection)
    pixels = np.arange(0, SHAPE[0] * SHAPE[1], 7)
    origins, directions = camera.rays(SHAPE, pixels)
    places = camera.project(SHAPE, origins + 3.0 * directions)
    np.testing.assert_allclose(places, np.stack([pixels % SHAPE[1], pixels // SHAPE[1]], axis=1) + 0.5, atol=1e-9)
    toward = camera.toward(origins + 3.0 * directions)
    np.testing.assert_allclose(toward / np.linalg.norm(toward, axis=1, keepdims=True), -directions, atol=1e-9)


def test_points_behind_a_perspective_camera_appear_nowhere():
    places = Camera(position=(0, 0, 5), fov_y=0.6).project(SHAPE, np.array([[0.0, 0, 6], [0, 0, 4]]))
    assert np.isnan(places[0]).all()
    np.testing.assert_allclose(places[1], [SHAPE[1] / 2, SHAPE[0] / 2])
