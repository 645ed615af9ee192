"""Tables and small drawings of a page."""

from __future__ import annotations

import pytest

from matest.report.html import facts, html_table, items, meter, provenance, sentence, time_bars
from tests.report.pages import read, words

EVIL = "<b>&\x1b[2J\u202e"


@pytest.mark.parametrize(
    "drawn",
    [
        html_table([EVIL], [[EVIL]]),
        facts({EVIL: EVIL}),
        items([EVIL]),
        sentence(EVIL),
        time_bars({EVIL: 1.0}),
        provenance({"command": EVIL, "inputs": {EVIL: EVIL}}),
    ],
    ids=["table", "facts", "items", "sentence", "times", "provenance"],
)
def test_texts_of_others_are_never_markup(drawn: str) -> None:
    assert "b" not in read(drawn).tags
    assert r"<b>&\x1b[2J\u202e" in words(drawn)


def test_bars_are_shares_of_the_longest_stage_and_the_total_is_none() -> None:
    drawn = time_bars({"read": 1.0, "fit": 4.0, "total": 5.0})
    assert 'width="25.0"' in drawn
    assert drawn.count("<rect") == 2
    assert "In all 5.00 s." in drawn
    assert time_bars({}) == ""


def test_a_meter_stays_in_its_place() -> None:
    assert 'width="100.0"' in meter(7.0)
    assert 'width="0.0"' in meter(-1.0)


def test_sums_of_files_are_folded_away() -> None:
    drawn = provenance({"matest": "0.1.0", "inputs": {"a.png": "sha256:0"}})
    assert "SHA-256 of 1 file as read" in words(drawn)
    assert "<details>" in drawn
    assert provenance({}) == ""


def test_options_of_the_command_line_stay_in_one_piece() -> None:
    assert sentence("or --refine blur.") == 'or <span class="option">--refine</span> blur.'
