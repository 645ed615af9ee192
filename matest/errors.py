"""The one exception that means: what the user handed in cannot be used as it is."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


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
