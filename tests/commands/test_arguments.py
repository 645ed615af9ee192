"""Arguments of the commands: from text to numbers, pairs and lists."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, get_args

import pytest

from matest.commands import arguments
from matest.samples.uncertainty import NAMES, Uncertainty
from tests.captures import refusal


@pytest.mark.parametrize(
    ("parse", "text", "value"),
    [
        (arguments.assignment, "f0=0.04", ("f0", 0.04)),
        (arguments.assignment, "albedo = 0.7, 0.6,0.5", ("albedo", [0.7, 0.6, 0.5])),
        (arguments.indices, "0, 3,", [0, 3]),
        (arguments.noise, "0.002,5e-4", (0.002, 0.0005)),
        (arguments.line, "0,1,20.5,3", (0.0, 1.0, 20.5, 3.0)),
        (arguments.encoding, "srgb", "srgb"),
        (arguments.encoding, "2.2", 2.2),
        (arguments.encoding, None, None),
        (arguments.size, "800MB", 800_000_000),
        (arguments.size, "1.5 GiB", 3 << 29),
        (arguments.size, "4g", 4_000_000_000),
        (arguments.size, None, None),
    ],
)
def test_a_text_becomes_what_it_says(parse: Callable[[str | None], Any], text: str | None, value: object) -> None:
    assert parse(text) == value


def test_uncertainties_are_read_by_name() -> None:
    stated = arguments.uncertainty(["direction=0.01", "pose = 0.5,0.01", "intensity=3%"])
    assert stated == Uncertainty(direction=0.01, pose=(0.5, 0.01), intensity=0.03)
    assert arguments.uncertainty(None) == Uncertainty()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("directoin=0.01", "--uncertainty: unknown uncertainty 'directoin'; did you mean 'direction'?"),
        ("pose=0.5", "--uncertainty: pose must be 2 numbers (pixels,rad), as 0.5,0.01; got '0.5'."),
        ("blur=wide", "--uncertainty: blur must be one number (pixels), as 0.5; got 'wide'."),
        ("direction=1,2", "--uncertainty: direction must be one number (rad), as 0.01; got '1,2'."),
        ("blur", "--uncertainty: 'blur' must read NAME=VALUE."),
        (
            "pose=0.5,0.01,intensity=0.03",
            "--uncertainty takes one NAME=VALUE; repeat it: --uncertainty pose=0.5,0.01 --uncertainty intensity=0.03.",
        ),
    ],
)
def test_an_uncertainty_that_is_none_is_refused(text: str, expected: str) -> None:
    assert refusal(lambda: arguments.uncertainty([text])) == expected


@pytest.mark.parametrize(
    ("option", "parse"),
    [
        ("--uncertainty", arguments.uncertainty),
        ("--fix", lambda texts: arguments.options(None, texts, None, None, None)),
        ("--tie", lambda texts: arguments.options(None, None, None, texts, None)),
    ],
)
def test_a_name_that_is_given_twice_is_refused(option: str, parse: Callable[[list[str]], object]) -> None:
    assert refusal(lambda: parse(["blur=1", "blur=2"])) == f"{option} blur is given twice; keep one."


def test_ties_are_read_by_name() -> None:
    assert arguments.options(None, None, None, ["a.sigma = b.sigma"], None).tie == {"a.sigma": "b.sigma"}
    assert "--tie: 'a' must read" in refusal(lambda: arguments.options(None, None, None, ["a"], None))


def test_the_help_of_uncertainties_lists_every_name() -> None:
    (option,) = get_args(arguments.UncertaintyOf)[1:]
    assert {*re.findall(r"[a-z_]+", option.help)} >= {*NAMES}


@pytest.mark.parametrize(
    ("parse", "text", "expected"),
    [
        (arguments.assignment, "f0", "--fix: 'f0' must read NAME=VALUE."),
        (arguments.indices, "1,b", "--holdout takes image numbers separated by commas, as 0,3; got '1,b'."),
        (arguments.noise, "0.1", "as 0.002,0.0005; got '0.1'."),
        (arguments.noise, "a,b", "as 0.002,0.0005; got 'a,b'."),
        (arguments.line, "0,1,2", "--line takes X0,Y0,X1,Y1 in pixels; got '0,1,2'."),
        (arguments.size, "4", "--memory takes a number with MB or GB, as 800MB or 4GB; got '4'."),
        (arguments.size, "-4GB", "--memory takes a number with MB or GB, as 800MB or 4GB; got '-4GB'."),
        (arguments.encoding, "log", "--transfer must be linear, srgb or a number (gamma); got 'log'."),
    ],
)
def test_a_text_of_another_form_is_refused_with_the_form_expected(
    parse: Callable[[str], Any], text: str, expected: str
) -> None:
    assert refusal(lambda: parse(text)).endswith(expected)
