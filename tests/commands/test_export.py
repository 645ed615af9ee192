"""`matest export` as people and scripts use it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.commands.conftest import Run


@pytest.fixture
def result(tmp_path: Path) -> Path:
    folder = tmp_path / "ball"
    folder.mkdir()
    content = {"model": "lambert", "radiometry": "relative", "parameters": {"albedo": [0.5, 0.4, 0.3]}}
    (folder / "material.json").write_text(json.dumps(content))
    return folder


def test_a_material_is_written_with_its_error(run: Run, result: Path) -> None:
    code, out, err = run("export", result, "--to", "merl")
    assert code == 0
    assert "error of the conversion 0.00%" in out
    assert "up to a scale only" in err
    assert result.with_name("ball.binary").stat().st_size == 34_992_012


def test_json_names_the_file_and_the_error(run: Run, result: Path, tmp_path: Path) -> None:
    code, out, _ = run("export", result, "--to", "merl", "-o", tmp_path / "a.binary", "--json")
    assert code == 0
    assert json.loads(out)["file"] == str(tmp_path / "a.binary")
    assert json.loads(out)["error"]["relative_rmse"] < 1e-6


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--to", "merle"), "did you mean 'merl'?"),
        (("--to", "merl", "-o", "/nowhere/a.binary"), "expected a file name in an existing folder"),
    ],
)
def test_what_cannot_be_written_is_refused(run: Run, result: Path, arguments: tuple[str, ...], words: str) -> None:
    code, _, err = run("export", result, *arguments)
    assert code == 2
    assert words in err


def test_a_folder_without_a_material_is_named(run: Run, tmp_path: Path) -> None:
    code, _, err = run("export", tmp_path, "--to", "merl")
    assert code == 2
    assert str(tmp_path) in err
