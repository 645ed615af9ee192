"""`matest init` as people and scripts use it."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import pytest

import matest
from tests.capture.formats.laboratories import diligent, light_list
from tests.commands.conftest import Run


@pytest.fixture
def run(run: Run, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run `matest init ARGUMENTS` at eighty columns."""
    monkeypatch.setenv("COLUMNS", "80")
    return partial(run, "init")


def test_a_folder_gets_its_file_and_is_said_to_be_understood(run: Run, tmp_path: Path) -> None:
    diligent(tmp_path)
    code, out, err = run(tmp_path)
    assert code == 0
    assert max(len(line) for line in out.splitlines()[:-1]) <= 80
    for topic in ("shape", "axes", "transfer", "units", "lights", "scale"):
        assert f"  {topic}" in out
    assert "Written to" in out
    assert "note: Read as DiLiGenT" in err
    assert len(matest.load_capture(tmp_path)) == 5


def test_json_holds_the_file_and_what_was_understood(run: Run, tmp_path: Path) -> None:
    light_list(tmp_path)
    code, out, err = run(tmp_path, "--transfer", "linear", "--json")
    assert (code, err) == (0, "")
    content = json.loads(out)
    assert content["file"] == str(tmp_path / "capture.toml")
    assert content["understood"]["transfer"] == "linear, integers of 8 bits"
    assert content["notes"]


@pytest.mark.parametrize(
    ("options", "expected"),
    [((), "give --transfer linear"), (("--transfer", "film"), "--transfer must be linear, srgb")],
)
def test_what_the_files_do_not_say_is_asked_in_one_sentence(
    run: Run, tmp_path: Path, options: tuple[str, ...], expected: str
) -> None:
    light_list(tmp_path)
    code, out, err = run(tmp_path, *options)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert expected in err


def test_a_second_run_changes_nothing(run: Run, tmp_path: Path) -> None:
    diligent(tmp_path)
    run(tmp_path)
    before = (tmp_path / "capture.toml").read_bytes()
    code, _, err = run(tmp_path)
    assert code == 2
    assert "is there already" in err
    assert (tmp_path / "capture.toml").read_bytes() == before
