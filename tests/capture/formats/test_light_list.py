"""RTI's lists of lights, good, odd and bad."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import matest
from matest.capture import Capture
from matest.capture.formats import light_list as layout
from tests.capture.formats.laboratories import LIGHTS, light_list, rewrite, unit
from tests.captures import inside_sphere, put_image, refusal
from tests.shared_data import measurement


@pytest.fixture
def laboratory(tmp_path: Path) -> Path:
    light_list(tmp_path)
    return tmp_path


def load(folder: Path) -> Capture:
    return matest.load_capture(folder, transfer="linear")


def directions(capture: Capture) -> np.ndarray:
    return np.array([light.direction.tolist() for (light,) in capture.scene.lights])


def test_a_list_is_read_as_numpy_reads_it(laboratory: Path) -> None:
    capture = load(laboratory)
    file = laboratory / "sphere.lp"
    expected = np.loadtxt(file, skiprows=1, usecols=(1, 2, 3))
    np.testing.assert_allclose(directions(capture), expected, atol=1e-6)
    assert capture.names == [*np.loadtxt(file, skiprows=1, usecols=0, dtype=str)]
    assert capture.relative
    assert capture.understood["read from"] == "sphere.lp (RTI light list)"
    assert capture.scene.surface.circle is not None


def test_the_list_itself_may_be_named(laboratory: Path) -> None:
    shutil.copy(laboratory / "sphere.lp", laboratory / "other.lp")
    assert "several lists of lights (other.lp, sphere.lp)" in refusal(lambda: load(laboratory))
    assert len(load(laboratory / "other.lp")) == len(LIGHTS)


def test_images_of_integers_need_a_transfer(laboratory: Path) -> None:
    assert "give --transfer" in refusal(lambda: matest.load_capture(laboratory))


# What stands in the files of `shared/data/layouts`: name as written, and direction.
SHARED = {
    "plain.lp": {"photo 1.jpg": (0.7071, 0, 0.7071), "photo 2.jpg": (0, 0.7071, 0.7071), "photo 3.jpg": (0, 0, 2)},
    "crlf_windows.lp": {"a.jpg": (0.1, 0.2, 0.97), "b.jpg": (-0.3, 0.2, 0.93)},
    "decimal_comma.lp": {"a.jpg": (0.57735, 0.57735, 0.57735), "b.jpg": (0, 0, 1)},
}
NOTES = {
    "plain.lp": "1 of 3 lights are no unit vectors (lengths 1 to 2)",
    "crlf_windows.lp": "2 of 2 photographs are read though the list names them otherwise: a.jpg for C:\\rti\\a.jpg.",
    "decimal_comma.lp": "1 of 2 lights are written with decimal commas",
}


def shared_list(name: str, folder: Path) -> None:
    """A copy of a list, with photographs of the names that it may have."""
    shutil.copy(measurement("layouts", name), folder / name)
    names = [*SHARED.get(name, {"a.jpg": (), "b.jpg": (), "c.jpg": ()})]
    for photograph in names:
        put_image(folder / photograph, np.full((40, 48, 3), 90, np.uint8))
    put_image(folder / "mask.png", (255 * inside_sphere()).astype(np.uint8))


@pytest.mark.parametrize("name", SHARED)
def test_lists_as_programs_write_them_are_read_and_what_is_odd_is_said(name: str, tmp_path: Path) -> None:
    shared_list(name, tmp_path)
    capture = load(tmp_path)
    assert capture.names == [*SHARED[name]]
    np.testing.assert_allclose(directions(capture), [unit(light) for light in SHARED[name].values()], atol=1e-6)
    assert any(NOTES[name] in note for note in capture.photographs.notes)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("count_wrong.lp", "line 1 says 4 lights, and 3 follow"),
        ("zero_light.lp", "line 2 (a.jpg) has the light 0 0 0"),
    ],
)
def test_lists_that_are_wrong_are_refused(name: str, sentence: str, tmp_path: Path) -> None:
    shared_list(name, tmp_path)
    message = refusal(lambda: load(tmp_path))
    assert str(tmp_path / name) in message
    assert sentence in message


def test_lights_go_by_name_where_the_list_has_another_order(laboratory: Path) -> None:
    def swapped(text: str) -> str:
        head, first, second, *rest = text.splitlines()
        return "\n".join([head, second, first, *rest])

    before = directions(load(laboratory))
    rewrite(laboratory / "sphere.lp", swapped)
    capture = load(laboratory)
    assert capture.names[:2] == ["photo_1.png", "photo_0.png"]
    np.testing.assert_array_equal(directions(capture)[[1, 0]], before[:2])
    assert any("lights go by name" in note for note in capture.photographs.notes)


def test_names_of_other_photographs_are_not_taken_for_an_order(laboratory: Path) -> None:
    rewrite(laboratory / "sphere.lp", lambda text: text.replace("photo_", "IMG_"))
    message = refusal(lambda: load(laboratory))
    assert "line 2 names 'IMG_0.png'" in message
    assert "photo_0.png, photo_1.png, photo_2.png and 2 more" in message
    assert "lights go by name, not by order" in message


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("5\n", "", "line 1 should hold the number of lights"),
        ("photo_1.png", "photo_0.png", "names photo_0.png 2 times"),
        (" 0.5", " half", "should hold 'name x y z'"),
    ],
)
def test_lines_that_are_wrong_are_named(laboratory: Path, old: str, new: str, words: str) -> None:
    rewrite(laboratory / "sphere.lp", lambda text: text.replace(old, new, 1))
    assert words in refusal(lambda: load(laboratory))


def test_a_folder_without_shape_says_what_to_put_there(laboratory: Path) -> None:
    (laboratory / "mask.png").unlink()
    assert "put a normal map (normals.exr, Normal_gt.mat) or a mesh, or the mask of a sphere" in refusal(
        lambda: load(laboratory)
    )


def test_only_lists_are_of_this_layout(laboratory: Path) -> None:
    assert layout.LAYOUT.find(laboratory) == (laboratory / "sphere.lp",)
    assert layout.LAYOUT.find(laboratory / "mask.png") == ()


def test_photographs_that_the_list_lacks_are_named(laboratory: Path) -> None:
    def without_the_first(text: str) -> str:
        count, first, *others = text.splitlines()
        left_out.append(first.split()[0])
        return "\n".join([str(int(count) - 1), *others]) + "\n"

    left_out: list[str] = []
    assert not any(note.startswith("Not in") for note in load(laboratory).photographs.notes)
    rewrite(laboratory / "sphere.lp", without_the_first)
    assert f"Not in sphere.lp, and so left out: {left_out[0]}." in load(laboratory).photographs.notes
