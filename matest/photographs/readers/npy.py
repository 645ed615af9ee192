"""NumPy's arrays, as stored."""

from __future__ import annotations

import math
import os
from pathlib import Path
from threading import Lock
from tokenize import TokenError
from typing import BinaryIO

import numpy as np

from matest.errors import InputError
from matest.photographs.readers.raster import Raster, check_size, unreadable

# First bytes of an archive of arrays.
_ARCHIVE = b"PK"
# Python's parser, which reads the headers, counts the depth of all threads together.
_PARSER = Lock()


def read_npy(path: Path) -> Raster:
    """The array of a file, and nothing that it would have to be executed for."""
    try:
        with path.open("rb") as file:
            if file.read(len(_ARCHIVE)) == _ARCHIVE:
                raise unreadable(path, "it is an archive of arrays, .npz; save the image with numpy.save")
            file.seek(0)
            try:
                with _PARSER:
                    shape, fortran, dtype = _header(file)
            except MemoryError:
                # So Python's parser calls what is nested too deeply.
                raise ValueError("its header is nested too deeply") from None
            if dtype.hasobject or not dtype.itemsize:
                raise ValueError(f"its type is {dtype}, not numbers")
            if min(shape, default=0) < 0:
                raise ValueError(f"its shape is {shape}")
            check_size(path, shape, dtype.itemsize)
            rest = os.fstat(file.fileno()).st_size - file.tell()
            # Before memory is asked for as much as the header says.
            if math.prod(shape) * dtype.itemsize > rest:
                raise ValueError(f"the file is truncated: it has {rest // dtype.itemsize} of {math.prod(shape)} values")
            values = np.fromfile(file, dtype, math.prod(shape))
            return Raster(values.reshape(shape, order="F" if fortran else "C"))
    except InputError:
        raise
    except (ValueError, OSError, EOFError, SyntaxError, TokenError, RecursionError) as error:
        raise unreadable(path, f"NumPy says: {error}") from None


def _header(file: BinaryIO) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, whether the first index runs fastest, and type.

    Raises:
        ValueError: damaged, or of a version that numbers do not need.
    """
    version = np.lib.format.read_magic(file)
    if version == (1, 0):
        return np.lib.format.read_array_header_1_0(file)
    if version == (2, 0):
        return np.lib.format.read_array_header_2_0(file)
    raise ValueError(f"its version is {'.'.join(map(str, version))}")
