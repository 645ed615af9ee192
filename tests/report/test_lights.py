from __future__ import annotations

import numpy as np
import pytest
from rich.console import Console

from matest.lights.directions import Ray, Sighting
from matest.lights.extent import Extent
from matest.lights.lights import Light, Lights
from matest.lights.position import Position
from matest.lights.strengths import Strengths
from matest.report.lights import lights_record, lights_report

ACROSS = np.diag([1e-4, 1e-4, 0.0])
NOTHING = Ray(np.zeros((2, 3)), np.zeros((2, 3)))
SIGHTING = Sighting(Ray(np.array([0, 0, 1.0]), np.zeros(3)), NOTHING, NOTHING, (10.25, 20.75), 7)


def test_a_light_is_shown_with_its_error_and_its_place_in_the_image() -> None:
    light = Light("a.png", np.array([0, 0, 1.0]), ACROSS, np.zeros((1, 3)), (SIGHTING,))
    console = Console(width=80, record=True, file=None, quiet=False)
    with console.capture() as captured:
        console.print(lights_report(Lights((light,), notes=("so it is.",)), []))
    shown = captured.get()
    assert "± 0.57°" in shown
    assert "10.2, 20.8" in shown
    assert "Note: so it is." in shown


def test_positions_and_directions_are_plain_values() -> None:
    position = Position(np.array([1.0, 2.0, 3.0]), np.diag([0.01, 0.04, 0.09]))
    light = Light("a.png", np.array([0, 0, 1.0]), ACROSS, np.zeros((1, 3)), (SIGHTING,) * 2, 0.01, position)
    record = lights_record(Lights((light,)), [])["lights"][0]
    assert record["position"] == [1.0, 2.0, 3.0]
    np.testing.assert_allclose(record["position_std"], [0.1, 0.2, 0.3])
    assert record["highlights"][0]["saturated"] == 7


def test_solid_angles_and_strengths_are_shown_with_their_errors() -> None:
    extents = (Extent(0.0123, 0.0004, False), Extent(0.05, None, True), None)
    lights = Lights(
        tuple(
            Light(f"{number}.png", np.array([0, 0, 1.0]), ACROSS, np.zeros((1, 3)), (SIGHTING,), extent=extent)
            for number, extent in enumerate(extents)
        )
    )
    strengths = Strengths(np.full((3, 3), 3.0), np.full((3, 3), 0.01), 0.3, 0.12, ("it shines.",))
    console = Console(width=80, record=True, file=None, quiet=False)
    with console.capture() as captured:
        console.print(lights_report(lights, [], strengths))
    shown = captured.get()
    for words in ("0.01230 ± 0.00040", "≤ 0.05", "3.000 ± 0.030", "(relative)", "it shines.", "clips 1 of 3"):
        assert words in shown
    record = lights_record(lights, [], strengths)
    assert record["matte"] == {"sigma": 0.3, "misfit": 0.12}
    assert [light["extent"] for light in record["lights"]] == [
        {"solid_angle": 0.0123, "std": 0.0004},
        {"at_most": 0.05, "clipped": True},
        None,
    ]
    assert record["lights"][0]["power"] == [3.0, 3.0, 3.0]
    assert record["uncertainty"]["intensity"] == pytest.approx(0.01)
