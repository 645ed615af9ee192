from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from matest.scene.lights import PointLight, unit_direction
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


def led(axis: tuple[float, ...], anisotropy: float, *intensity: float) -> PointLight:
    lamp = point((0.0, 0.0, 2.0), *intensity)
    vector = torch.tensor(axis, dtype=torch.float64)
    return replace(lamp, axis=vector / vector.norm(), anisotropy=anisotropy)


@pytest.mark.parametrize("anisotropy", [0.0, 0.5, 1.0, 3.7, 80.0])
def test_the_intensity_of_an_led_is_a_power_of_the_cosine_to_its_axis(anisotropy):
    lamp = led((0.2, -0.1, -1.0), anisotropy, 3.0, 5.0)
    positions = torch.randn(50, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    toward, irradiance = lamp.at(positions)
    for position, direction, value in zip(positions.tolist(), toward.tolist(), irradiance.tolist(), strict=True):
        away = [p - q for p, q in zip(position, (0.0, 0.0, 2.0), strict=True)]
        distance = math.hypot(*away)
        cosine = sum(a * x for a, x in zip(away, (0.2, -0.1, -1.0), strict=True)) / distance / math.hypot(0.2, 0.1, 1)
        lobe = cosine**anisotropy if cosine > 0 else 0.0
        assert value == pytest.approx([3 * lobe / distance**2, 5 * lobe / distance**2], rel=1e-12)
        assert direction == pytest.approx([-a / distance for a in away], rel=1e-12)


def test_an_led_lights_nothing_behind_it_and_has_finite_gradients_there():
    lamp = led((0.0, 0.0, -1.0), 0.5)
    positions = torch.tensor([[0.0, 0.0, 3.0], [1.0, 0.0, 2.0], [0.3, 0.0, 0.0]], dtype=torch.float64)
    positions.requires_grad_()
    irradiance = lamp.at(positions)[1]
    assert irradiance[:2].tolist() == [[0.0], [0.0]]
    irradiance.sum().backward()
    assert torch.isfinite(positions.grad).all()
    assert (positions.grad[:2] == 0).all()


def test_an_led_stays_one_in_another_type_or_channel():
    lamp = led((0.0, 0.6, -0.8), 2.0, 3.0, 4.0)
    direction, irradiance = lamp.at(POSITIONS)
    torch.testing.assert_close(lamp.channel(1).at(POSITIONS), (direction, irradiance[:, 1:]), rtol=0, atol=0)
    single = lamp.to(torch.float32, "cpu").at(POSITIONS.float())
    assert [value.dtype for value in single] == [torch.float32] * 2
    torch.testing.assert_close(single[1].double(), irradiance, rtol=1e-5, atol=0)


def test_leds_are_the_same_only_if_their_beams_are():
    lamp = led((0.0, 0.6, -0.8), 2.0)
    assert lamp.key == replace(lamp).key
    others = (led((0.0, 0.6, -0.9), 2.0), led((0.0, 0.6, -0.8), 3.0), point((0.0, 0.0, 2.0)))
    assert all(lamp.key != other.key for other in others)
