from __future__ import annotations

import math

import numpy as np
import pytest

from matest.lights.directions import Sighting, sight
from matest.lights.highlight import candidates, choose
from matest.lights.sphere import STATED_STD, MirrorSphere
from matest.scene.camera import Camera
from tests.lights.mirror_ball import Ball, Lamp, degrees_between, unit

# At the origin, along −z.
NEAR_CAMERA = Camera((0, 0, 0), (0, 0, -1), fov_y=0.5)
# Half of the angular width of a lamp, rad.
WIDTH = math.radians(2)


def ball(perspective: bool, size: int, shift: tuple[float, float] = (0.0, 0.0)) -> Ball:
    """A ball that nearly fills a square image, its centre a little off the middle."""
    middle = size / 2
    if perspective:
        return Ball(size, fov=0.5, centre=(0.1 + shift[0] / 50, -0.07 + shift[1] / 50, -4.6))
    return Ball(size, (middle + shift[0], middle + shift[1], 0.46 * size))


def sighting(image: np.ndarray, sphere: MirrorSphere) -> Sighting:
    return sight(choose([candidates(image, sphere)], ["image"])[0], sphere)


def random_light(generator: np.random.Generator) -> tuple[float, ...]:
    return unit(*generator.uniform(-0.7, 0.7, 2), generator.uniform(0.4, 1))


@pytest.mark.parametrize("perspective", [False, True], ids=["orthographic", "perspective"])
@pytest.mark.parametrize("radiance", [0.8, 20.0], ids=["not clipped", "clipped"])
def test_lights_are_found_to_a_twentieth_of_a_degree_beside_a_white_patch(perspective: bool, radiance: float) -> None:
    generator = np.random.default_rng(3)
    subject = ball(perspective, 600, (1.3, -0.4))
    sphere = MirrorSphere.from_mask(subject.mask(), NEAR_CAMERA if perspective else Camera())
    patch = Lamp(unit(-0.5, -0.6, 0.6), math.radians(12), 0.55)
    for _ in range(4):
        light = random_light(generator)
        image = subject.photograph([patch, Lamp(light, WIDTH, radiance)], noise=0.002)
        assert degrees_between(sighting(image, sphere).ray.direction, np.array(light)) < 0.05


def test_an_orthographic_formula_is_degrees_off_on_a_near_ball() -> None:
    light, subject = unit(-0.5, 0.3, 0.7), ball(True, 200)
    image, mask = subject.photograph([Lamp(light, WIDTH, 20)]), subject.mask()
    assert degrees_between(sighting(image, MirrorSphere.from_mask(mask, NEAR_CAMERA)).ray.direction, light) < 0.2
    assert degrees_between(sighting(image, MirrorSphere.from_mask(mask, Camera())).ray.direction, light) > 2


@pytest.mark.parametrize("perspective", [False, True], ids=["orthographic", "perspective"])
def test_errors_scatter_as_their_bars_say(perspective: bool) -> None:
    """With the highlight between pixels, noise and, in one case, a circle that is off by what its covariance says."""
    generator = np.random.default_rng(8)
    squares = []
    for seed in range(60):
        subject, light = ball(perspective, 130, tuple(generator.uniform(-1, 1, 2))), random_light(generator)
        if perspective:
            sphere = MirrorSphere.from_mask(subject.mask(), NEAR_CAMERA)
        else:
            x, y, radius = subject.circle + STATED_STD * generator.standard_normal(3)
            sphere = MirrorSphere.from_circle((x, y, radius), (130, 130), Camera())
        image = subject.photograph([Lamp(light, WIDTH, generator.choice([0.9, 3, 30]))], noise=0.004, seed=seed)
        found = sighting(image, sphere)
        squares.append(np.sum((found.ray.direction - light) ** 2) / 2 / found.variance)
    # 60 lights tell the ratio of standard deviations to 7 %; what saturation hides of the edge is known to a third.
    assert 0.65 < math.sqrt(np.mean(squares)) < 1.35


def test_an_error_of_the_circle_turns_the_light_by_twice_its_angle() -> None:
    """At the middle of the sphere the normal turns by δ/R, and the mirrored direction by twice that."""
    subject = Ball(120, (60.0, 60.0, 50.0))
    image = subject.photograph([Lamp((0.0, 0.0, 1.0), WIDTH, 3)])
    found = sighting(image, MirrorSphere.from_circle(subject.circle, (120, 120), Camera()))
    turns = np.linalg.norm(found.by_outline.direction, axis=1)
    np.testing.assert_allclose(np.sort(turns), [0, 0.5 * 2 / 50, 0.5 * 2 / 50], atol=5e-4)


def test_a_light_at_the_edge_of_a_white_patch_has_a_wider_error_bar_that_holds() -> None:
    subject = ball(False, 200)
    sphere = MirrorSphere.from_mask(subject.mask(), Camera())
    light, patch = unit(0.1, 0.2, 0.9), Lamp(unit(0.1, 0.43, 0.9), math.radians(14), 0.6)
    alone, beside = (
        sighting(subject.photograph([*lamps, Lamp(light, 2 * WIDTH, 0.9)]), sphere) for lamps in ([], [patch])
    )
    assert beside.variance > 4 * alone.variance
    for found in (alone, beside):
        assert np.linalg.norm(found.ray.direction - light) < 3 * math.sqrt(2 * found.variance)
