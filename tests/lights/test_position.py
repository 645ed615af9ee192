from __future__ import annotations

import math

import numpy as np
import pytest

from matest.lights.directions import Sighting, sight
from matest.lights.highlight import candidates, choose
from matest.lights.position import Placement, intersect
from matest.lights.sphere import MirrorSphere
from matest.scene.camera import Camera
from tests.captures import refusal
from tests.lights.mirror_ball import Ball, Lamp

CAMERA = Camera((0, 0, 0), (0, 0, -1), fov_y=0.5)
# Two balls of this radius, world units, before a perspective camera at the origin.
RADIUS = 0.12
CENTRES = ((-0.15, 0.02, -1.3), (0.15, -0.05, -1.3))
LIGHT = (0.35, 0.4, -0.5)


def seen(ball: Ball, camera: Camera, at: tuple[float, ...], seed: int = 0) -> tuple[Sighting, MirrorSphere]:
    """What a ball shows of a light at a place."""
    sphere = MirrorSphere.from_mask(ball.mask(), camera)
    image = ball.photograph([Lamp(LIGHT, math.radians(2), 5)], at=at, noise=0.003, seed=seed)
    return sight(choose([candidates(image, sphere)], ["image"])[0], sphere), sphere


def test_two_spheres_in_perspective_give_the_position_within_its_error() -> None:
    squares = []
    for seed in range(8):
        light = np.array(LIGHT) + 0.05 * np.random.default_rng(seed).standard_normal(3)
        balls = [Ball(300, fov=0.5, centre=centre, radius=RADIUS) for centre in CENTRES]
        pairs = [seen(ball, CAMERA, tuple(light), seed) for ball in balls]
        position = intersect([one for one, _ in pairs], [sphere for _, sphere in pairs], Placement(RADIUS))
        assert position is not None
        np.testing.assert_allclose(position.point, light, atol=0.03)
        error = position.point - light
        squares.append(error @ np.linalg.solve(position.covariance, error) / 3)
    # 8 lights of 3 coordinates.
    assert 0.4 < math.sqrt(np.mean(squares)) < 1.6


def test_two_spheres_whose_places_are_stated_give_the_position_with_a_distant_camera() -> None:
    """Each ball is traced with its centre at the origin, and the light moved by where it stands."""
    light, places = np.array([0.3, 0.2, 3.0]), np.array([[-0.8, 0.0, 0.0], [0.8, 0.1, 0.0]])
    sightings, spheres = [], []
    for place in places:
        ball = Ball(400, (200.3, 199.8, 180.0), radius=0.5)
        one, sphere = seen(ball, Camera(), tuple(light - place))
        sightings.append(one)
        spheres.append(sphere)
    position = intersect(sightings, spheres, Placement(0.5, places))
    assert position is not None
    np.testing.assert_allclose(position.point, light, atol=0.05)
    assert (np.abs(position.point - light) < 4 * position.std).all()


def test_a_distant_light_has_no_position() -> None:
    balls = [Ball(200, fov=0.5, centre=centre, radius=RADIUS) for centre in CENTRES]
    pairs = [seen(ball, CAMERA, (350.0, 400.0, 800.0)) for ball in balls]
    assert intersect([one for one, _ in pairs], [sphere for _, sphere in pairs], Placement(RADIUS)) is None


@pytest.mark.parametrize(
    ("placement", "cameras", "words"),
    [
        (Placement(-1.0), [CAMERA, CAMERA], "--radius must be positive"),
        (Placement(1.0), [CAMERA], "two spheres or more"),
        (Placement(1.0), [Camera(), Camera()], "--centre X,Y,Z"),
        (Placement(1.0, np.zeros((2, 3))), [CAMERA, CAMERA], "orthographic cameras"),
        (Placement(1.0, np.zeros((3, 3))), [Camera(), Camera()], "expected 2, one for each sphere; got 3"),
    ],
)
def test_spheres_whose_places_are_not_known_are_refused(
    placement: Placement, cameras: list[Camera], words: str
) -> None:
    spheres = [MirrorSphere.from_circle((50.0, 50.0, 40.0), (100, 100), camera) for camera in cameras]
    assert words in refusal(lambda: placement.check(spheres))
