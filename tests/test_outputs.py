"""No file is written over what is read, or where nothing can be written."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import pytest

from matest.outputs import check_distinct, check_writable, json_text, keep_inputs, write_text
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


@pytest.mark.parametrize(
    "names", [["a.png", "./a.png"], ["a.png", "b/../a.png"], ["mask.png", "MASK.png"], ["a.png", "a.png/b.png"]]
)
def test_two_files_of_one_place_are_refused(names: list[str]) -> None:
    assert "two files would be called" in refusal(lambda: check_distinct(names, "scene.toml"))


def test_files_of_different_places_are_not_refused() -> None:
    check_distinct(["a.png", "b/a.png", "b/c.png"], "scene.toml")


def test_a_place_under_a_file_is_refused_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    assert "is a file" in refusal(lambda: check_writable(tmp_path / "file"))
    assert "which is a file" in refusal(lambda: check_writable(tmp_path / "file" / "out"))


def test_a_place_that_takes_no_files_is_told_before_the_work(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="nothing can be written there") as raised:
        check_writable(Path("/proc/matest/out"))
    assert raised.value.filename == "/proc/matest/out"
    (tmp_path / ".matest-probe").mkdir()  # as a run leaves it that is killed at that moment
    check_writable(tmp_path / "new" / "folder")
    assert not [*tmp_path.iterdir()]


def test_json_has_null_for_what_is_no_number() -> None:
    content = {"a": [1.0, math.nan], "b": {"c": -math.inf}, "d": (2, True, None)}
    assert json.loads(json_text(content)) == {"a": [1.0, None], "b": {"c": None}, "d": [2, True, None]}


def test_names_that_are_no_text_are_written_as_escapes(tmp_path: Path) -> None:
    write_text(tmp_path / "a.json", json_text({"name": "a\udcff"}, ensure_ascii=False))
    assert json.loads((tmp_path / "a.json").read_text("utf-8")) == {"name": "a\udcff"}
