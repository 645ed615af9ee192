"""Arguments of the commands: from text to numbers, pairs and lists."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from matest.commands import arguments
from tests.captures import refusal


@pytest.mark.parametrize(
    ("parse", "text", "value"),
    [
        (arguments.assignment, "f0=0.04", ("f0", 0.04)),
        (arguments.assignment, "albedo = 0.7, 0.6,0.5", ("albedo", [0.7, 0.6, 0.5])),
        (arguments.pair, "a.sigma = b.sigma", ("a.sigma", "b.sigma")),
        (arguments.indices, "0, 3,", [0, 3]),
        (arguments.noise, "0.002,5e-4", (0.002, 0.0005)),
        (arguments.line, "0,1,20.5,3", (0.0, 1.0, 20.5, 3.0)),
        (arguments.encoding, "srgb", "srgb"),
        (arguments.encoding, "2.2", 2.2),
        (arguments.encoding, None, None),
    ],
)
def test_a_text_becomes_what_it_says(parse: Callable[[str | None], Any], text: str | None, value: object) -> None:
    assert parse(text) == value


@pytest.mark.parametrize(
    ("parse", "text", "expected"),
    [
        (arguments.assignment, "f0", "'f0' must read NAME=VALUE."),
        (arguments.indices, "1,b", "--holdout takes image numbers separated by commas, as 0,3; got '1,b'."),
        (arguments.noise, "0.1", "as 0.002,0.0005; got '0.1'."),
        (arguments.noise, "a,b", "as 0.002,0.0005; got 'a,b'."),
        (arguments.line, "0,1,2", "--line takes X0,Y0,X1,Y1 in pixels; got '0,1,2'."),
        (arguments.encoding, "log", "--transfer must be linear, srgb or a number (gamma); got 'log'."),
    ],
)
def test_a_text_of_another_form_is_refused_with_the_form_expected(
    parse: Callable[[str], Any], text: str, expected: str
) -> None:
    assert refusal(lambda: parse(text)).endswith(expected)
