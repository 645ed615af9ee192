"""BMP: 8 bits a channel, palettes expanded."""

from __future__ import annotations

from pathlib import Path

from matest.errors import InputError
from matest.photographs.readers.opencv import decode
from matest.photographs.readers.raster import Raster, check_size

# The first bytes of every file.
_BEGIN = b"BM"
# Places of the size in the file, four bytes each.
_WIDTH, _HEIGHT = 18, 22
# Place of the number of bits of a pixel in the file.
_PIXEL_BITS = slice(28, 30)


def read_bmp(path: Path) -> Raster:
    data = path.read_bytes()
    sizes = [int.from_bytes(data[place : place + 4], "little", signed=True) for place in (_HEIGHT, _WIDTH)]
    # A negative height says that the rows begin at the top.
    if data.startswith(_BEGIN):
        check_size(path, [abs(size) for size in sizes], 3)
    pixels, _ = decode(path, data, "BMP")
    if int.from_bytes(data[_PIXEL_BITS], "little") == 16:
        raise InputError(f"{path}: expected 8 bits a channel; got a BMP of 5 or 6 bits. Save it with 24 bits a pixel.")
    return Raster(pixels)
