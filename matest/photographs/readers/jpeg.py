"""JPEG: 8 bits, grey or colour."""

from __future__ import annotations

from pathlib import Path

from matest.errors import InputError
from matest.photographs.readers.orientation import exif_orientation, upright
from matest.photographs.readers.raster import Raster, check_size, unreadable

# Marker of an application's block, which EXIF is.
_APPLICATION = 0xE1
# Marker of the beginning of the picture itself.
_SCAN = 0xDA
_EXIF = b"Exif\0\0"
# What to decode to, by what is stored, as simplejpeg calls them.
_COLOURS = {"Gray": "GRAY", "YCbCr": "RGB", "RGB": "RGB"}


def read_jpeg(path: Path) -> Raster:
    """simplejpeg is the decoder that passes on what libjpeg complains of; others fill in grey and go on."""
    import simplejpeg

    data = path.read_bytes()
    try:
        height, width, colours, _ = simplejpeg.decode_jpeg_header(data)
        check_size(path, (height, width), 1, channels=3)
        wanted = _COLOURS.get(colours)
        pixels = simplejpeg.decode_jpeg(data, wanted, strict=True) if wanted else None
    except InputError:
        raise
    except ValueError as error:
        raise unreadable(path, error) from None
    if pixels is None:
        raise InputError(f"{path}: expected grey or RGB; the JPEG stores {colours}. Convert it to RGB.")
    return upright(Raster(pixels), exif_orientation(_exif(data)))


def _exif(data: bytes) -> bytes:
    """The EXIF block of a JPEG; empty if there is none."""
    place = 2
    while place + 4 <= len(data) and data[place] == 0xFF and data[place + 1] != _SCAN:
        end = place + 2 + int.from_bytes(data[place + 2 : place + 4], "big")
        if data[place + 1] == _APPLICATION and data.startswith(_EXIF, place + 4):
            return data[place + 4 : end]
        place = end
    return b""
