"""Errors that a user can mend."""

from __future__ import annotations

import pytest

from matest.errors import InputError, errors_of, nearest, refuse


def test_bad_input_is_a_value_error() -> None:
    assert issubclass(InputError, ValueError)


def test_the_first_fault_is_refused_and_later_ones_are_not_looked_at() -> None:
    refuse("a.toml", [(False, "one."), (False, "two.")])
    faults = iter([(False, "one."), (True, "two."), (True, "three.")])
    with pytest.raises(InputError, match=r"^a\.toml: two\.$"):
        refuse("a.toml", faults)
    assert next(faults) == (True, "three.")


def test_bad_input_is_named_by_the_file_that_it_came_from() -> None:
    with pytest.raises(InputError, match=r"^a\.toml: too large\.$"), errors_of("a.toml"):
        raise InputError("too large.")
    with pytest.raises(OSError, match=r"^disk full$"), errors_of("a.toml"):
        raise OSError("disk full")


@pytest.mark.parametrize(("word", "known"), [("oren-nayer", "oren-nayar"), ("lambrt", "lambert"), ("sigme", "sigma")])
def test_near_words_are_suggested(word: str, known: str) -> None:
    assert nearest(word, ["lambert", "oren-nayar", "sigma"]) == f"did you mean '{known}'?"


def test_all_words_are_listed_when_none_is_near() -> None:
    assert nearest("velvet", ["lambert", "ward"]) == "known are lambert, ward."


def test_known_words_may_come_from_any_iterable() -> None:
    assert nearest("warp", (word for word in ["lambert", "ward"])) == "did you mean 'ward'?"
    assert nearest("velvet", (word for word in ["lambert", "ward"])) == "known are lambert, ward."
