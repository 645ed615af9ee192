"""MATLAB's arrays: the one image that a file holds, as stored."""

from __future__ import annotations

import itertools
import math
import struct
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path

from matest.errors import InputError
from matest.photographs.readers.raster import Raster, check_size, unreadable

# First bytes of a file of version 7.3, which is HDF5.
_VERSION_7_3 = b"MATLAB 7.3"
# Classes of arrays that may be an image, with the bytes of a number.
_BYTES = {"single": 4, "double": 8, "uint8": 1, "uint16": 2, "uint32": 4, "uint64": 8}

# In files of version 5: place and value of the byte that tells the order of bytes, and place of the first array.
_ORDER, _LITTLE, _FIRST = 126, ord("I"), 128
# One of the first bytes of older files is 0.
_OLDEST = 4 * b"\0"
# Bytes of the type and length of what follows.
_TAG = 8
# Type of an array that is compressed.
_COMPRESSED = 15
# Types of numbers, 8 to 64 bits with and without sign, single and double precision: the bytes of each.
_NUMBERS = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}
# Characters of a name, at most, as MATLAB has them.
_NAME = 63
# Bytes of an array before its numbers, at most, without its name.
_START = 128


def read_mat(path: Path) -> Raster:
    import scipy.io

    try:
        with path.open("rb") as file:
            if file.read(len(_VERSION_7_3)) == _VERSION_7_3:
                raise InputError(f"{path}: MATLAB's version 7.3 is not read; save it with save(…, '-v7').")
        numbers = _numbers(path.read_bytes())
        # Sizes are looked at before an array is unpacked.
        images = [variable for variable in scipy.io.whosmat(path) if _is_image(*variable[1:])]
        if len(images) != 1:
            # A damaged file may call them anything.
            listed = ", ".join(ascii(name)[1:-1][:_NAME] for name, _, _ in images) if images else "none"
            raise InputError(
                f"{path}: expected one array H×W or H×W×3; got {listed}. Save the one that is meant by itself."
            )
        name, shape, kind = images[0]
        check_size(path, shape, _BYTES[kind])
        if numbers:
            # SciPy gives one without a name a name of its own; it is none of the user's.
            if name.encode("latin-1") not in numbers:
                raise ValueError("its array has no name")
            _check(name, math.prod(shape), *numbers[name.encode("latin-1")])
        return Raster(scipy.io.loadmat(path, variable_names=[name])[name])
    except (InputError, MemoryError):
        raise
    except Exception as error:  # whatever a damaged file makes of the parser
        raise unreadable(path, f"SciPy says: {error}") from None


def _numbers(data: bytes) -> dict[bytes, tuple[int, int]]:
    """Type and bytes of the numbers of each array by its name; none for versions before 5, which have no such types.

    Raises:
        ValueError: a name that is longer than names are: SciPy would ask for as much memory.
        struct.error, zlib.error: the file is damaged.
    """
    numbers: dict[bytes, tuple[int, int]] = {}
    if not all(data[: len(_OLDEST)]):
        return numbers
    order, place = "<" if data[_ORDER] == _LITTLE else ">", _FIRST
    while place < len(data):
        kind, length = struct.unpack_from(f"{order}II", data, place)
        array = data[place + _TAG : place + _TAG + length]
        if kind == _COMPRESSED:
            array = zlib.decompressobj().decompress(array, _START + _NAME)[_TAG:]
        place += _TAG + length
        parts = _parts(array, order)
        _, _, (_, name_length, name) = itertools.islice(parts, 3)
        if name_length > _NAME:
            raise ValueError(f"an array has a name of {name_length} characters")
        kind, length, _ = next(parts)
        numbers[name] = kind, length
    return numbers


def _check(name: str, count: int, kind: int, length: int) -> None:
    """Refuse an array whose numbers SciPy would crash on, or ask for any amount of memory for.

    Raises:
        ValueError: their type is none that there is, or they are not as many as the array has.
    """
    if kind not in _NUMBERS:
        raise ValueError(f"the numbers of {name} have the type {kind}, which there is not")
    if length != count * _NUMBERS[kind]:
        raise ValueError(f"{name} has {count} numbers in {length} bytes")


def _parts(array: bytes, order: str) -> Iterator[tuple[int, int, bytes]]:
    """Type, length and content of the parts of an array: flags, sizes, name, numbers."""
    place = 0
    while True:
        kind, length = struct.unpack_from(f"{order}II", array, place)
        if kind >> 16:
            # A short one has its length beside its type.
            kind, length = kind & 0xFFFF, kind >> 16
            yield kind, length, array[place + 4 : place + 4 + length]
            place += _TAG
        else:
            yield kind, length, array[place + _TAG : place + _TAG + length]
            place += _TAG + length + -length % _TAG


def _is_image(shape: Sequence[int], kind: str) -> bool:
    """Whether a variable of a file may be an image: an array of numbers with more than one row and column."""
    return kind in _BYTES and len(shape) in (2, 3) and min(shape[:2]) > 1
