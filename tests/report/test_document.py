"""The frame of every page."""

from __future__ import annotations

import json
import re

import pytest

from matest.report.assets import asset
from matest.report.document import Section, data_block, document
from tests.report.pages import read

SCRIPTS = ("numbers", "tables", "curves", "viewer", "relight", "sliders")
ASSETS = ("page.css", "relight.glsl", *(f"{name}.js" for name in SCRIPTS))
# Lines of a script or style that one can still read.
READABLE = 400


def test_sections_without_content_are_left_away() -> None:
    text = document("t", "head", [Section("a", "A", "<p>body</p>"), Section("b", "B", "")])
    assert 'id="a"' in text
    assert 'href="#b"' not in text


def test_titles_are_text() -> None:
    text = document("<b>", "", [Section("a", "<i>", "x")])
    assert {"b", "i"}.isdisjoint(read(text).tags)


def test_no_data_ends_its_block() -> None:
    content = {"name": "</script><script>alert(1)</script>", "nothing": float("nan")}
    text = data_block("x", content)
    assert text.count("</script>") == 1
    assert json.loads(re.sub("<[^>]*>", "", text)) == {"name": content["name"], "nothing": None}


@pytest.mark.parametrize("name", ASSETS)
def test_assets_are_short_and_would_not_end_their_element(name: str) -> None:
    text = asset(name)
    assert len(text.splitlines()) < READABLE
    assert "</" not in text
