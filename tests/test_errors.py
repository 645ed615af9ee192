"""Errors that a user can mend."""

from __future__ import annotations

import pytest

from matest.errors import InputError, errors_of, nearest, out_of_memory, own_fault, printable, refuse


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


def test_what_terminals_obey_is_printed_as_escapes() -> None:
    assert printable("a\x1b[31m\u202eb\tσ±é\n") == "a\\x1b[31m\\u202eb\\tσ±é\n"


def test_lack_of_memory_is_told_from_other_faults() -> None:
    assert out_of_memory(MemoryError())
    assert out_of_memory(RuntimeError("DefaultCPUAllocator: can't allocate memory: you tried to allocate 8 bytes."))
    assert not out_of_memory(RuntimeError("size mismatch"))
    assert not out_of_memory(ValueError("allocate"))


def test_a_fault_of_our_own_is_one_line() -> None:
    assert own_fault(ValueError("a\nb")) == "this is a fault of matest, please report it: ValueError: a."
    assert own_fault(AssertionError()) == "this is a fault of matest, please report it: AssertionError."
