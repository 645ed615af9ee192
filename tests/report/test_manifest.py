"""Manifests: a result is kept for the same request of the same files, and only whole."""

from __future__ import annotations

from pathlib import Path

import pytest

from matest.report import manifest

REQUEST = {"matest": "0.1.0", "options": {"fix": {"albedo": (0.7, 0.6)}, "seed": 0}}
INPUTS = {"00.png": "sha256:0"}


@pytest.fixture
def result(tmp_path: Path) -> Path:
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "00.png").write_bytes(b"pixels")
    (tmp_path / "result.json").write_text("{}")
    manifest.write(tmp_path, REQUEST, INPUTS)
    return tmp_path


def test_a_whole_result_answers_its_own_request_and_no_other(result: Path) -> None:
    assert manifest.is_whole(result)
    assert manifest.answers(result, REQUEST, INPUTS)
    assert not manifest.answers(result, {**REQUEST, "matest": "0.2.0"}, INPUTS)
    assert not manifest.answers(result, {**REQUEST, "options": {"seed": 1}}, INPUTS)


@pytest.mark.parametrize("inputs", [{"00.png": "sha256:1"}, {}, {**INPUTS, "01.png": "sha256:1"}])
def test_files_that_changed_went_or_came_make_a_result_an_old_one(result: Path, inputs: dict[str, str]) -> None:
    assert not manifest.answers(result, REQUEST, inputs)


@pytest.mark.parametrize("name", ["images/00.png", "result.json", "manifest.json"])
def test_a_result_with_a_file_missing_or_changed_is_not_whole(result: Path, name: str) -> None:
    kept = (result / name).read_bytes()
    for spoil in (lambda: (result / name).write_bytes(b"half"), (result / name).unlink):
        spoil()
        assert not manifest.is_whole(result)
        assert not manifest.answers(result, REQUEST, INPUTS)
        (result / name).write_bytes(kept)
    assert manifest.is_whole(result)


@pytest.mark.parametrize("text", ["[]", "{}", '{"schema": "matest.manifest/1"}', '{"schema": "other/1", "files": {}}'])
def test_a_manifest_of_another_form_is_of_no_result(result: Path, text: str) -> None:
    (result / "manifest.json").write_text(text)
    assert not manifest.is_whole(result)
    assert manifest.inputs_of(result) == {}
