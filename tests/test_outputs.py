"""No command writes over what it reads."""

from __future__ import annotations

import os
from pathlib import Path

from matest.outputs import keep_inputs
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
