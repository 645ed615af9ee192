"""PNG: 8 or 16 bits, grey or RGB, with or without alpha; palettes and fewer bits are expanded."""

from __future__ import annotations

from pathlib import Path

from matest.photographs.readers.opencv import decode
from matest.photographs.readers.orientation import exif_orientation, upright
from matest.photographs.readers.raster import Raster, check_size, unreadable

# The first bytes of every file.
_BEGIN = b"\x89PNG"
# Place of the first chunk, bytes of a chunk beside its content, and the last chunk of every complete file.
_FIRST, _FRAME, _END = 8, 12, b"IEND"
# Places of the size in the file, four bytes each.
_WIDTH, _HEIGHT = 16, 20
# Places of the bits of a channel and of the colour type in the file.
_BITS, _COLOUR_TYPE = 24, 25
# Colour type of grey with alpha.
_GREY_ALPHA = 4
# Channels that are decoded to, by colour type: grey, RGB, a palette, and both with alpha.
_CHANNELS = {0: 1, 2: 3, 3: 4, _GREY_ALPHA: 4, 6: 4}


def read_png(path: Path) -> Raster:
    data = path.read_bytes()
    if data.startswith(_BEGIN):
        _check_chunks(path, data)
        size = [int.from_bytes(data[place : place + 4], "big") for place in (_HEIGHT, _WIDTH)]
        check_size(path, size, 2 if data[_BITS] > 8 else 1, channels=_CHANNELS.get(data[_COLOUR_TYPE], 4))
    pixels, exif = decode(path, data, "PNG")
    # OpenCV expands grey with alpha to four channels.
    if data[_COLOUR_TYPE] == _GREY_ALPHA:
        pixels = pixels[..., [0, 3]]
    return upright(Raster(pixels), exif_orientation(exif))


def _check_chunks(path: Path, data: bytes) -> None:
    """Refuse a file that ends before its last chunk does: the decoder asks for memory as a chunk says.

    Raises:
        InputError: it does.
    """
    place, name = _FIRST, b""
    while name != _END:
        length, name = int.from_bytes(data[place : place + 4], "big"), data[place + 4 : place + 8]
        place += length + _FRAME
        if place > len(data):
            raise unreadable(path, f"the file is truncated after {len(data)} bytes, its end marker is missing")
