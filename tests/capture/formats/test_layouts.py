"""The catalogue of layouts, and the page that describes it."""

from __future__ import annotations

from pathlib import Path

import pytest

import matest
from matest.capture.formats import LAYOUTS, recognise
from tests.capture.formats.laboratories import GOLDEN, MALFORMED
from tests.captures import refusal

PAGE = Path(__file__).parents[3] / "docs" / "layouts.md"
NAMES = [layout.name for layout in LAYOUTS]


def load(folder: Path) -> matest.Capture:
    return matest.load_capture(folder, transfer="linear")


@pytest.mark.parametrize("name", NAMES)
def test_a_golden_folder_is_recognised_and_fitted(name: str, tmp_path: Path) -> None:
    GOLDEN[name](tmp_path)
    found = recognise(tmp_path)
    assert found is not None
    assert found[0].name == name
    assert recognise(found[1][0]) == found
    capture = load(tmp_path)
    assert name in capture.understood["read from"]
    estimate = matest.estimate(capture, "lambert")
    assert estimate.fit.relative_rmse < 0.01
    assert {str(file) for file in found[1]} <= {str(file) for file in capture.sums}


@pytest.mark.parametrize("name", NAMES)
def test_a_malformed_folder_is_refused_with_the_sentence_of_the_page(name: str, tmp_path: Path) -> None:
    GOLDEN[name](tmp_path)
    spoil, sentence = MALFORMED[name]
    spoil(tmp_path)
    message = refusal(lambda: load(tmp_path))
    path, _, rest = message.partition(": ")
    assert Path(path).parent == tmp_path
    assert rest == sentence
    assert sentence in " ".join(PAGE.read_text("utf-8").split())


@pytest.mark.parametrize("name", NAMES)
def test_the_page_has_a_row_for_every_layout(name: str) -> None:
    assert f"| {name} |" in PAGE.read_text("utf-8")


def test_a_capture_file_comes_before_a_layout(tmp_path: Path, folder) -> None:
    GOLDEN["RTI light list"](tmp_path)
    capture = folder.load()
    assert capture.understood["read from"] == "capture.toml"
    assert recognise(tmp_path / "capture.toml") is None


def test_a_folder_of_no_layout_says_which_there_are(tmp_path: Path) -> None:
    message = refusal(lambda: load(tmp_path))
    assert "a capture.toml, or with light_directions.txt, an .lp file, a .dome file" in message


def test_a_folder_of_two_layouts_is_refused_and_the_file_that_counts_taken(tmp_path: Path) -> None:
    GOLDEN["DiLiGenT"](tmp_path)
    GOLDEN["RTI light list"](tmp_path)
    message = refusal(lambda: load(tmp_path))
    assert "several lists of lights (light_directions.txt, sphere.lp)" in message
    assert "RTI light list" in load(tmp_path / "sphere.lp").understood["read from"]
    assert "DiLiGenT" in load(tmp_path / "light_directions.txt").understood["read from"]
