"""Domes as Relight describes them, against a rendering of one's own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import matest
from matest.brdf import Lambert
from matest.capture.formats import dome as layout
from matest.scene import DirectionalLight, PointLight
from tests.capture.formats.laboratories import LIGHTS, RADIUS, WIDTH, dome, dome_positions, near_lambert, unit
from tests.captures import ALBEDO, inside_sphere, put_image, refusal


def positions(scale: float = 1.0, lift: float = 0.0) -> list[list[float]]:
    return [[*(scale * p + (0, 0, lift)).tolist()] for p in dome_positions()]


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"lightConfiguration": "lights3d", "positions3d": positions()},
        {"lightConfiguration": "spherical", "positionsSphere": positions(), "directions": []},
        # In centimetres all lengths are a tenth.
        {"lightConfiguration": "lights3d", "positions3d": positions(0.1), "imageWidth": WIDTH / 10},
        {"lightConfiguration": None, "positions": positions(), "directions": []},
    ],
    ids=["from directions", "positions", "on the sphere", "centimetres", "without configuration"],
)
def test_near_lights_render_what_was_photographed(tmp_path: Path, changes: dict[str, Any]) -> None:
    dome(tmp_path, **changes)
    capture = matest.load_capture(tmp_path)
    assert all(isinstance(light, PointLight) for (light,) in capture.scene.lights)
    images = matest.render(capture.scene, Lambert(albedo=list(ALBEDO)), dtype=torch.float64).numpy()
    for k, position in enumerate(dome_positions()):
        np.testing.assert_allclose(images[k], near_lambert(position), atol=2e-6)


def test_a_raised_centre_lifts_the_lights(tmp_path: Path) -> None:
    dome(tmp_path, verticalOffset=25.0)
    lights = [light for (light,) in matest.load_capture(tmp_path).scene.lights]
    np.testing.assert_allclose([light.position.tolist() for light in lights], positions(lift=25.0))


def test_directions_are_distant_lights(tmp_path: Path) -> None:
    dome(tmp_path, lightConfiguration="directional")
    capture = matest.load_capture(tmp_path)
    assert capture.understood["lights"].endswith("all equally strong")
    lights = [light for (light,) in capture.scene.lights]
    assert all(isinstance(light, DirectionalLight) for light in lights)
    np.testing.assert_allclose([light.direction.tolist() for light in lights], [unit(light) for light in LIGHTS])


def test_lights_whose_pixels_are_to_be_doubled_are_half_as_strong(tmp_path: Path) -> None:
    adjust = [{"r": 1.0, "g": 2.0, "b": 4.0}] * len(LIGHTS)
    dome(tmp_path, ledAdjust=adjust)
    capture = matest.load_capture(tmp_path)
    power = np.pi * RADIUS**2
    np.testing.assert_allclose(capture.scene.lights[0][0].power, [power, power / 2, power / 4])
    assert capture.relative


def test_how_a_dome_is_read_is_said(tmp_path: Path) -> None:
    dome(tmp_path)
    capture = matest.load_capture(tmp_path)
    assert capture.understood["units"].startswith("the image is 200 wide and lies in the plane z = 0")
    assert capture.understood["lights"].startswith("5 near lights in 5 images")
    assert "in the order of their names" in capture.photographs.notes[0]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"lightConfiguration": "round"}, "must be directional, spherical or lights3d; got 'round'"),
        ({"lightConfiguration": None, "positions": positions()}, "has positions and directions"),
        ({"directions": []}, "expected the lights in 'directions'"),
        ({"directions": [{"x": 0, "y": 0, "z": 0}] * 5}, "light 0 (from 0) is 0 0 0"),
        ({"lightConfiguration": "directional", "directions": [[0.6, 0.6, 0.6]] * 5}, "every light has x = y = z"),
        ({"directions": [{"x": 0, "y": 0}] * 5}, "must have the numbers x, y, z"),
        ({"directions": [[0, 0, 10**400]] * 5}, "must have the numbers x, y, z"),
        ({"verticalOffset": float("nan")}, "verticalOffset must be a number"),
        ({"domeDiameter": 0}, "need domeDiameter"),
        ({"imageWidth": 0}, "need imageWidth"),
        ({"verticalOffset": "high"}, "verticalOffset must be a number"),
        ({"directions": [[0, 0, 1]] * 4}, "has 4 lights, and the folder 5 photographs"),
        ({"ledAdjust": [{"r": 1, "g": 1, "b": 1}]}, "expected 5 entries in ledAdjust"),
        ({"ledAdjust": [{"r": 1, "g": 0, "b": 1}] * 5}, "ledAdjust must be positive"),
    ],
)
def test_domes_that_cannot_be_read_are_refused(tmp_path: Path, changes: dict[str, Any], words: str) -> None:
    dome(tmp_path, **changes)
    message = refusal(lambda: matest.load_capture(tmp_path))
    assert str(tmp_path / "dome.dome") in message
    assert words in message


@pytest.mark.parametrize("text", ["{", "[1, 2]", "\x00"])
def test_files_that_are_no_json_object_are_refused(tmp_path: Path, text: str) -> None:
    dome(tmp_path)
    (tmp_path / "dome.dome").write_text(text, "ascii")
    assert "expected the JSON" in refusal(lambda: matest.load_capture(tmp_path))


def test_positions_need_a_flat_surface(tmp_path: Path) -> None:
    dome(tmp_path)
    (tmp_path / "normals.npy").unlink()
    put_image(tmp_path / "mask.png", (255 * inside_sphere()).astype(np.uint8))
    assert "which needs a normal map" in refusal(lambda: matest.load_capture(tmp_path))
    (tmp_path / "ball.ply").write_text("ply\n", "ascii")
    assert "which needs a normal map" in refusal(lambda: matest.load_capture(tmp_path))


def test_an_order_that_is_not_clear_is_refused(tmp_path: Path) -> None:
    dome(tmp_path)
    (tmp_path / "04.npy").rename(tmp_path / "10.npy")
    (tmp_path / "03.npy").rename(tmp_path / "9.npy")
    assert "give the numbers leading zeros" in refusal(lambda: matest.load_capture(tmp_path))


def test_only_domes_are_of_this_layout(tmp_path: Path) -> None:
    dome(tmp_path)
    assert layout.LAYOUT.find(tmp_path) == (tmp_path / "dome.dome",)
    assert layout.LAYOUT.find(tmp_path / "00.npy") == ()
