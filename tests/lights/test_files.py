from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from matest.lights.extent import Extent
from matest.lights.files import check_tables, write_capture_tables, write_light_list
from matest.lights.lights import Light, Lights
from matest.lights.position import Position
from matest.lights.strengths import Strengths
from matest.samples.uncertainty import Uncertainty
from tests.captures import refusal

ACROSS = np.diag([1e-4, 1e-4, 0.0])
LIGHTS = Lights(
    (
        Light('a "b".png', np.array([0.0, 0.6, 0.8]), ACROSS, np.zeros((1, 3)), ()),
        Light("c.png", np.array([0, 0, 1.0]), ACROSS, np.zeros((1, 3)), (), None, Position(np.ones(3), np.eye(3))),
    )
)


def test_a_light_list_has_the_count_and_a_direction_a_line(tmp_path: Path) -> None:
    write_light_list(LIGHTS, tmp_path / "lights.lp")
    lines = (tmp_path / "lights.lp").read_text("utf-8").splitlines()
    assert lines == ["2", 'a "b".png 0.000000 0.600000 0.800000', "c.png 0.000000 0.000000 1.000000"]


def test_the_tables_are_those_of_a_capture(tmp_path: Path) -> None:
    write_capture_tables(LIGHTS, tmp_path / "lights.toml")
    tables = tomllib.loads((tmp_path / "lights.toml").read_text("utf-8"))
    assert Uncertainty.of(tables["uncertainty"]).direction == pytest.approx(0.01)
    first, second = tables["image"]
    assert first == {"file": 'a "b".png', "lights": [{"direction": [0.0, 0.6, 0.8]}]}
    assert second["lights"] == [{"position": [1.0, 1.0, 1.0]}]


def test_strengths_and_solid_angles_stand_in_the_tables(tmp_path: Path) -> None:
    told, bound = Extent(0.0123, 0.0004, False), Extent(0.05, None, True)
    lights = Lights(tuple(replace(light, extent=one) for light, one in zip(LIGHTS.lights, (told, bound), strict=True)))
    strengths = Strengths(np.array([[3.0, 2.5, 2.0], [3.3, 2.8, 2.2]]), np.full((2, 3), 0.01), 0.3, 0.02)
    write_capture_tables(lights, tmp_path / "lights.toml", strengths)
    text = (tmp_path / "lights.toml").read_text("utf-8")
    tables = tomllib.loads(text)
    assert tables["encoding"] == {"radiometry": "relative"}
    assert Uncertainty.of(tables["uncertainty"]).intensity == pytest.approx(0.01)
    first, second = (image["lights"][0] for image in tables["image"])
    assert first["irradiance"] == [3.0, 2.5, 2.0]
    assert first["solid_angle"] == pytest.approx(0.0123)
    assert second["intensity"] == [3.3, 2.8, 2.2]
    # A bound is no measurement.
    assert "solid_angle" not in second
    assert "# solid angle at most 0.05 sr" in text


def test_only_tables_of_lights_are_overwritten(tmp_path: Path) -> None:
    check_tables(tmp_path / "new.toml")
    write_capture_tables(LIGHTS, tmp_path / "lights.toml")
    check_tables(tmp_path / "lights.toml")
    (tmp_path / "capture.toml").write_text("[geometry]\n")
    message = refusal(lambda: check_tables(tmp_path / "capture.toml"))
    assert message.startswith(f"{tmp_path / 'capture.toml'}: exists and would be overwritten")
