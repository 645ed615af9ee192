"""Lobes that are not seen."""

from __future__ import annotations

from functools import cache

from matest.brdf import CookTorrance, Lambert
from matest.inference.lobes import LobesNotSeen
from tests.inference.judged import Judged, judged
from tests.simulated import Studio


@cache
def without_lobe() -> Judged:
    return judged(Studio(size=24).photograph(Lambert(0.6), 0), "cook-torrance")


@cache
def with_lobe() -> Judged:
    return judged(Studio(size=24).photograph(CookTorrance(0.4, 0.6, 0.25), 0), "cook-torrance")


def test_a_lobe_of_no_strength_is_not_seen() -> None:
    assert without_lobe().posterior.lobes == LobesNotSeen(
        shapes=frozenset({"slope"}), amplitudes=frozenset({"specular"})
    )


def test_the_interval_of_a_lobe_that_is_not_seen_begins_at_zero() -> None:
    assert without_lobe().posterior.estimates["specular"].interval95[0] == 0


def test_a_lobe_of_some_strength_is_seen() -> None:
    assert with_lobe().posterior.lobes == LobesNotSeen()
