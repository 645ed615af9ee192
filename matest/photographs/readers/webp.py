"""WebP: 8 bits, RGB with or without alpha, lossless."""

from __future__ import annotations

from pathlib import Path

from matest.errors import InputError
from matest.photographs.readers.opencv import decode
from matest.photographs.readers.orientation import exif_orientation, upright
from matest.photographs.readers.raster import Raster

# Names of the blocks of a lossy picture and of a film.
_LOSSY, _FILM = b"VP8 ", b"ANIM"


def read_webp(path: Path) -> Raster:
    data = path.read_bytes()
    pixels, exif = decode(path, data, "WebP")
    blocks = _blocks(data)
    if _FILM in blocks:
        raise InputError(f"{path}: expected one image; this WebP is a film. Save the image that counts.")
    if _LOSSY in blocks:
        raise InputError(
            f"{path}: lossy WebP keeps a quarter of the colours and 220 of the 256 codes; save it without loss."
        )
    return upright(Raster(pixels), exif_orientation(exif))


def _blocks(data: bytes) -> set[bytes]:
    """The names of the blocks of a WebP file."""
    names, place = set(), 12
    while place + 8 <= len(data):
        names.add(data[place : place + 4])
        size = int.from_bytes(data[place + 4 : place + 8], "little")
        place += 8 + size + size % 2
    return names
