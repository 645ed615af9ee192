"""The capture.toml that `init` writes says what the folder said."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
import trimesh

import matest
from matest.capture.initial import initialise
from tests.capture.formats.laboratories import GOLDEN, light_list
from tests.captures import refusal


@pytest.mark.parametrize("name", GOLDEN)
def test_the_file_gives_the_same_result_to_the_digit(name: str, tmp_path: Path) -> None:
    GOLDEN[name](tmp_path)
    direct = matest.estimate(matest.load_capture(tmp_path, transfer="linear"), "oren-nayar")
    written = initialise(tmp_path, transfer="linear")
    assert written.file == tmp_path / "capture.toml"
    capture = matest.load_capture(tmp_path)
    assert capture.understood["read from"] == "capture.toml"
    again = matest.estimate(capture, "oren-nayar")
    for parameter, value in direct.parameters.items():
        assert again.parameters[parameter] == value
    assert again.fit == direct.fit


def test_lights_whose_y_points_down_are_written_with_y_up(tmp_path: Path) -> None:
    light_list(tmp_path, -1.0)
    written = initialise(tmp_path, transfer="linear")
    assert any("y axis points down" in note for note in written.notes)
    capture = matest.load_capture(tmp_path)
    assert capture.scene.lights[0][0].direction[1] > 0
    assert "the other sign" in written.file.read_text("utf-8")


def test_a_file_that_is_there_is_never_written_over(tmp_path: Path) -> None:
    light_list(tmp_path)
    file = tmp_path / "capture.toml"
    file.write_text("mine", "ascii")
    assert "is there already and stays as it is" in refusal(lambda: initialise(tmp_path, transfer="linear"))
    file.unlink()
    file.symlink_to(tmp_path / "nowhere.toml")
    assert str(file) in refusal(lambda: initialise(tmp_path / "sphere.lp", transfer="linear"))
    assert not (tmp_path / "nowhere.toml").exists()


def test_what_cannot_be_read_leaves_no_file(tmp_path: Path) -> None:
    light_list(tmp_path)
    assert "give --transfer" in refusal(lambda: initialise(tmp_path))
    assert not (tmp_path / "capture.toml").exists()


def test_a_folder_without_lights_says_what_to_put_there(tmp_path: Path) -> None:
    np.save(tmp_path / "0.npy", np.ones((4, 4, 3), np.float32))
    message = refusal(lambda: initialise(tmp_path))
    assert str(tmp_path) in message
    assert "light_directions.txt, an .lp file, a .dome file" in message


def test_a_mesh_leaves_the_camera_to_be_completed(tmp_path: Path) -> None:
    light_list(tmp_path)
    trimesh.creation.icosphere(4).export(tmp_path / "ball.ply")
    direct = refusal(lambda: matest.load_capture(tmp_path, transfer="linear"))
    assert "needs a [camera]" in direct
    assert "'matest init' writes a capture.toml" in direct
    written = initialise(tmp_path)
    assert written.understood == {}
    assert any("complete [camera]" in note for note in written.notes)
    assert any("x right, y up, z toward the viewer" in note for note in written.notes)
    assert any("transfer" in note for note in written.notes)
    text = written.file.read_text("utf-8")
    assert tomllib.loads(text)["geometry"] == {"mesh": "ball.ply"}
    marked = re.sub(r"(?m)^# ", "", text[text.index("# [camera]") :])
    assert "fov_y" in tomllib.loads(marked)["camera"]
    file = tmp_path / "capture.toml"
    file.write_text(text[: text.index("# [camera]")] + marked, "utf-8")
    assert len(matest.load_capture(tmp_path, transfer="linear")) == 5


def test_the_list_may_be_named_where_there_are_several(tmp_path: Path) -> None:
    light_list(tmp_path)
    (tmp_path / "old.lp").write_text("0\n", "ascii")
    assert "several lists" in refusal(lambda: initialise(tmp_path, transfer="linear"))
    initialise(tmp_path / "sphere.lp", transfer=2.2)
    assert tomllib.loads((tmp_path / "capture.toml").read_text("utf-8"))["encoding"]["transfer"] == 2.2
