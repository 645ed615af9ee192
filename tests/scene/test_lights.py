from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from matest.scene.lights import unit_direction
from tests.captures import directional, point, refusal


def test_a_point_light_falls_off_with_the_square_of_distance():
    light = point((1.0, 2.0, 3.0), 8.0, 4.0)
    offsets = torch.tensor([[0.0, 0.0, -1.0], [0.0, -2.0, 0.0], [3.0, 0.0, 4.0]], dtype=torch.float64)
    _, power = light.at(light.position + offsets)
    expected = torch.tensor([[8.0, 4.0], [2.0, 1.0], [8 / 25, 4 / 25]], dtype=torch.float64)
    torch.testing.assert_close(power, expected, rtol=1e-14, atol=0)


def test_directions_to_a_point_light_are_unit_vectors_toward_it():
    light = point((1.0, 2.0, 3.0))
    positions = torch.tensor([[1.0, 2.0, 0.0], [-2.0, -2.0, 3.0]], dtype=torch.float64)
    toward, _ = light.at(positions)
    expected = torch.tensor([[0.0, 0.0, 1.0], [0.6, 0.8, 0.0]], dtype=torch.float64)
    torch.testing.assert_close(toward, expected, rtol=1e-14, atol=1e-15)


def test_a_far_point_light_equals_a_distant_one():
    positions = torch.tensor([[0.1, -0.2, 0.3]], dtype=torch.float64)
    distant = directional((0.3, 0.4, 0.8), 2.0)
    far = point(tuple((1e7 * distant.direction).tolist()), 2e14)
    for near, limit in zip(far.at(positions), distant.at(positions), strict=True):
        torch.testing.assert_close(near, limit, rtol=1e-6, atol=1e-6)


def test_a_distant_light_is_the_same_everywhere():
    light = directional((0.0, 3.0, 4.0), 0.5)
    toward, power = light.at(None)
    assert toward.tolist() == [[0.0, 0.6, 0.8]]
    assert power.tolist() == [[0.5]]


def test_a_point_light_without_positions_is_refused():
    assert "positions" in refusal(lambda: point((0.0, 0.0, 1.0)).at(None))


@pytest.mark.parametrize(
    "direction", [[0.0, 0.0, 0.0], [0.0, math.nan, 1.0], [math.inf, 0.0, 0.0]], ids=["zero", "NaN", "infinite"]
)
def test_a_direction_that_points_nowhere_is_refused(direction):
    message = refusal(lambda: unit_direction(direction, "image 3, light 0"))
    assert message.startswith("image 3, light 0: direction")
    assert str(direction) in message


def test_unit_direction_normalises():
    torch.testing.assert_close(
        unit_direction([0.0, -3.0, 4.0], ""), torch.tensor([0.0, -0.6, 0.8], dtype=torch.float64), rtol=1e-15, atol=0
    )


@pytest.mark.parametrize("light", [directional((0.0, 0.6, 0.8), 1.0, 2.0), point((0.0, 0.0, 2.0), 1.0, 2.0)])
def test_to_converts_every_tensor(light):
    positions = torch.zeros(1, 3, dtype=torch.float32)
    assert [value.dtype for value in light.to(torch.float32, "cpu").at(positions)] == [torch.float32] * 2


POSITIONS = torch.tensor([[0.0, 0.0, 0.0], [3.0, 0.0, -2.0]], dtype=torch.float64)


def test_only_a_point_light_needs_positions_and_is_at_a_finite_distance():
    distant, lamp = directional((0.0, 0.6, 0.8)), point((0.0, 0.0, 2.0))
    assert (distant.near, lamp.near) == (False, True)
    assert distant.distance(POSITIONS).tolist() == [math.inf]
    assert lamp.distance(POSITIONS).tolist() == [2.0, 5.0]


def test_the_power_of_a_light_is_what_its_file_states():
    assert directional((0.0, 0.6, 0.8), 1.0, 2.0).power.tolist() == [1.0, 2.0]
    assert point((0.0, 0.0, 2.0), 3.0, 4.0).power.tolist() == [3.0, 4.0]


@pytest.mark.parametrize("light", [directional((0.0, 0.6, 0.8), 1.0, 2.0), point((0.0, 0.6, 0.8), 1.0, 2.0)])
def test_one_channel_of_a_light_lights_as_that_channel_did(light):
    direction, power = light.at(POSITIONS)
    narrowed = light.channel(1).at(POSITIONS)
    torch.testing.assert_close(narrowed[0], direction, rtol=0, atol=0)
    torch.testing.assert_close(narrowed[1], power[:, 1:], rtol=0, atol=0)


def test_lights_are_the_same_only_if_everything_stated_of_them_is():
    distant, lamp = directional((0.0, 0.6, 0.8), 1.0), point((0.0, 0.6, 0.8), 1.0)
    for light in (distant, lamp):
        assert light.key == replace(light).key
        assert light.key != replace(light, solid_angle=0.1).key
    assert distant.key != lamp.key
    assert distant.key != directional((0.0, 0.8, 0.6), 1.0).key
    assert distant.key != directional((0.0, 0.6, 0.8), 2.0).key
    assert lamp.key != point((0.0, 0.6, 0.9), 1.0).key
    assert lamp.key != point((0.0, 0.6, 0.8), 2.0).key
