"""The report as a page."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from matest.brdf import OrenNayar
from matest.estimation.result import Candidate
from matest.report.folder import write_result
from matest.report.page import page
from tests.estimates import LOST, SIGMA, clay
from tests.simulated import Studio, coloured

VOID = {"meta", "img", "br"}
EVIL = '<script>alert("1")</script> & co'


def names(count: int) -> list[str]:
    return [f"{number:02d}.exr" for number in range(count)]


class Reader(HTMLParser):
    """Collects text, tags and pictures, and insists that tags nest."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.tags: list[str] = []
        self.text: list[str] = []
        self.pictures: list[dict[str, str | None]] = []
        self.doctype = ""

    def handle_decl(self, decl: str) -> None:
        self.doctype = decl

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag == "img":
            self.pictures.append(dict(attrs))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not self.open or self.open[-1] != "style":
            self.text.append(data)


def read(text: str) -> Reader:
    reader = Reader()
    reader.feed(text)
    reader.close()
    assert reader.open == []
    return reader


def words(text: str) -> str:
    return " ".join(" ".join(read(text).text).split())


@pytest.mark.parametrize(
    "changes",
    [{}, {"candidates": []}, {"holdout": None}, {"warnings": []}, {"parameters": {"specular": LOST, "sigma": SIGMA}}],
    ids=lambda changes: ", ".join(changes) or "everything",
)
def test_every_tag_is_closed_in_its_place(changes: dict) -> None:
    reader = read(page(clay(**changes), names(3)))
    assert reader.doctype == "doctype html"
    assert [tag for tag in ("html", "head", "title", "body") if reader.tags.count(tag) != 1] == []


def test_the_page_says_what_was_found() -> None:
    text = words(page(clay(), names(1)))
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
    text = page(clay(), names(1))
    assert text.count("<tr class=bold>") == 1
    assert text.split("<tr class=bold>")[1].startswith("<td>oren-nayar</td>")
    assert "chosen: the simplest" not in words(text)


def test_what_was_not_asked_for_is_not_on_the_page() -> None:
    text = words(page(clay(candidates=[], holdout=None, warnings=[]), names(1)))
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
    text = page(clay(**changes), names(1))
    assert "script" not in read(text).tags
    assert EVIL in words(text)


def test_names_of_files_are_text_and_never_markup() -> None:
    text = page(clay(), [EVIL])
    assert "script" not in read(text).tags
    assert f"{EVIL}: photograph" in words(text)


def test_every_picture_is_described_and_exists_in_the_folder(tmp_path: Path) -> None:
    capture = Studio(size=16, lights=coloured()[:2]).photograph(OrenNayar([0.7, 0.6, 0.5], 0.5), seed=1)
    write_result(clay(), capture, tmp_path / "matest")
    pictures = read((tmp_path / "matest" / "report.html").read_text("utf-8")).pictures
    assert len(pictures) == 7
    assert all((tmp_path / "matest" / str(picture["src"])).is_file() for picture in pictures)
    assert len({picture["alt"] for picture in pictures}) == 7


def test_the_page_says_which_pixels_its_pictures_show() -> None:
    preview = words(page(clay(), names(1), step=3))
    assert "one pixel of every 3×3" in preview
    assert "--pictures full" in preview
    assert "one pixel of every" not in words(page(clay(), names(1)))


def test_without_pictures_the_page_has_none_and_the_rest() -> None:
    with_pictures, without = (read(page(clay(), names(2), step=step)) for step in (1, None))
    assert without.pictures == []
    text = " ".join(without.text)
    assert "Images" not in without.text
    assert "red where the photograph" not in text
    assert [part for part in without.text if part not in with_pictures.text] == []


def test_more_than_a_hundred_images_are_numbered_on() -> None:
    sources = [picture["src"] for picture in read(page(clay(), names(101))).pictures]
    assert sources[-1] == "images/100_residual.png"
    assert len(set(sources)) == 304


def test_the_page_loads_nothing_from_elsewhere() -> None:
    text = page(clay(), names(2))
    assert not re.search(r"(src|href)\s*=\s*[\"']?(https?:)?//", text)
    assert not re.search(r"@import|url\(", text)


def test_fixed_channels_are_named_like_the_others() -> None:
    only_sigma = page(clay(parameters={"sigma": SIGMA}), names(1))
    assert "sigma R" not in words(only_sigma)
