"""Storage of the pixels of photographs: in memory up to a limit, in temporary files beyond it."""

from __future__ import annotations

import mmap
import tempfile
from threading import Lock

import numpy as np

# Most bytes of pixels in memory (96 MiB), so that memory does not grow with the number of images.
MEMORY_BUDGET = 96 << 20


class Storage:
    """Keeps arrays in memory until they fill the budget, and later ones in temporary files that vanish with them."""

    def __init__(self) -> None:
        self._bytes = 0
        self._lock = Lock()

    def keep(self, array: np.ndarray) -> np.ndarray:
        """The array itself, or the same values mapped from a temporary file."""
        with self._lock:
            self._bytes += array.nbytes
            if self._bytes <= MEMORY_BUDGET:
                return array
        with tempfile.TemporaryFile() as file:
            mapped = np.memmap(file, dtype=array.dtype, shape=array.shape, mode="w+")
        mapped[:] = array
        mapped.flush()
        release(mapped)
        return mapped


def release(array: np.ndarray) -> None:
    """Drop the pages of a mapped file from memory; they are read again when they are needed."""
    mapped = getattr(array, "_mmap", None)
    if mapped is not None and hasattr(mmap, "MADV_DONTNEED"):
        mapped.madvise(mmap.MADV_DONTNEED)
