"""PGM and PPM: integers up to any maximum that the file states."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np

from matest.errors import InputError
from matest.photographs.readers.codes import raster_of_codes
from matest.photographs.readers.raster import Raster, check_size, unreadable

# Kind, width, height and maximum, with white space and comments between them, and one white space at the end.
_HEADER = re.compile(rb"P([2356])" + 3 * rb"(?:\s|#[^\n]*\n)+(\d{1,9})" + rb"(?:#[^\n]*)?\s")
_COMMENT = re.compile(rb"#[^\n]*")


def read_pnm(path: Path) -> Raster:
    data = path.read_bytes()
    header = _HEADER.match(data)
    if header is None:
        raise unreadable(path, "it does not begin like a PGM or PPM file")
    kind, width, height, maximum = map(int, header.groups())
    if not 0 < maximum < 65536:
        raise unreadable(path, f"its maximum is {maximum}, not between 1 and 65535")
    shape = (height, width, 3) if kind in (3, 6) else (height, width)
    check_size(path, shape, 2)
    count = math.prod(shape)
    codes = _binary(data[header.end() :], maximum) if kind >= 5 else _text(path, data[header.end() :], count, maximum)
    if len(codes) < count:
        raise unreadable(path, f"the file is truncated: it has {len(codes)} of {count} values")
    codes = codes[:count].reshape(shape)
    if codes.size and int(codes.max()) > maximum:
        raise InputError(
            f"{path}: a code is {codes.max()}, above the maximum of {maximum} that the file states; mend it."
        )
    return raster_of_codes(codes, maximum)


def _binary(data: bytes, maximum: int) -> np.ndarray:
    dtype = np.dtype(np.uint8 if maximum < 256 else ">u2")
    return np.frombuffer(data, dtype, len(data) // dtype.itemsize)


def _text(path: Path, data: bytes, count: int, maximum: int) -> np.ndarray:
    text = _COMMENT.sub(b" ", data)
    try:
        codes = np.array(text.split(), dtype=np.uint32)
    except (ValueError, OverflowError):
        raise unreadable(path, "its values are not all whole numbers") from None
    # Of a file that is cut off there may be half a number left.
    if len(codes) == count and text[-1:].isdigit() and 0 < 10 * int(codes[-1]) <= maximum:
        raise unreadable(path, "it ends in the middle of a line, maybe of a number; add a line break if it is whole")
    return codes
