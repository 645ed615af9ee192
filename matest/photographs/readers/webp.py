"""WebP: 8 bits, RGB with or without alpha, lossless."""

from __future__ import annotations

from pathlib import Path

from matest.errors import InputError
from matest.photographs.readers.opencv import decode
from matest.photographs.readers.orientation import exif_orientation, upright
from matest.photographs.readers.raster import Raster, check_size

# Names of the blocks of a lossy picture and of a film.
_LOSSY, _FILM = b"VP8 ", b"ANIM"


def read_webp(path: Path) -> Raster:
    data = path.read_bytes()
    blocks = _blocks(data)
    check_size(path, _size(data), 1, channels=4)
    pixels, exif = decode(path, data, "WebP")
    if _FILM in blocks:
        raise InputError(f"{path}: expected one image; this WebP is a film. Save the image that counts.")
    if _LOSSY in blocks:
        raise InputError(
            f"{path}: lossy WebP keeps a quarter of the colours and 220 of the 256 codes; save it without loss."
        )
    return upright(Raster(pixels), exif_orientation(exif))


def _size(data: bytes) -> tuple[int, int]:
    """Height and width that the first block states; 0 where it is of no kind that states them."""
    kind, place = data[12:16], 20
    if kind == b"VP8X":
        width, height = (int.from_bytes(data[place + begin : place + begin + 3], "little") + 1 for begin in (4, 7))
        return height, width
    if kind == b"VP8L":
        bits = int.from_bytes(data[place + 1 : place + 5], "little")
        return (bits >> 14 & 0x3FFF) + 1, (bits & 0x3FFF) + 1
    return 0, 0


def _blocks(data: bytes) -> set[bytes]:
    """The names of the blocks of a WebP file."""
    names, place = set(), 12
    while place + 8 <= len(data):
        names.add(data[place : place + 4])
        size = int.from_bytes(data[place + 4 : place + 8], "little")
        place += 8 + size + size % 2
    return names
