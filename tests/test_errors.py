"""Errors that a user can mend."""

from __future__ import annotations

import pytest

from matest.errors import InputError, nearest


def test_bad_input_is_a_value_error() -> None:
    assert issubclass(InputError, ValueError)


@pytest.mark.parametrize(("word", "known"), [("oren-nayer", "oren-nayar"), ("lambrt", "lambert"), ("sigme", "sigma")])
def test_near_words_are_suggested(word: str, known: str) -> None:
    assert nearest(word, ["lambert", "oren-nayar", "sigma"]) == f"did you mean '{known}'?"


def test_all_words_are_listed_when_none_is_near() -> None:
    assert nearest("velvet", ["lambert", "ward"]) == "known are lambert, ward."


def test_known_words_may_come_from_any_iterable() -> None:
    assert nearest("warp", (word for word in ["lambert", "ward"])) == "did you mean 'ward'?"
    assert nearest("velvet", (word for word in ["lambert", "ward"])) == "known are lambert, ward."
