"""Radiance's HDR: floats of 8 digits with a common exponent."""

from __future__ import annotations

import re
from pathlib import Path

from matest.photographs.readers.opencv import decode
from matest.photographs.readers.raster import Raster, check_size

# The line of the size: in any order and with any signs, the axis of the rows first or last.
_SIZE = re.compile(rb"\n[-+][XY] +(\d{1,9}) +[-+][XY] +(\d{1,9})\s*\n")


def read_hdr(path: Path) -> Raster:
    data = path.read_bytes()
    if size := _SIZE.search(data):
        check_size(path, [*map(int, size.groups())], 4, channels=3)
    return Raster(decode(path, data, "HDR")[0])
