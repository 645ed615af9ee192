"""Files that commands write."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from matest.errors import InputError


def keep_inputs(outputs: Iterable[Path], inputs: Iterable[Path]) -> None:
    """Refuse to write over a file that is read, by whatever path or link.

    Args:
        outputs: files to be written.
        inputs: files that are read.

    Raises:
        InputError: a file is both.
    """
    present = [path for path in inputs if path.exists()]
    for output in outputs:
        if output.exists() and any(output.samefile(path) for path in present):
            raise InputError(f"{output}: is read and would be overwritten; write elsewhere with -o.")
