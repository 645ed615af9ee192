"""The one exception that means: what the user handed in cannot be used as it is. And the exit codes of commands."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

WORK_FAILED = 1  # the input is good, but could not be worked on: a full disk, an interruption, a figure out of bounds
BAD_INPUT = 2  # as for a command line that cannot be read


class InputError(ValueError):
    """Bad input. Its text is one sentence: the file, what was expected, what came, what to do.

    The command line prints it and ends with exit code 2; in Python it is a `ValueError`.
    """


def nearest(word: str, known: Iterable[str]) -> str:
    """A clause naming the known word nearest to `word`, or all of them if none is near."""
    known = list(known)
    close = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    if close:
        return f"did you mean '{close[0]}'?"
    return f"known are {', '.join(known)}."
