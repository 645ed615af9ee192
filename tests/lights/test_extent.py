"""Solid angles of discs of light, as photographs of mirror balls show them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from matest.lights.directions import sight
from matest.lights.extent import Extent, combine, common_extent, measure_extent
from matest.lights.highlight import candidates, choose
from matest.lights.sphere import MirrorSphere
from matest.scene.camera import Camera
from tests.lights.mirror_ball import Ball, Lamp, unit

BALL = Ball(320, (160.3, 159.8, 150.0))
SPHERE = MirrorSphere.from_circle(BALL.circle, (320, 320), Camera())


def extent(half: float, *, blur: float = 1.0, radiance: float = 0.8, x: float = 0.3, noise: float = 0.003) -> Extent:
    lamp = Lamp(unit(x, 0.2, 0.9), math.radians(half), radiance)
    patch = choose([candidates(BALL.photograph([lamp], blur=blur, noise=noise), SPHERE)], ["a.png"])[0]
    measured = sight(patch, SPHERE).extent
    assert measured is not None
    assert measured == measure_extent(patch, SPHERE)
    return measured


def true(half: float) -> float:
    return 2 * math.pi * (1 - math.cos(math.radians(half)))


@pytest.mark.parametrize("half", [2.0, 4.0, 9.0])
@pytest.mark.parametrize("blur", [0.7, 1.4])
def test_solid_angles_of_discs_are_right_whatever_the_blur(half: float, blur: float) -> None:
    measured = extent(half, blur=blur)
    assert measured.std is not None
    assert measured.solid_angle == pytest.approx(true(half), abs=2.5 * measured.std)
    assert measured.std < (0.3 if half < 3 else 0.05) * true(half)


def test_where_the_ball_shows_the_light_does_not_matter() -> None:
    for x in (-1.2, 0.0, 1.5):
        assert extent(5.0, x=x).solid_angle == pytest.approx(true(5.0), rel=0.02)


@pytest.mark.parametrize("half", [0.3, 0.8])
def test_a_light_as_small_as_the_blur_has_an_upper_bound(half: float) -> None:
    measured = extent(half, blur=1.5)
    assert measured.std is None
    assert not measured.clipped
    assert measured.solid_angle > true(half)


@pytest.mark.parametrize("radiance", [1.1, 3.0, 100.0])
def test_a_clipped_light_has_an_upper_bound(radiance: float) -> None:
    measured = extent(4.0, radiance=radiance)
    assert measured.std is None
    assert measured.clipped
    assert true(4.0) < measured.solid_angle < 3 * true(4.0)


def test_many_lights_of_every_size_keep_within_errors_and_bounds() -> None:
    generator, distances = np.random.default_rng(1), []
    for _ in range(20):
        half = math.exp(generator.uniform(math.log(0.8), math.log(8)))
        x, blur = generator.uniform(-1.5, 1.5), generator.uniform(0.6, 1.8)
        measured = extent(half, x=x, blur=blur, radiance=float(generator.choice([0.4, 0.9, 4.0])))
        if measured.std is None:
            assert measured.solid_angle > true(half)
        else:
            distances.append((measured.solid_angle - true(half)) / measured.std)
    assert len(distances) > 5
    assert np.abs(distances).max() < 3


def test_sightings_combine_to_their_mean_or_the_least_bound() -> None:
    bounds = [Extent(0.02, None, True), Extent(0.01, None, False)]
    assert combine([*bounds, None]) == bounds[1]
    assert combine([None]) is None
    mean = combine([Extent(0.01, 0.001, False), Extent(0.012, 0.001, False), bounds[1]])
    assert mean is not None
    assert mean.solid_angle == pytest.approx(0.011)
    assert mean.std == pytest.approx(0.001 / math.sqrt(2))


def test_lights_have_a_solid_angle_in_common_where_all_agree() -> None:
    alike = [Extent(0.01, 0.001, False), Extent(0.012, 0.001, False)]
    shared = common_extent(alike)
    assert shared is not None
    assert shared.solid_angle == pytest.approx(0.011)
    assert common_extent([*alike, Extent(0.02, 0.001, False)]) is None
    assert common_extent([*alike, None]) is None
