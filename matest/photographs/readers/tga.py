"""TGA: 8 bits, grey or RGB, with or without alpha and run lengths."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from matest.errors import InputError
from matest.photographs.readers.raster import Raster, unreadable

# Place in the file of the kind of its pixels.
_KIND = 2
# Place in the file of the bits of a pixel.
_PIXEL_BITS = 16
# Kinds (RGB and grey, each also in run lengths) with their bits, alpha included.
_EXACT = {2: (24, 32), 10: (24, 32), 3: (8, 16), 11: (8, 16)}


def read_tga(path: Path) -> Raster:
    from PIL.TgaImagePlugin import TgaImageFile

    header = path.read_bytes()[: _PIXEL_BITS + 1]
    if len(header) <= _PIXEL_BITS:
        raise unreadable(path, f"the file is truncated after {len(header)} bytes")
    if header[_PIXEL_BITS] not in _EXACT.get(header[_KIND], ()):
        raise InputError(
            f"{path}: expected a TGA of 8 bits a channel, grey or RGB without a palette; convert the image."
        )
    try:
        with TgaImageFile(path) as image:
            return Raster(np.asarray(image))
    except (OSError, SyntaxError, ValueError, IndexError) as error:
        raise unreadable(path, error) from None
