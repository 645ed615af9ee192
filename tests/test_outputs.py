"""Files are written whole, and none over what is read."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from matest.outputs import keep_inputs, whole_files
from tests.captures import refusal


def test_an_output_that_is_an_input_by_path_or_link_is_refused(tmp_path: Path) -> None:
    photograph = tmp_path / "photograph.png"
    photograph.write_bytes(b"pixels")
    (tmp_path / "linked.png").symlink_to(photograph)
    os.link(photograph, tmp_path / "second.png")
    (tmp_path / "folder").mkdir()
    for name in ("photograph.png", "folder/../photograph.png", "linked.png", "second.png"):
        message = refusal(lambda name=name: keep_inputs([tmp_path / "new.png", tmp_path / name], [photograph]))
        assert message.startswith(f"{tmp_path / name}: ")
        assert "-o" in message


def test_other_files_and_files_that_are_missing_are_no_inputs(tmp_path: Path) -> None:
    for name in ("one.png", "other.png"):
        (tmp_path / name).write_bytes(b"pixels")
    keep_inputs([tmp_path / "one.png", tmp_path / "new.png"], [tmp_path / "other.png", tmp_path / "missing.png"])


def test_files_move_together_into_a_folder_whose_others_stay(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "index").write_text("old")
    with whole_files(tmp_path, last="index") as part:
        (part / "images").mkdir()
        (part / "images" / "00").write_text("pixels")
        (part / "index").write_text("new")
        assert (tmp_path / "index").read_text() == "old"
    assert {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*")} == {
        "notes.txt",
        "index",
        "images",
        "images/00",
    }
    assert (tmp_path / "index").read_text() == "new"


def test_an_error_of_the_disk_names_the_folder_and_leaves_nothing(tmp_path: Path) -> None:
    def fill() -> None:
        with whole_files(tmp_path / "out", last="index") as part:
            (part / "index").write_text("half")
            raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space left") as caught:
        fill()
    assert caught.value.filename == str(tmp_path / "out")
    assert not [*tmp_path.iterdir()]
