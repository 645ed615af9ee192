from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from matest.lights.files import check_tables, write_capture_tables, write_light_list
from matest.lights.lights import Light, Lights
from matest.lights.position import Position
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


def test_only_tables_of_lights_are_overwritten(tmp_path: Path) -> None:
    check_tables(tmp_path / "new.toml")
    write_capture_tables(LIGHTS, tmp_path / "lights.toml")
    check_tables(tmp_path / "lights.toml")
    (tmp_path / "capture.toml").write_text("[geometry]\n")
    message = refusal(lambda: check_tables(tmp_path / "capture.toml"))
    assert message.startswith(f"{tmp_path / 'capture.toml'}: exists and would be overwritten")
