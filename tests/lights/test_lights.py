from __future__ import annotations

import numpy as np
import pytest

from matest.lights.lights import Light, Lights


def light(direction: tuple[float, ...], own: float = 0.0, common: np.ndarray | None = None) -> Light:
    """A light with so large a standard error of its own, rad."""
    vector = np.array(direction) / np.linalg.norm(direction)
    covariance = own**2 * (np.eye(3) - np.outer(vector, vector))
    return Light("a.png", vector, covariance, np.zeros((1, 3)) if common is None else common, ())


DIRECTIONS = [(0.5, 0.1, 0.8), (-0.4, 0.3, 0.8), (0.1, -0.6, 0.7), (0.0, 0.1, 1.0)]


def test_errors_of_single_lights_are_those_of_directions() -> None:
    lights = Lights(tuple(light(direction, 0.01) for direction in DIRECTIONS))
    assert lights.uncertainty == {"direction": pytest.approx(0.01), "rotation": 0.0}
    assert lights.lights[0].std == pytest.approx(0.01)


def test_errors_that_turn_all_lights_alike_are_a_rotation() -> None:
    turns = 0.02 * np.eye(3)[:2]
    vectors = [np.array(direction) / np.linalg.norm(direction) for direction in DIRECTIONS]
    lights = Lights(tuple(light(tuple(v), 0.0, np.cross(turns, v)) for v in vectors))
    assert lights.uncertainty["rotation"] == pytest.approx(0.02)
    assert lights.uncertainty["direction"] == pytest.approx(0, abs=1e-9)


def test_what_is_no_rotation_counts_for_every_light() -> None:
    """A radius that is wrong moves lights outward from the viewer's axis."""
    vectors = [np.array(v) for v in [(0.6, 0, 0.8), (-0.6, 0, 0.8), (0, 0.6, 0.8), (0, -0.6, 0.8)]]
    outward = [0.03 * np.array([v[0] / 0.6 * 0.8, v[1] / 0.6 * 0.8, -0.6])[None] for v in vectors]
    lights = Lights(tuple(light(tuple(v), 0.0, change) for v, change in zip(vectors, outward, strict=True)))
    assert lights.uncertainty["direction"] == pytest.approx(0.03 / np.sqrt(2))
    assert lights.uncertainty["rotation"] == pytest.approx(0, abs=1e-9)


def test_one_light_has_no_rotation_of_its_own() -> None:
    assert Lights((light((0, 0, 1), 0.01),)).uncertainty == {"direction": pytest.approx(0.01)}
