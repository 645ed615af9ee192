"""TGA: 8 bits, grey or RGB, with or without alpha and run lengths."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from matest.errors import InputError
from matest.photographs.readers.raster import Raster, check_size, unreadable

# Place in the file of the kind of its pixels.
_KIND = 2
# Places in the file of the size, two bytes each.
_WIDTH, _HEIGHT = 12, 14
# Place in the file of the bits of a pixel.
_PIXEL_BITS = 16
# Kinds (RGB and grey, each also in run lengths) with their bits, alpha included.
_EXACT = {2: (24, 32), 10: (24, 32), 3: (8, 16), 11: (8, 16)}


def read_tga(path: Path) -> Raster:
    from PIL.TgaImagePlugin import TgaImageFile

    header = path.read_bytes()[: _PIXEL_BITS + 1]
    if len(header) <= _PIXEL_BITS:
        raise unreadable(path, f"the file is truncated after {len(header)} bytes")
    check_size(path, [int.from_bytes(header[place : place + 2], "little") for place in (_HEIGHT, _WIDTH)], 4)
    if header[_PIXEL_BITS] not in _EXACT.get(header[_KIND], ()):
        raise InputError(
            f"{path}: expected a TGA of 8 bits a channel, grey or RGB without a palette; convert the image."
        )
    try:
        with TgaImageFile(path) as image:
            return Raster(np.asarray(image))
    except (OSError, SyntaxError, ValueError, IndexError, struct.error, EOFError) as error:
        raise unreadable(path, error) from None
