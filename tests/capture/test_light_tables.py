"""Lights with a size, as capture.toml states them. Other lights are tested with the captures that have them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from matest.capture.environment_maps import EnvironmentMaps
from matest.capture.light_tables import lights_of
from matest.capture.schema import ImageTable, LightTable
from matest.scene import PointLight
from matest.scene.source import Source
from tests.captures import refusal, sphere_surface

SURFACE = sphere_surface(32)
PANEL: dict[str, Any] = {"position": (0.0, 0.0, 9.0), "axis": (0.0, 0.0, -3.0), "size": (0.6, 0.2)}


def light_of(curvature: float = 3.0, **table: Any) -> PointLight:
    maps = EnvironmentMaps(lambda name, _: Path(name), 3, curvature)
    (light,) = lights_of(ImageTable(lights=[LightTable(**table)]), SURFACE, 3, curvature, "image 0", maps)
    assert isinstance(light, PointLight)
    return light


def source_of(**table: Any) -> Source:
    source = light_of(**(PANEL | table)).source
    assert source is not None
    return source


def test_a_panel_stands_upright_and_faces_along_its_axis() -> None:
    sides = source_of().sides
    np.testing.assert_allclose(sides.abs(), [[0.3, 0, 0], [0, 0.1, 0]], atol=1e-12)
    np.testing.assert_allclose(source_of(up=(1.0, 0.0, 5.0)).sides.abs(), [[0, 0.3, 0], [0.1, 0, 0]], atol=1e-12)
    # A lamp on the ceiling has no upright: its height lies along z.
    np.testing.assert_allclose(source_of(axis=(0, -1.0, 0)).sides.abs(), [[0.3, 0, 0], [0, 0, 0.1]], atol=1e-12)


def test_a_number_is_the_diameter_of_a_disc() -> None:
    disc = source_of(size=0.4)
    assert disc.round
    assert disc.sides.norm(dim=1).tolist() == pytest.approx([0.2, 0.2])


def test_radiance_times_the_area_is_the_intensity() -> None:
    assert light_of(**PANEL, radiance=5.0).intensity.tolist() == pytest.approx([0.6] * 3)
    assert light_of(**(PANEL | {"size": 0.4}), radiance=5.0).intensity.tolist() == pytest.approx([0.2 * math.pi] * 3)
    assert light_of(**PANEL, intensity=2.0).intensity.tolist() == [2.0] * 3


def test_points_that_stand_for_a_light_are_as_many_as_its_size_and_the_material_ask_for() -> None:
    near = PANEL | {"position": (0.0, 0.0, 2.0)}
    far_matte, far_glossy, near_matte, near_glossy = (
        light_of(curvature, **table).nodes for table in (PANEL, near) for curvature in (3.0, 2000.0)
    )
    assert far_matte == 1
    assert 1 < far_glossy < near_glossy
    assert 1 < near_matte < near_glossy
    assert light_of(**{key: value for key, value in PANEL.items() if key != "size"}).nodes == 1


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"axis": None}, "size goes with position and axis"),
        ({"size": (0.3, -1.0)}, "size is a diameter, or [width, height]"),
        ({"size": math.nan}, "size is a diameter"),
        ({"size": 0.3, "up": (0, 1.0, 0)}, "up goes with a size of [width, height]"),
        ({"up": (0, 0, 1.0)}, "up must not point along axis"),
        ({"solid_angle": 0.1}, "leave out solid_angle"),
        ({"radiance": 1.0, "intensity": 1.0}, "without irradiance and intensity"),
        ({"size": None, "radiance": 1.0}, "radiance goes with direction and solid_angle, or with size"),
    ],
)
def test_a_size_that_makes_no_sense_is_refused(table: dict[str, Any], words: str) -> None:
    message = refusal(lambda: light_of(**(PANEL | table)))
    assert message.startswith("image 0, light 0: ")
    assert words in message


def test_a_light_with_a_size_keeps_its_key_and_channel() -> None:
    light = light_of(**PANEL, intensity=[1.0, 2.0, 3.0])
    assert light.key == light_of(**PANEL, intensity=[1.0, 2.0, 3.0]).key
    assert light.key != light_of(**(PANEL | {"size": 0.3}), intensity=[1.0, 2.0, 3.0]).key
    one = light.channel(1).to(torch.float32, "cpu")
    assert one.intensity.tolist() == [2.0]
    assert one.source is not None
    assert one.source.sides.dtype == torch.float32
