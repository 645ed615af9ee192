"""The exception for input that cannot be used, and the exit codes of commands."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from unicodedata import category

# Whether something is wrong, and the sentence that says so.
Fault = tuple[bool, str]

# Categories of Unicode that move the cursor, switch colours or turn the direction of writing.
_CONTROLS = ("Cc", "Cf")
# What libraries say where there is no memory left: torch, OpenCV, Python of threads, the loader of libraries.
_NO_ROOM = ("can't allocate memory", "Failed to allocate", "can't start new thread", "failed to map segment")
# What to say where there is no memory left.
NO_MEMORY = "there is not enough memory for this; close other programs, or give fewer or smaller images."
WORK_FAILED = 1  # the input is good, but could not be worked on: a full disk, an interruption, a figure out of bounds
BAD_INPUT = 2  # as for a command line that cannot be read


class InputError(ValueError):
    """Bad input. Its text is one sentence: the file, what was expected, what came, what to do.

    The command line prints it and ends with exit code 2; in Python it is a `ValueError`.
    """


class WorkError(Exception):
    """Work that failed although the input is good. Its text is one sentence; the exit code is 1."""


def refuse(label: object, faults: Iterable[Fault]) -> None:
    """Raise an InputError about `label` for the first of some possible faults that is there."""
    for wrong, sentence in faults:
        if wrong:
            raise InputError(f"{label}: {sentence}")


@contextmanager
def errors_of(label: object) -> Iterator[None]:
    """Put `label` in front of the sentence of an InputError that is raised inside."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{label}: {error}") from None


def nearest(word: str, names: Iterable[str]) -> str:
    """A clause with the one of `names` that is nearest to `word`, or with all of them if none is near."""
    names = list(names)
    close = difflib.get_close_matches(word, names, n=1, cutoff=0.6)
    return f"did you mean '{close[0]}'?" if close else f"known are {', '.join(names)}."


def printable(text: str) -> str:
    """A text with escapes for control characters, which names of files may have and terminals obey."""
    return "".join(
        character
        if character == "\n" or character.isprintable() or category(character) not in _CONTROLS
        else character.encode("unicode_escape").decode("ascii")
        for character in text
    )


def out_of_memory(error: BaseException) -> bool:
    """Whether an exception says that there is no memory left, in which case no file is to blame."""
    return isinstance(error, MemoryError) or any(words in str(error) for words in _NO_ROOM)


def own_fault(error: BaseException) -> str:
    """The sentence on an exception that nobody expected."""
    reason = next(iter(str(error).splitlines()), "").rstrip(".")
    return f"this is a fault of matest, please report it: {type(error).__name__}{': ' * bool(reason)}{reason}."
