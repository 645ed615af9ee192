"""The orientation that a camera wrote into a file (EXIF): which way up its pixels belong."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from matest.photographs.readers.raster import Raster

# The tag's number, in EXIF and in TIFF.
TAG = 274
# What to do with the stored pixels, by value of the tag; 1 is upright. Turns are clockwise.
_TURNS = {
    2: "mirrored left to right",
    3: "turned by 180°",
    4: "mirrored top to bottom",
    5: "mirrored along the diagonal",
    6: "turned by 90° clockwise",
    7: "mirrored along the other diagonal",
    8: "turned by 90° counterclockwise",
}
# An EXIF block is a TIFF file, and begins with its byte order.
_BYTE_ORDERS: dict[bytes, Literal["little", "big"]] = {b"II": "little", b"MM": "big"}


def upright(raster: Raster, orientation: int) -> Raster:
    """The pixels the way up that they belong, with a note if they were not. Unknown orientations count as upright."""
    if orientation not in _TURNS:
        return raster
    pixels = raster.pixels
    if orientation >= 5:
        pixels = np.swapaxes(pixels, 0, 1)
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    note = f"pixels are {_TURNS[orientation]}, as the orientation tag ({orientation}) asks"
    return replace(raster, pixels=pixels, notes=(*raster.notes, note))


def exif_orientation(exif: bytes) -> int:
    """The orientation in an EXIF block; 1 (upright) where it says none."""
    tiff = exif.removeprefix(b"Exif\0\0")
    order = _BYTE_ORDERS.get(tiff[:2])
    if order is None:
        return 1

    def number(place: int, size: int) -> int:
        return int.from_bytes(tiff[place : place + size], order)

    directory = number(4, 4)
    for entry in range(directory + 2, directory + 2 + 12 * number(directory, 2), 12):
        if number(entry, 2) == TAG:
            return number(entry + 8, 2)
    return 1
