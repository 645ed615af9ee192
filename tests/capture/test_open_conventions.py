"""What files of a layout differ in is decided by the photographs, and said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import matest
from matest.capture import Capture
from matest.capture.open_conventions import settled
from tests.capture.formats.laboratories import LIGHTS, dome, light_list, rewrite, unit


def load(folder: Path) -> Capture:
    return matest.load_capture(folder, transfer="linear")


def directions(capture: Capture) -> np.ndarray:
    return np.array([light.direction.tolist() for (light,) in capture.scene.lights])


@pytest.mark.parametrize("shape", ["mask", "normals"])
@pytest.mark.parametrize("y", [1.0, -1.0])
def test_lights_are_found_with_y_up_and_down(tmp_path: Path, shape: str, y: float) -> None:
    light_list(tmp_path, y, shape)
    capture = load(tmp_path)
    np.testing.assert_allclose(directions(capture), [unit(light) for light in LIGHTS], atol=1e-5)
    notes = [note for note in capture.photographs.notes if "y axis points down" in note]
    assert len(notes) == (y < 0)
    assert any("normal map with y turned round would look the same" in note for note in notes) == (
        y < 0 and shape == "normals"
    )
    assert ("the other sign" in capture.understood["axes"]) == (y < 0)
    assert matest.estimate(capture, "lambert").fit.relative_rmse < 0.01


def test_the_tables_are_turned_like_the_photographs(tmp_path: Path) -> None:
    light_list(tmp_path, -1.0)
    description = load(tmp_path).description
    assert description is not None
    stated = [unit(image.lights[0].direction) for image in description.tables.image]
    np.testing.assert_allclose(stated, [unit(light) for light in LIGHTS], atol=1e-5)


def test_near_lights_are_turned_too(tmp_path: Path) -> None:
    dome(tmp_path)
    up = [light.position.tolist() for (light,) in load(tmp_path).scene.lights]
    flipped = [{"x": x, "y": -y, "z": z} for x, y, z in (map(float, unit(light)) for light in LIGHTS)]
    dome(tmp_path, directions=flipped)
    capture = load(tmp_path)
    np.testing.assert_allclose([light.position.tolist() for (light,) in capture.scene.lights], up, rtol=1e-9)
    assert any("y axis points down" in note for note in capture.photographs.notes)


def test_two_photographs_do_not_tell_and_leave_y_as_the_layout_has_it(tmp_path: Path) -> None:
    light_list(tmp_path, -1.0)
    rewrite(tmp_path / "sphere.lp", lambda text: "\n".join(["2", *text.splitlines()[1:3]]) + "\n")
    np.testing.assert_allclose(directions(load(tmp_path)), [unit((x, -y, z)) for x, y, z in LIGHTS[:2]], atol=1e-5)


def test_a_capture_file_leaves_nothing_open(folder) -> None:
    capture = folder.load()
    assert settled(capture.photographs, capture.description) == (capture.photographs, capture.description)
