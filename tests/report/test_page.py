"""The report as a page."""

from __future__ import annotations

import base64
import hashlib
import re
from dataclasses import replace
from pathlib import Path

import pytest

from matest.brdf import OrenNayar
from matest.estimation.result import Candidate
from matest.report.folder import write_result
from matest.report.page import page
from matest.report.picture_size import PictureSize
from matest.report.previews import LARGE_SIDE, SMALL_SIDE, PagePictures, Preview
from tests.estimates import LOST, SIGMA, clay
from tests.mapped import mapped
from tests.report.pages import read, words
from tests.simulated import Studio, coloured

EVIL = '<script>alert("1")</script> & co'
# A page without anything of others: its own script, and no data.
SCRIPTS = 1


def names(count: int) -> list[str]:
    return [f"{number:02d}.exr" for number in range(count)]


def pictures(count: int, name: str = "a.exr") -> PagePictures:
    """Made-up previews of some photographs."""
    uri = "data:image/jpeg;base64,"
    one = Preview(name, 0, 4, 2, 2, uri, uri, "", 1, 2, "", 1.0, False)
    previews = [replace(one, name=each, number=number) for number, each in enumerate([name] * count)]
    return PagePictures(previews, f"{uri}mean")


@pytest.mark.parametrize(
    "changes",
    [{}, {"candidates": []}, {"holdout": None}, {"warnings": []}, {"parameters": {"specular": LOST, "sigma": SIGMA}}],
    ids=lambda changes: ", ".join(changes) or "everything",
)
def test_every_tag_is_closed_in_its_place(changes: dict) -> None:
    reader = read(page(clay(**changes), names(3), pictures(3)))
    assert reader.doctype == "doctype html"
    assert [tag for tag in ("html", "head", "title", "body") if reader.tags.count(tag) != 1] == []


def test_the_page_says_what_was_found() -> None:
    text = words(page(clay(), names(1), None))
    for part in (
        "vase: oren-nayar",
        "Converged; the model describes the images to their noise.",
        "albedo R 0.7000 ± 0.0012",
        "0.5236 ± 0.0021 rad",
        "30.00 ± 0.12 degrees",
        "facet albedo ρ",
        "1.13%",
        "120,000",
        "123,456",
        "Fisher information",
        f"Held out of the fit, image 0 ({names(1)[0]}): relative rms error 2.00%",
        "chosen: predicts images left out better than lambert",
        "of one or two images four horizontal bands of each",
        "Noise was estimated from the images.",
        "500 background, 40 shadowed, 60 rim",
        "7 in images held out",
        "lobes that the images do not support: cook-torrance",
        "ambient light: there is none",
        "fit 0.30 s",
    ):
        assert part in text


def test_only_the_row_of_the_chosen_model_is_bold() -> None:
    text = page(clay(), names(1), None)
    assert text.count("<tr class=bold>") == 1
    assert text.split("<tr class=bold>")[1].startswith("<td>oren-nayar</td>")
    assert "chosen: the simplest" not in words(text)


def test_beside_maps_no_cause_of_residuals_is_said_to_be_absent() -> None:
    estimate = mapped()
    text = words(page(estimate, names(len(estimate.images) + 1), None))
    assert "Beside maps, causes of residuals are not looked for." in text
    assert "No cause" not in text


def test_what_was_not_asked_for_is_not_on_the_page() -> None:
    text = words(page(clay(candidates=[], holdout=None, warnings=[]), names(1), None))
    assert "Models tried" not in text
    assert "left out" not in text


@pytest.mark.parametrize(
    "changes",
    [
        {"capture": EVIL},
        {"model": EVIL},
        {"warnings": [EVIL]},
        {"parameters": {EVIL: SIGMA}},
        {"candidates": [Candidate(EVIL, 0.1, 0.1, EVIL)]},
        {"skipped": {"components": [], "samples": {EVIL: 3}, "work": [EVIL]}},
        {"timing_s": {EVIL: 1.0}},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_names_of_others_are_text_and_never_markup(changes: dict) -> None:
    text = page(clay(**changes), names(1), None)
    assert read(text).tags.count("script") == SCRIPTS
    assert EVIL in words(text)


def test_names_of_files_are_text_and_never_markup() -> None:
    text = page(clay(), [EVIL], pictures(1, EVIL))
    assert read(text).tags.count("script") == SCRIPTS + 1
    assert EVIL in words(text)


def test_only_the_script_of_the_page_may_run() -> None:
    text = page(clay(), names(1), pictures(1))
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)
    assert policy is not None
    (script,) = re.findall(r"<script>(.*?)</script>", text, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}';" in policy[1]
    assert "default-src 'none'" in policy[1]


def test_links_lead_to_sections_that_exist() -> None:
    text = page(clay(provenance={"matest": "1"}), names(2), pictures(2))
    targets = re.findall(r'<a href="#([\w-]+)">', text)
    assert len(targets) > 8
    assert targets == re.findall(r'<section id="([\w-]+)">', text)


def test_a_report_is_one_file_of_a_few_hundred_kilobytes(tmp_path: Path) -> None:
    lights = coloured([(0.1 * (k - 6), 0.05 * (6 - k), 0.8) for k in range(12)])
    capture = Studio(size=LARGE_SIDE, lights=lights).photograph(OrenNayar([0.7, 0.6, 0.5], 0.5), seed=1)
    write_result(clay(), capture, tmp_path / "matest")
    file = tmp_path / "matest" / "report.html"
    assert 200_000 < file.stat().st_size < 700_000
    shown = read(file.read_text("utf-8"))
    assert all(str(picture.get("src", "data:")).startswith("data:") for picture in shown.pictures)


def test_many_photographs_take_hardly_more(tmp_path: Path) -> None:
    lights = coloured([(0.01 * (k - 48), 0.2, 0.8) for k in range(96)])
    capture = Studio(size=SMALL_SIDE, lights=lights).photograph(OrenNayar([0.7, 0.6, 0.5], 0.5), seed=1)
    write_result(clay(), capture, tmp_path / "matest")
    assert (tmp_path / "matest" / "report.html").stat().st_size < 1_100_000


def test_without_pictures_the_page_has_none_and_the_rest() -> None:
    with_pictures, without = (read(page(clay(), names(2), shown)) for shown in (pictures(2), None))
    assert without.pictures == []
    assert 'id="viewer"' not in page(clay(), names(2), None)
    assert [part for part in without.text if part not in with_pictures.text] == []


def test_the_page_loads_nothing_from_elsewhere() -> None:
    text = page(clay(), names(2), pictures(2))
    assert not re.search(r"(src|href)\s*=\s*[\"']?(https?:)?//", text)
    assert not re.search(r"@import|url\(", text)


def test_full_size_pictures_are_linked_where_they_are_asked_for(tmp_path: Path) -> None:
    capture = Studio(size=16, lights=coloured()[:2]).photograph(OrenNayar([0.7, 0.6, 0.5], 0.5), seed=1)
    for size in (PictureSize.PREVIEW, PictureSize.FULL):
        write_result(clay(), capture, tmp_path / size, pictures=size)
        text = (tmp_path / size / "report.html").read_text("utf-8")
        assert ('"full":true' in text) == (size is PictureSize.FULL)


def test_fixed_channels_are_named_like_the_others() -> None:
    only_sigma = page(clay(parameters={"sigma": SIGMA}), names(1), None)
    assert "sigma R" not in words(only_sigma)
