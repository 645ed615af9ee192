"""Lists of lights of every kind, without their photographs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from matest.capture.listed_lights import load_listed_lights
from tests.capture.formats.laboratories import GOLDEN, LIGHTS, unit
from tests.captures import refusal, sphere_folder

UNITS = np.array([unit(light) for light in LIGHTS])


def test_lists_give_unit_directions_whether_or_not_photographs_are_there(tmp_path: Path) -> None:
    for name, file in (("DiLiGenT", "light_directions.txt"), ("RTI light list", "sphere.lp")):
        GOLDEN[name](tmp_path)
        for image in tmp_path.glob("*.png"):
            image.unlink()
        np.testing.assert_allclose(load_listed_lights(tmp_path / file).directions, UNITS, atol=1e-6)
    assert load_listed_lights(tmp_path / "sphere.lp").names == tuple(f"photo_{k}.png" for k in range(5))
    assert load_listed_lights(tmp_path).file == tmp_path / "light_directions.txt"
    assert load_listed_lights(tmp_path).names is None


def test_a_capture_file_or_its_folder_gives_the_lights_of_its_images(tmp_path: Path) -> None:
    sphere_folder(tmp_path).save()
    for path in (tmp_path, tmp_path / "capture.toml"):
        listed = load_listed_lights(path)
        assert listed.names == ("00.npy", "01.npy")
        np.testing.assert_allclose(listed.directions, [unit((0.3, 0.2, 0.9)), unit((-0.5, 0.1, 0.8))])


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.txt", "0 0 0\n", "light 0 (from 0) is no direction; correct it."),
        ("a.txt", "1 2\n", "line 1 should hold the direction x y z to a light (3 numbers); got '1 2'."),
        ("a.lp", "2\na.png 0 0 1\n", "line 1 says 2 lights, and 1 follow"),
        (
            "capture.toml",
            '[geometry]\nshape = "sphere"\n[[image]]\nlights = [ { position = [0, 0, 1] } ]\n',
            "image 0 should have one light, with a direction, to compare with.",
        ),
    ],
)
def test_what_is_no_list_of_directions_is_refused(tmp_path: Path, name: str, text: str, words: str) -> None:
    (tmp_path / name).write_text(text)
    sentence = refusal(lambda: load_listed_lights(tmp_path / name))
    assert sentence.startswith(f"{tmp_path / name}: {words}")
