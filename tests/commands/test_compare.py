"""`matest compare` as people and scripts use it."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from matest.photographs.images import full_scale, read_image, write_image
from tests.commands.conftest import Run


def test_estimate_predict_compare_work_in_a_row(run: Run, capture: Path, tmp_path: Path) -> None:
    assert run("estimate", capture, "--model", "oren-nayar", "-o", tmp_path / "result")[0] == 0
    code, out, _ = run("predict", tmp_path / "result", capture, "-o", tmp_path / "prediction", "--json")
    assert code == 0
    assert max(json.loads(out)["relative_rmse"].values()) < 0.1
    images = [tmp_path / "prediction" / "00.exr", tmp_path / "prediction" / "01.exr"]
    code, out, _ = run("compare", *images, "--row", 32, "-o", tmp_path / "section", "--json")
    assert code == 0
    rows = json.loads(out)["images"]
    assert rows[0]["rms"] == 0
    assert rows[1]["rms"] > 0.01
    assert (tmp_path / "section.png").stat().st_size > 5000
    assert len((tmp_path / "section.csv").read_text("utf-8").splitlines()) == 65


def test_codes_beside_radiance_are_noted_with_the_ratio_of_their_scales(
    run: Run, capture: Path, tmp_path: Path
) -> None:
    codes = read_image(capture / "00.png")
    for name, factor in (("same", 1.0), ("scaled", 4.0)):
        write_image(tmp_path / f"{name}.exr", (factor * codes / full_scale(codes.dtype)).astype(np.float32))
    compared = (capture / "00.png", tmp_path / "scaled.exr", capture / "01.png", "-o", tmp_path / "out")
    code, out, _ = run("compare", *compared)
    assert code == 0
    words = " ".join(out.split())
    assert "Note: 00.png holds integers, fractions of full scale, and scaled.exr floats" in words
    assert "the median of scaled.exr is 4 times the other's." in words
    assert words.count("Note:") == 1
    code, out, _ = run("compare", *compared, "--json")
    assert len(json.loads(out)["notes"]) == 1
    code, out, _ = run("compare", tmp_path / "same.exr", tmp_path / "scaled.exr", "-o", tmp_path / "out", "--json")
    assert json.loads(out)["notes"] == []


def test_a_comparison_of_one_image_or_along_two_lines_is_refused(run: Run, capture: Path) -> None:
    code, out, err = run("compare", capture / "00.png")
    assert (code, out) == (2, "")
    assert "two images" in err
    code, out, err = run("compare", capture / "00.png", capture / "01.png", "--row", 3, "--column", 4)
    assert (code, out) == (2, "")
    assert "one of --row, --column and --line" in err


def test_a_photograph_is_not_overwritten_by_its_plot(run: Run, capture: Path) -> None:
    photograph = capture / "00.png"
    before = photograph.read_bytes()
    for name in ("00", "00.png", "00.csv"):
        code, out, err = run("compare", photograph, capture / "01.png", "-o", capture / name)
        assert (code, out) == (2, "")
        assert err.startswith(f"matest: {photograph}: ")
        assert photograph.read_bytes() == before
        assert not (capture / "00.csv").exists()


def test_a_line_that_is_not_in_the_image_is_refused(run: Run, capture: Path, tmp_path: Path) -> None:
    for line in ("nan,0,1,1", "0,0,inf,1"):
        code, out, err = run("compare", capture / "00.png", capture / "01.png", "--line", line, "-o", tmp_path / "plot")
        assert (code, out) == (2, "")
        assert "leaves the image" in err
        assert err.count("\n") == 1


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are bytes on Linux")
def test_images_whose_names_are_no_text_are_compared(run: Run, capture: Path, tmp_path: Path) -> None:
    image = capture / os.fsdecode(b"\xff.png")
    (capture / "00.png").rename(image)
    code, _, err = run("compare", image, capture / "01.png", "-o", tmp_path / "section")
    assert (code, err) == (0, "")
    assert (tmp_path / "section.csv").read_text("utf-8").startswith("distance,\\xff.png,01.png\n")


@pytest.mark.parametrize("name", ["mine.csv", "mine.png"])
def test_files_that_are_not_from_a_comparison_are_not_replaced(
    run: Run, capture: Path, tmp_path: Path, name: str
) -> None:
    (tmp_path / name).write_text("mine", "utf-8")
    images = (capture / "00.png", capture / "01.png")
    code, _, err = run("compare", *images, "-o", tmp_path / "mine")
    assert (code, (tmp_path / name).read_text("utf-8")) == (2, "mine")
    assert "is not from an earlier comparison" in err
    for _ in range(2):
        assert run("compare", *images, "-o", tmp_path / "other")[0] == 0
