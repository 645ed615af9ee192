"""The stored pixels of image files: in memory here, and read from the files again in another process."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from threading import Lock
from typing import Any, overload

import numpy as np

from matest.photographs.storage import Storage, release

# Gives an image H×W×C by its file and the SHA-256 that this had; refuses a file that has another one now.
Read = Callable[[Path, str], np.ndarray]


class FileImages(Sequence[np.ndarray]):
    """Per image the object's pixels [N, C], as stored in its file.

    Pickled, they are the names and digests of their files: pixels stay where they are, and another process reads an
    image when it first asks for it.

    Args:
        files: of each image, with its SHA-256.
        read: gives the pixels of a file; it can be pickled.
        pixels: place of each of the N pixels in an image, row by row.
        arrays: the pixels of each image.
    """

    def __init__(
        self, files: Iterable[tuple[Path, str]], read: Read, pixels: np.ndarray, arrays: Iterable[np.ndarray]
    ) -> None:
        self._files = [(path.absolute(), digest) for path, digest in files]
        self._read = read
        self._pixels = pixels
        self._arrays: list[np.ndarray | None] = [*arrays]
        self._channels = self[0].shape[1]
        self._begin()

    def _begin(self) -> None:
        self._storage, self._locks = Storage(), [Lock() for _ in self._files]

    def __len__(self) -> int:
        return len(self._files)

    @overload
    def __getitem__(self, index: int) -> np.ndarray: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[np.ndarray, ...]: ...
    def __getitem__(self, index: int | slice) -> np.ndarray | tuple[np.ndarray, ...]:
        if isinstance(index, slice):
            return tuple(self[k] for k in range(*index.indices(len(self))))
        present = self._arrays[index]
        return self._loaded(index) if present is None else present

    def _loaded(self, index: int) -> np.ndarray:
        """The pixels of an image that has not been read in this process.

        Raises:
            InputError: the file is not what it was.
        """
        with self._locks[index]:
            array = self._arrays[index]
            if array is None:
                image = self._read(*self._files[index])
                pixels = image.reshape(-1, image.shape[2])[self._pixels, : self._channels]
                array = self._arrays[index] = self._storage.keep(np.ascontiguousarray(pixels))
            return array

    def take(self, selection: np.ndarray) -> FileImages:
        """Some of the pixels (boolean [N]) of all images."""
        return FileImages(self._files, self._read, self._pixels[selection], (pixels[selection] for pixels in self))

    def first_channel(self) -> FileImages:
        """One channel of all images."""
        arrays = (np.ascontiguousarray(pixels[:, :1]) for pixels in self)
        return FileImages(self._files, self._read, self._pixels, arrays)

    def release(self) -> None:
        """Free the memory of all images that are mapped from temporary files."""
        for array in self._arrays:
            if array is not None:
                release(array)

    def __getstate__(self) -> dict[str, Any]:
        state = self.__dict__ | {"_arrays": [None] * len(self)}
        del state["_storage"], state["_locks"]
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._begin()
