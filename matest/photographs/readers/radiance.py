"""Radiance's HDR: floats of 8 digits with a common exponent."""

from __future__ import annotations

from pathlib import Path

from matest.photographs.readers.opencv import decode
from matest.photographs.readers.raster import Raster


def read_hdr(path: Path) -> Raster:
    return Raster(decode(path, path.read_bytes(), "HDR")[0])
