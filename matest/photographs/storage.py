"""Storage of the pixels of photographs: in memory up to a limit, in temporary files beyond it."""

from __future__ import annotations

import mmap
import tempfile
from threading import Lock

import numpy as np

from matest.errors import InputError

# Most bytes of pixels in memory (96 MiB), so that memory does not grow with the number of images.
MEMORY_BUDGET = 96 << 20


class Storage:
    """Keeps arrays in memory until they fill the budget, and later ones in temporary files that vanish with them."""

    def __init__(self) -> None:
        self._bytes = 0
        self._lock = Lock()

    def keep(self, array: np.ndarray) -> np.ndarray:
        """The array itself, or the same values mapped from a temporary file.

        Raises:
            InputError: the temporary folder cannot hold it.
        """
        with self._lock:
            self._bytes += array.nbytes
            if self._bytes <= MEMORY_BUDGET:
                return array
        try:
            mapped = _in_temporary_file(array)
        except OSError as error:
            raise InputError(
                f"{tempfile.tempdir or 'temporary folder'}: expected room for the pixels of the photographs that "
                f"exceed the memory for them ({MEMORY_BUDGET >> 20} MB); got '{error.strerror or error}'. Free space "
                "there, or set TMPDIR to a folder with more."
            ) from None
        release(mapped)
        return mapped


def _in_temporary_file(array: np.ndarray) -> np.ndarray:
    """The same values mapped from a temporary file.

    They are written, not stored through the map: where the disk is full, a store kills the process.

    Raises:
        OSError: the file cannot be made or is too large for the disk.
    """
    with tempfile.TemporaryFile() as file:
        file.write(np.ascontiguousarray(array).data)
        file.flush()
        return np.memmap(file, dtype=array.dtype, shape=array.shape, mode="r+")


def release(array: np.ndarray) -> None:
    """Drop the pages of a mapped file from memory; they are read again when they are needed."""
    mapped = getattr(array, "_mmap", None)
    if mapped is not None and hasattr(mmap, "MADV_DONTNEED"):
        mapped.madvise(mmap.MADV_DONTNEED)
