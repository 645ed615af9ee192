"""Numbers as people read them."""

from __future__ import annotations

import math

import pytest

from matest.inference.quantities import ParameterEstimate
from matest.report.format import chi2, measured, rows, share
from tests.estimates import ALBEDO, FIXED, LOST, SIGMA

RGB = ("R", "G", "B")


@pytest.mark.parametrize(
    ("value", "std", "expected"),
    [
        (0.523598, 0.0012345, "0.5236 ± 0.0012"),
        (0.523598, 0.012345, "0.524 ± 0.012"),
        (0.523598, 0.12345, "0.52 ± 0.12"),
        (0.5, 0.0000012345, "0.5000000 ± 0.0000012"),
        (12.3456, 1.2345, "12.3 ± 1.2"),
        (123.456, 23.45, "123 ± 23"),
        (-0.5, 0.1, "-0.50 ± 0.10"),
        (0.25, 0.0, "0.25 ± 0"),
        (0.0, 0.003, "0.0000 ± 0.0030"),
        (-1e-7, 0.003, "0.0000 ± 0.0030"),
    ],
)
def test_a_value_has_two_digits_of_its_error(value: float, std: float, expected: str) -> None:
    assert measured(value, std) == expected


@pytest.mark.parametrize("std", [None, math.inf, math.nan])
def test_a_value_without_error_bar_stands_alone(std: float | None) -> None:
    assert measured(0.123456, std) == "0.1235"


def test_no_value_is_a_dash() -> None:
    assert measured(None, None) == "-"
    assert measured(None, 0.1) == "-"


def test_very_small_errors_do_not_make_endless_digits() -> None:
    assert measured(0.5, 1e-14) == "0.500000000 ± 0.000000000"


def test_one_value_makes_one_row() -> None:
    (row,) = rows("f0", ParameterEstimate(0.05, 0.001, [0.048, 0.052], "1", "determined"), RGB)
    assert row == ("f0", "0.0500 ± 0.0010", "0.0480 to 0.0520", "determined")


def test_every_channel_has_its_row() -> None:
    found = rows("albedo", ALBEDO, RGB)
    assert [row[0] for row in found] == ["albedo R", "albedo G", "albedo B"]
    assert found[0][1] == "0.7000 ± 0.0012"
    assert found[2][2] == "0.4980 to 0.5020"


def test_angles_have_degrees_beside_radians() -> None:
    ((name, value, interval, status),) = rows("sigma", SIGMA, RGB)
    assert (name, status) == ("sigma", "determined")
    assert value == "0.5236 ± 0.0021 rad\n30.00 ± 0.12 degrees"
    assert interval == "29.77° to 30.23°"


def test_a_fixed_angle_has_degrees_too() -> None:
    ((_, value, interval, status),) = rows("sigma", ParameterEstimate(0.5, None, None, "rad", "fixed"), RGB)
    assert value == "0.5 rad\n28.65 degrees"
    assert (interval, status) == ("-", "fixed")


def test_what_is_not_determined_has_dashes() -> None:
    assert rows("specular", LOST, RGB) == [("specular", "-", "-", "not determined")]
    assert rows("sigma", ParameterEstimate(None, None, None, "rad", "not determined"), RGB) == [
        ("sigma", "-", "-", "not determined")
    ]


def test_channels_that_are_not_determined_have_dashes() -> None:
    some = ParameterEstimate([0.5, None, 1.0], [0.1, None, None], [[0.3, 0.7], None, [0.9, 1.0]], "1", "at bound")
    assert [row[1:3] for row in rows("albedo", some, RGB)] == [
        ("0.50 ± 0.10", "0.30 to 0.70"),
        ("-", "-"),
        ("1", "0.90 to 1.00"),
    ]


def test_fixed_values_per_channel_need_no_error_bars() -> None:
    fixed = ParameterEstimate([0.1, 0.2, 0.3], None, None, "1", "fixed")
    assert [row[1:] for row in rows("albedo", fixed, RGB)] == [(text, "-", "fixed") for text in ("0.1", "0.2", "0.3")]


def test_other_units_follow_the_value() -> None:
    ((_, value, _, _),) = rows("height_rms", ParameterEstimate(0.31, 0.01, [0.29, 0.33], "µm", "determined"), RGB)
    assert value == "0.310 ± 0.010 µm"


def test_a_fixed_value_has_no_unit_of_one() -> None:
    assert rows("f0", FIXED, RGB) == [("f0", "0.04", "-", "fixed")]


@pytest.mark.parametrize(
    ("ends", "text"),
    [
        ([0.5, 0.5], "0.500000 to 0.500000"),
        ([0.0, math.inf], "0.000000 to inf"),
        ([0.699, 0.701], "0.6990 to 0.7010"),
        ([100.0, 350.0], "100 to 350"),
    ],
)
def test_an_interval_has_the_digits_of_its_width(ends: list[float], text: str) -> None:
    ((_, _, interval, _),) = rows("a", ParameterEstimate(ends[0], 0.1, ends, "1", "determined"), RGB)
    assert interval == text


@pytest.mark.parametrize(
    ("value", "text"), [(0.0113, "1.13%"), (9.99, "999.00%"), (81.234, "81.2 ×"), (None, "no usable pixel")]
)
def test_a_share_is_in_per_cent_and_a_large_one_a_multiple(value: float | None, text: str) -> None:
    assert share(value) == text


@pytest.mark.parametrize(("value", "text"), [(1.0234, "1.02"), (0.987, "0.99"), (42.0, "42.00"), (1234.5, "1.23e+03")])
def test_chi2_is_read_at_a_glance(value: float, text: str) -> None:
    assert chi2(value) == text


def test_every_channel_of_a_parameter_has_its_own_status() -> None:
    lost = [None, 0.5, 1.0]
    some = ParameterEstimate(lost, [None, 0.01, None], [None, [0.48, 0.52], [0.9, 1.0]], "1", "not determined", "")
    assert [row[-1] for row in rows("specular", some, ("R", "G", "B"))] == ["not determined", "determined", "at bound"]
    fixed = ParameterEstimate([0.1, 0.2, 0.3], None, None, "1", "fixed", "")
    assert {row[-1] for row in rows("diffuse", fixed, ("R", "G", "B"))} == {"fixed"}
