"""Lights beside a list of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from matest.lights.comparison import ListedLights, compare
from matest.lights.lights import Light, Lights
from tests.captures import refusal
from tests.lights.mirror_ball import degrees_between, unit

DIRECTIONS = np.array([unit(0.4, 0.1, 0.8), unit(-0.3, 0.5, 0.8), unit(0.1, -0.4, 0.9), unit(0.0, 0.0, 1.0)])
NAMES = tuple("abcd")
FOUND = Lights(
    tuple(
        Light(name, each, np.zeros((3, 3)), np.zeros((0, 3)), ()) for name, each in zip(NAMES, DIRECTIONS, strict=True)
    )
)
OFF = Rotation.from_euler("xyz", [2.0, -1.0, 3.0], degrees=True).apply(DIRECTIONS)


def listed(directions: np.ndarray, names: tuple[str, ...] | None = None) -> ListedLights:
    return ListedLights(Path("x.lp"), names, directions)


def test_angles_are_those_between_the_directions_in_order() -> None:
    comparison = compare(FOUND, listed(OFF, ("e", "f", "g", "h")))
    assert not comparison.by_name
    assert np.degrees(comparison.angles) == pytest.approx(degrees_between(DIRECTIONS, OFF), abs=1e-9)
    assert comparison.order.tolist() == [0, 1, 2, 3]
    assert not len(comparison.moved)


def test_lights_of_the_same_photographs_are_paired_by_name() -> None:
    comparison = compare(FOUND, listed(OFF[[2, 0, 3, 1]], ("c", "a", "d", "b")))
    assert comparison.by_name
    np.testing.assert_array_equal(comparison.directions, OFF)
    assert np.degrees(comparison.angles) == pytest.approx(degrees_between(DIRECTIONS, OFF), abs=1e-9)


def test_a_list_in_another_order_is_told_with_the_order_that_fits() -> None:
    comparison = compare(FOUND, listed(OFF[[0, 2, 1, 3]]))
    assert comparison.moved.tolist() == [1, 2]
    assert comparison.order.tolist() == [0, 2, 1, 3]
    assert np.degrees(comparison.reordered) == pytest.approx(degrees_between(DIRECTIONS, OFF), abs=1e-9)
    assert np.degrees(comparison.angles).max() > 40


def test_another_number_of_lights_is_refused() -> None:
    assert "x.lp: expected 4 lights, as there are photographs" in refusal(lambda: compare(FOUND, listed(OFF[:3])))
