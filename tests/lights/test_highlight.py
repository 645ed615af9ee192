from __future__ import annotations

import math

import numpy as np
import pytest

from matest.lights.highlight import candidates, choose
from matest.lights.sphere import MirrorSphere
from matest.scene.camera import Camera
from tests.captures import refusal
from tests.lights.mirror_ball import Ball, Lamp, unit

BALL = Ball(160, (80.0, 80.0, 70.0))
SPHERE = MirrorSphere.from_circle(BALL.circle, (160, 160), Camera())
LAMP = Lamp(unit(0.3, 0.2, 0.9), math.radians(3), 30)


def middle(light: Lamp) -> np.ndarray:
    """Where the ball shows a light (x, y): the normal lies halfway to the viewer."""
    normal = np.array(unit(*np.add(light.direction, (0, 0, 1))))
    return np.array([80 + 70 * normal[0], 80 - 70 * normal[1]])


@pytest.mark.parametrize("radiance", [0.5, 0.85])
def test_a_larger_white_patch_does_not_win(radiance: float) -> None:
    patch = Lamp(unit(-0.4, 0.5, 0.8), math.radians(14), radiance)
    chosen = choose([candidates(BALL.photograph([patch, LAMP]), SPHERE)], ["a.png"])[0]
    np.testing.assert_allclose(chosen.place, middle(LAMP), atol=0.3)


def test_a_saturated_patch_that_does_not_move_is_not_the_light() -> None:
    window = Lamp(unit(-0.5, 0.5, 0.7), math.radians(8), 20)
    lamps = [Lamp(unit(x, 0.2, 0.9), math.radians(3), 30) for x in (0.5, 0.1, -0.1, 0.3)]
    images = [BALL.photograph([window, lamp]) for lamp in lamps]
    for chosen, lamp in zip(choose([candidates(image, SPHERE) for image in images], range(4)), lamps, strict=True):
        np.testing.assert_allclose(chosen.place, middle(lamp), atol=0.3)


def test_a_light_that_stands_still_in_all_images_is_the_light() -> None:
    found = [candidates(BALL.photograph([LAMP]), SPHERE)] * 3
    for chosen in choose(found, range(3)):
        np.testing.assert_allclose(chosen.place, middle(LAMP), atol=0.3)


def test_a_saturated_streak_does_not_draw_the_light_along() -> None:
    image = BALL.photograph([Lamp(LAMP.direction, math.radians(8), 30)])
    x, y = middle(LAMP)
    image[round(y) : round(y) + 30, round(x) - 1 : round(x) + 2] = 1
    chosen = choose([candidates(image, SPHERE)], ["a.png"])[0]
    # The centroid of everything saturated lies 3 pixels lower.
    np.testing.assert_allclose(chosen.place, middle(LAMP), atol=0.6)


def test_what_the_mask_hides_is_not_the_light() -> None:
    other = Lamp(unit(-0.4, 0.5, 0.8), math.radians(6), 30)
    image, mask = BALL.photograph([other, LAMP]), np.ones((160, 160))
    x, y = middle(other).round().astype(int)
    mask[y - 20 : y + 20, x - 20 : x + 20] = 0
    chosen = choose([candidates(image, SPHERE, mask)], ["a.png"])[0]
    np.testing.assert_allclose(chosen.place, middle(LAMP), atol=0.3)


def test_the_error_of_a_highlight_grows_with_noise_and_falls_with_its_size() -> None:
    def variance(half_angle: float, noise: float) -> float:
        lamp = Lamp(LAMP.direction, math.radians(half_angle), 0.9)
        image = BALL.photograph([lamp], noise=noise)
        return float(np.trace(candidates(image, SPHERE).patches[0].covariance))

    assert variance(6, 0.05) > 2 * variance(6, 0.0)
    assert variance(3, 0.01) > variance(12, 0.01)


@pytest.mark.parametrize(
    ("lamps", "words"),
    [
        ([], "b.png: no highlight on the sphere"),
        ([LAMP, Lamp(unit(-0.4, 0.5, 0.8), math.radians(3), 30)], "b.png: two highlights may be the light, at ("),
        ([Lamp(unit(0.3, 0.9, -3.0), math.radians(8), 30)], "b.png: the highlight at ("),
        ([Lamp(unit(0.3, 0.2, 0.9), math.radians(80), 1)], "b.png: no highlight on the sphere: no small place"),
    ],
    ids=["dark", "two", "rim", "bright room"],
)
def test_an_image_without_one_whole_highlight_is_refused(lamps: list[Lamp], words: str) -> None:
    images = [BALL.photograph([LAMP]), BALL.photograph(lamps)]
    message = refusal(lambda: choose([candidates(image, SPHERE) for image in images], ["a.png", "b.png"]))
    assert message.startswith(words)


def test_a_matte_ball_has_patches_with_finite_places_at_most() -> None:
    """Noise on a bright ball makes peaks that hardly stand out of what is around."""
    image = BALL.photograph([], background=0.5, noise=0.1)
    for patch in candidates(image, SPHERE).patches:
        assert np.isfinite(patch.place).all()
        assert np.isfinite(patch.covariance).all()
