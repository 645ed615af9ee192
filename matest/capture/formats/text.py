"""Lines and numbers of the text files of the layouts."""

from __future__ import annotations

import math
import re
from pathlib import Path

from matest.errors import InputError

# A number with a decimal point or comma.
NUMBER = re.compile(r"[-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?")


def lines_of(path: Path) -> list[tuple[int, str]]:
    """The lines of a text file that are not empty, with their numbers from 1 on.

    Bytes that are no UTF-8 are those of Western Windows.

    Raises:
        InputError: it cannot be read, is no text, or is empty.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); put it there or correct its rights.") from None
    if b"\0" in content:
        raise InputError(f"{path}: expected a text file in UTF-8; got UTF-16 or binary data. Save it as UTF-8.")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("cp1252", errors="replace")
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), start=1)]
    lines = [(number, line) for number, line in lines if line]
    if not lines:
        raise InputError(f"{path}: expected lines of text; it is empty. Export it again.")
    return lines


def number(text: str) -> float | None:
    """The finite number that a word is, with a decimal point or comma; None where it is none."""
    if not NUMBER.fullmatch(text):
        return None
    value = float(text.replace(",", "."))
    return value if math.isfinite(value) else None


def rows_of(path: Path, columns: tuple[int, ...], what: str) -> list[list[float]]:
    """The numbers of a text file, one list a line.

    Args:
        path: the file.
        columns: how many numbers a line may have, the same in all lines.
        what: one line holds, for the error.

    Raises:
        InputError: see `lines_of`; a line with something else.
    """
    rows: list[list[float]] = []
    for line, text in lines_of(path):
        values = [number(word) for word in text.split()]
        wanted = columns if not rows else (len(rows[0]),)
        if len(values) not in wanted or None in values:
            raise InputError(
                f"{path}: line {line} should hold {what} ({' or '.join(map(str, wanted))} numbers); got '{text[:60]}'. "
                "Correct the line."
            )
        rows.append([value for value in values if value is not None])
    return rows
