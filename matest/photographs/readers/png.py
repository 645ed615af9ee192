"""PNG: 8 or 16 bits, grey or RGB, with or without alpha; palettes and fewer bits are expanded."""

from __future__ import annotations

from pathlib import Path

from matest.photographs.readers.opencv import decode
from matest.photographs.readers.orientation import exif_orientation, upright
from matest.photographs.readers.raster import Raster, check_size, unreadable

# The first bytes of every file.
_BEGIN = b"\x89PNG"
# The last chunk of every complete file.
_END = b"IEND\xaeB`\x82"
# Places of the size in the file, four bytes each.
_WIDTH, _HEIGHT = 16, 20
# Place of the colour type in the file.
_COLOUR_TYPE = 25
# Colour type of grey with alpha.
_GREY_ALPHA = 4


def read_png(path: Path) -> Raster:
    data = path.read_bytes()
    if data.rfind(_END) < 0:
        raise unreadable(path, f"the file is truncated after {len(data)} bytes, its end marker is missing")
    if data.startswith(_BEGIN):
        check_size(path, [int.from_bytes(data[place : place + 4], "big") for place in (_HEIGHT, _WIDTH)], 2)
    pixels, exif = decode(path, data, "PNG")
    # OpenCV expands grey with alpha to four channels.
    if data[_COLOUR_TYPE] == _GREY_ALPHA:
        pixels = pixels[..., [0, 3]]
    return upright(Raster(pixels), exif_orientation(exif))
