"""Minimal camera RAW: uncompressed DNG with a colour filter, written without LibRaw."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import tifffile

RGGB = (0, 1, 1, 2)
# Tags of TIFF and DNG.
_CFA_DIMENSIONS, _CFA_PATTERN, _DNG_VERSION, _DNG_BACKWARD = 33421, 33422, 50706, 50707
_MODEL, _PLANE_COLOUR, _LAYOUT, _BLACK_DIMENSIONS, _BLACK, _WHITE = 50708, 50710, 50711, 50713, 50714, 50717
_COLOUR_MATRIX, _ILLUMINANT, _ORIENTATION, _EXIF, _MAKE, _MODEL_NAME = 50721, 50778, 274, 34665, 271, 272
_CFA = 32803
# A tag that means nothing.
_FREE = 65000


def write_dng(
    path: Path,
    counts: np.ndarray,
    pattern: tuple[int, ...] = RGGB,
    *,
    dimensions: tuple[int, int] = (2, 2),
    black: tuple[int, ...] = (0,),
    white: int = 4095,
    orientation: int = 1,
    time: tuple[int, int] | None = None,
    sensitivity: int = 100,
    opening: tuple[int, int] = (1, 1),
) -> Path:
    """Write what a sensor counted [H, W].

    Args:
        path: of the file.
        counts: uint16.
        pattern: colour of each pixel of the filter: 0 red, 1 green, 2 blue.
        dimensions: rows and columns of the filter.
        black: one level, or one for each of two by two pixels.
        white: level of saturation.
        orientation: tag of EXIF.
        time: of exposure in s as a fraction; None: the file states none.
        sensitivity: ISO.
        opening: f-number as a fraction.
    """
    identity = [x for row in np.eye(3, dtype=int).tolist() for value in row for x in (value, 1)]
    side = 2 if len(black) == 4 else 1
    tags: list[tuple[int, str, int, Any, bool]] = [
        (_CFA_DIMENSIONS, "H", 2, dimensions, True),
        (_CFA_PATTERN, "B", len(pattern), bytes(pattern), True),
        (_DNG_VERSION, "B", 4, bytes([1, 4, 0, 0]), True),
        (_DNG_BACKWARD, "B", 4, bytes([1, 1, 0, 0]), True),
        (_MODEL, "s", 0, "Test", True),
        (_MAKE, "s", 0, "Test", True),
        (_MODEL_NAME, "s", 0, "Test", True),
        (_PLANE_COLOUR, "B", 3, bytes([0, 1, 2]), True),
        (_LAYOUT, "H", 1, 1, True),
        (_BLACK_DIMENSIONS, "H", 2, (side, side), True),
        (_BLACK, "H", len(black), black if len(black) > 1 else black[0], True),
        (_WHITE, "I", 1, white, True),
        (_COLOUR_MATRIX, "2i", 9, tuple(identity), True),
        (_ILLUMINANT, "H", 1, 21, True),
        (_ORIENTATION, "H", 1, orientation, True),
    ]
    if time is not None:
        tags.append((_FREE, "I", 1, 0, True))
    options: dict[str, Any] = {"photometric": _CFA, "compression": None, "metadata": None, "software": None}
    tifffile.imwrite(path, counts, extratags=tags, byteorder="<", **options)
    if time is not None:
        # tifffile writes no pointer to a block with the exposure, which is appended to the file.
        data = path.read_bytes()
        free, pointer = (struct.pack("<HHII", *entry) for entry in ((_FREE, 4, 1, 0), (_EXIF, 4, 1, len(data))))
        assert data.count(free) == 1
        path.write_bytes(data.replace(free, pointer) + _exif(len(data), time, sensitivity, opening))
    return path


def _exif(place: int, time: tuple[int, int], sensitivity: int, opening: tuple[int, int]) -> bytes:
    """Directory of exposure time, f-number and ISO, at a place of the file, followed by its fractions."""
    values = place + 2 + 3 * 12 + 4
    entries = [(33434, 5, 1, values), (33437, 5, 1, values + 8), (34855, 3, 1, sensitivity)]
    directory = struct.pack("<H", 3) + b"".join(struct.pack("<HHII", *entry) for entry in entries) + bytes(4)
    return directory + struct.pack("<IIII", *time, *opening)
