"""JPEG 2000: 1 to 16 bits, grey or RGB, with or without alpha, by the transform that can be undone."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from matest.errors import InputError
from matest.photographs.readers.codes import raster_of_codes
from matest.photographs.readers.raster import Raster, check_size, unreadable

# Markers of a codestream: its begin with the size, how it is coded, and its first tile.
_BEGIN = b"\xff\x4f\xff\x51"
_CODING, _TILE = 0xFF52, 0xFF90
# Place after the begin marker of right and lower end of the image, then left and upper end, four bytes each.
_EXTENT = 8
# Place after the begin marker of width and height of a tile, then left and upper end of the first one.
_TILES = 24
# Bytes of the markers of a tile.
_TILE_BYTES = 14
# Places after the begin marker: number of components, the first of them (three bytes each), the next marker.
_COMPONENTS, _FIRST_COMPONENT = 40, 42
# Place, after the marker of the coding, of the kind of wavelet; 1 can be undone.
_WAVELET = 13
_REVERSIBLE = 1
# Box of JP2 that holds others, and those that say something of the colours.
_HEADER, _PALETTE, _COLOUR, _CHANNELS = b"jp2h", b"pclr", b"colr", b"cdef"
# Colour spaces by their numbers: sRGB and grey.
_PLAIN_COLOURS = (16, 17)
# Meaning of a channel: colours that it was multiplied into.
_ASSOCIATED_ALPHA = 2


@dataclass(frozen=True)
class _Codestream:
    """Height and width; of every component the bits, whether it is signed, whether it has a value at every pixel."""

    size: tuple[int, int]
    bits: tuple[int, ...]
    signed: bool
    whole: bool
    reversible: bool


def read_jpeg2000(path: Path) -> Raster:
    """Codes as fractions of the full scale that their bits have.

    Raises:
        InputError: damaged, or stored in a way that does not give back what was measured.
    """
    import imagecodecs

    data = path.read_bytes()
    begin = data.find(_BEGIN)
    try:
        stream = _codestream(data, begin)
        check_size(path, stream.size, 2, channels=len(stream.bits))
        pixels = imagecodecs.jpeg2k_decode(data)
    except InputError:
        raise
    # The decoder's own error, channels of several types, and places beyond the end of the file.
    except (imagecodecs.Jpeg2kError, NotImplementedError, IndexError, ValueError) as error:
        raise unreadable(path, error) from None
    bits = set(stream.bits)
    if len(bits) > 1 or max(bits) > 16 or stream.signed or not stream.whole or len(stream.bits) > 4:
        raise InputError(
            f"{path}: expected one to four channels of one size of 1 to 16 bits without sign; convert the image."
        )
    if not stream.reversible:
        raise InputError(
            f"{path}: JPEG 2000 with the wavelet 9/7 may have lost what was measured; save it without loss (5/3)."
        )
    _check_colours(path, dict(_boxes(data[:begin])))
    return raster_of_codes(pixels, 2 ** bits.pop() - 1)


def _codestream(data: bytes, begin: int) -> _Codestream:
    if begin < 0:
        raise ValueError("it has no codestream of JPEG 2000")
    count = _number(data, begin + _COMPONENTS, 2)
    first = begin + _FIRST_COMPONENT
    components = [data[place : place + 3] for place in range(first, first + 3 * count, 3)]
    place, wavelet = first + 3 * count, None
    while (marker := _number(data, place, 2)) != _TILE:
        if marker == _CODING:
            wavelet = data[place + _WAVELET]
        length = _number(data, place + 2, 2)
        if not length:
            raise ValueError("a marker has no length")
        place += 2 + length
    right, bottom, left, top = (_number(data, begin + _EXTENT + 4 * number, 4) for number in range(4))
    width, height, first_left, first_top = (_number(data, begin + _TILES + 4 * number, 4) for number in range(4))
    if not (width and height):
        raise ValueError("its tiles have no size")
    # The decoder asks for memory for every tile.
    if math.ceil((right - first_left) / width) * math.ceil((bottom - first_top) / height) > len(data) / _TILE_BYTES:
        raise ValueError(f"the file is truncated after {len(data)} bytes")
    return _Codestream(
        size=(max(bottom - top, 0), max(right - left, 0)),
        bits=tuple((component[0] & 0x7F) + 1 for component in components),
        signed=any(component[0] & 0x80 for component in components),
        whole=all(component[1:] == b"\x01\x01" for component in components),
        reversible=wavelet == _REVERSIBLE,
    )


def _number(data: bytes, place: int, size: int) -> int:
    if place + size > len(data):
        raise ValueError(f"the file is truncated after {len(data)} bytes")
    return int.from_bytes(data[place : place + size], "big")


def _boxes(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Names and contents of the boxes before the codestream, with those inside of the header."""
    place = 0
    while place + 8 <= len(data):
        length, name = _number(data, place, 4), data[place + 4 : place + 8]
        content = data[place + 8 : place + length]
        if length < 8:
            return
        yield name, content
        if name == _HEADER:
            yield from _boxes(content)
        place += length


def _check_colours(path: Path, boxes: dict[bytes, bytes]) -> None:
    """Refuse palettes, other colours than grey and RGB, and alpha that was multiplied into the colours."""
    colour = boxes.get(_COLOUR, b"")
    # A space has a number only where its first byte is 1; otherwise there is a profile, or nothing.
    other = len(colour) >= 7 and colour[0] == 1 and int.from_bytes(colour[3:7], "big") not in _PLAIN_COLOURS
    if other or _PALETTE in boxes:
        raise InputError(f"{path}: expected grey or RGB without a palette; convert the JPEG 2000.")
    channels = boxes.get(_CHANNELS, b"")
    # A count, then number, kind and colour of each channel, two bytes each.
    kinds = [int.from_bytes(channels[place : place + 2], "big") for place in range(4, len(channels), 6)]
    if _ASSOCIATED_ALPHA in kinds:
        raise InputError(
            f"{path}: alpha was multiplied into integers, and dividing it out is not exact; save it without alpha."
        )
