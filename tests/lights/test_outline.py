from __future__ import annotations

import math

import numpy as np

from matest.lights.outline import find_outline
from matest.scene.circle import circle_through
from tests.lights.mirror_ball import Ball, Lamp, unit

CIRCLE = (120.4, 101.7, 80.3)


def photographs(background: float) -> list[np.ndarray]:
    """A ball of dim surroundings under four lights, on a backdrop that is brighter than it."""
    ball, images = Ball(240, CIRCLE), []
    for number, (x, y) in enumerate([(0.4, 0.1), (-0.3, 0.5), (0.1, -0.4), (-0.5, -0.2)]):
        image = ball.photograph([Lamp(unit(x, y, 0.8), math.radians(4), 3)], background=0.05)
        image = image + background * (1 - ball.mask())
        images.append(image + 0.003 * np.random.default_rng(number).standard_normal(image.shape))
    return images


def test_the_outline_of_a_ball_is_seen_without_a_mask() -> None:
    edge = find_outline(photographs(0.4))
    assert edge is not None
    fit = circle_through(edge)
    np.testing.assert_allclose((*fit.centre, fit.radius), CIRCLE, atol=0.3)


def test_photographs_without_a_circle_have_no_outline() -> None:
    noise = np.random.default_rng(0).uniform(0, 1, (200, 240))
    assert find_outline([noise]) is None
    assert find_outline([np.zeros((200, 240))]) is None
    stripes = np.tile((np.arange(240) // 30 % 2).astype(float), (200, 1))
    assert find_outline([stripes]) is None
