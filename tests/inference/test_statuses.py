"""Verdicts on single unknowns: one rule after the other."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from matest.inference.statuses import Unknown, Verdict, _by_the_samples, combined

KNOWN = Unknown(
    value=0.5,
    std=0.01,
    interval=(0.48, 0.52),
    width=1.0,
    largest_std=0.29,
    lower=0.0,
    flat=False,
    at_end=False,
    end=math.nan,
    near_end=False,
    undetermined=False,
    locked=False,
    lobe_not_seen=False,
)
NOTHING = Verdict(None, None, None, "not determined")


def test_an_unknown_without_a_flaw_is_determined() -> None:
    assert Verdict.of(KNOWN) == Verdict(0.5, 0.01, [0.48, 0.52], "determined")


@pytest.mark.parametrize("flaw", ["undetermined", "locked", "lobe_not_seen"])
def test_of_an_unknown_with_a_flaw_nothing_is_reported(flaw: str) -> None:
    assert Verdict.of(replace(KNOWN, **{flaw: True})) == NOTHING
    assert Verdict.of(replace(KNOWN, at_end=True, **{flaw: True})) == NOTHING


def test_an_unknown_no_better_known_than_its_domain_says_is_lost() -> None:
    assert Verdict.of(replace(KNOWN, std=0.3)) == NOTHING


def test_near_a_bound_an_interval_over_the_whole_domain_says_nothing() -> None:
    everywhere = replace(KNOWN, interval=(0.0, 0.97), near_end=True)
    assert Verdict.of(everywhere) == NOTHING
    assert Verdict.of(replace(everywhere, interval=(0.0, 0.94))).status == "determined"
    assert Verdict.of(replace(everywhere, width=math.inf)).status == "determined"


def test_an_unknown_at_a_bound_has_a_value_and_an_interval_but_no_error_bar() -> None:
    bound = replace(KNOWN, value=0.0, std=0.4, interval=(0.0, 0.5), at_end=True, near_end=True)
    assert Verdict.of(bound) == Verdict(0.0, None, [0.0, 0.5], "at bound")


def test_a_value_on_a_bound_is_at_bound_even_if_nothing_holds_it_there() -> None:
    almost = replace(KNOWN, value=0.9995, std=0.03, interval=(0.94, 0.9998), end=1.0, near_end=True)
    assert Verdict.of(almost) == Verdict(1.0, None, [0.94, 1.0], "at bound")
    # Nor does that make a number of what the samples say nothing of.
    assert Verdict.of(replace(almost, std=0.3)) == NOTHING


def test_where_the_model_is_flat_at_a_bound_the_bound_is_the_value() -> None:
    flat = replace(KNOWN, value=0.013, interval=(0.002, 0.1), flat=True, at_end=True, near_end=True, undetermined=True)
    assert Verdict.of(flat) == Verdict(0.0, None, [0.0, 0.1], "at bound")


def test_the_status_of_a_parameter_is_the_worst_of_its_channels() -> None:
    known, bound = Verdict.of(KNOWN), Verdict(1.0, None, [0.9, 1.0], "at bound")
    assert combined([known], "1", "").status == "determined"
    assert combined([known, bound], "1", "").status == "at bound"
    mixed = combined([known, bound, NOTHING], "1", "albedo")
    assert (mixed.status, mixed.unit, mixed.doc) == ("not determined", "1", "albedo")
    assert mixed.value == [0.5, 1.0, None]
    assert mixed.std == [0.01, None, None]
    assert mixed.interval95 == [[0.48, 0.52], [0.9, 1.0], None]


@pytest.mark.parametrize("std", [0.01, 0.3, 5.0])
def test_a_standard_error_by_the_samples_alone_leaves_a_domain_out(std: float) -> None:
    prior = 3.0
    assert _by_the_samples((std**-2 + prior) ** -0.5, prior) == pytest.approx(std)
    assert _by_the_samples(std, 0.0) == std
    assert math.isinf(_by_the_samples(prior**-0.5, prior))
