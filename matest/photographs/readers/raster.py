"""What a reader of image files gives, and the sentence with which it refuses a file."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from matest.errors import InputError

# Most pixels of an image: 16384 by 16384. More are a damaged header, or a file that was made to fill the memory.
MOST_PIXELS = 1 << 28
# Most bytes of pixels for each byte of a file: no compression packs a photograph or a mask so tightly.
_TIGHTEST = 10_000
# Bytes of pixels that any file may have.
_SMALL = 64 << 20


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


def check_size(path: Path, shape: Sequence[int], pixel_bytes: int, channels: int = 1) -> None:
    """Refuse a file that says of itself that it holds far more pixels than an image has, before they are decoded.

    Args:
        path: of the file.
        shape: that its header states, height and width first.
        pixel_bytes: bytes of a value.
        channels: beyond those in the shape.

    Raises:
        InputError: too many pixels, or too many for its bytes.
    """
    pixels = math.prod(shape[:2])
    size = "×".join(map(str, shape[:2]))
    if pixels > MOST_PIXELS:
        raise InputError(
            f"{path}: says that it holds {size} pixels; expected at most {MOST_PIXELS:,}. Export it again, or in parts."
        )
    unpacked = math.prod(shape) * channels * pixel_bytes
    packed = path.stat().st_size
    if unpacked > _SMALL and unpacked > _TIGHTEST * packed:
        raise InputError(
            f"{path}: says that it holds {size} pixels in {packed:,} bytes, too few for a photograph; export it again."
        )


def unreadable(path: Path, reason: object) -> InputError:
    """The refusal of a file that is damaged, or is not what its suffix says."""
    first_line = next(iter(str(reason).splitlines()), "") or type(reason).__name__
    return InputError(f"{path}: the image cannot be read ({first_line.rstrip('.')}); export or copy it again.")
