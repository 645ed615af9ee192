"""What a reader of image files gives, and the sentence with which it refuses a file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from matest.errors import InputError


@dataclass(frozen=True)
class Raster:
    """The content of an image file.

    Attributes:
        pixels: H×W or H×W×C in RGB order, row 0 at the top; C is 1 or 3, or 2 or 4 where alpha is the last channel.
            Alpha is not multiplied into the other channels. Integers have the full scale of their type.
        notes: what the reader did to the stored values and a user should know, each a clause without a full stop.
        exposure: that the file states, in units of its own that all files of the format share; None if none.
        to_rec709: matrix [3, 3] that makes its linear colours those of Rec.709; None if they are already, or vectors.
    """

    pixels: np.ndarray
    notes: tuple[str, ...] = ()
    exposure: float | None = None
    to_rec709: np.ndarray | None = None


Reader = Callable[[Path], Raster]


def unreadable(path: Path, reason: object) -> InputError:
    """The refusal of a file that is damaged, or is not what its suffix says."""
    first_line = next(iter(str(reason).splitlines()), "") or type(reason).__name__
    return InputError(f"{path}: the image cannot be read ({first_line.rstrip('.')}); export or copy it again.")
