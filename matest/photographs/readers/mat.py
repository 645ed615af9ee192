"""MATLAB's arrays: the one image that a file holds, as stored."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matest.errors import InputError
from matest.photographs.readers.raster import Raster, check_size, unreadable

# First bytes of a file of version 7.3, which is HDF5.
_VERSION_7_3 = b"MATLAB 7.3"
# Classes of arrays that may be an image, with the bytes of a number.
_BYTES = {"single": 4, "double": 8, "uint8": 1, "uint16": 2, "uint32": 4, "uint64": 8}


def read_mat(path: Path) -> Raster:
    import scipy.io

    try:
        with path.open("rb") as file:
            if file.read(len(_VERSION_7_3)) == _VERSION_7_3:
                raise InputError(f"{path}: MATLAB's version 7.3 is not read; save it with save(…, '-v7').")
        # Sizes are looked at before an array is unpacked.
        images = [variable for variable in scipy.io.whosmat(path) if _is_image(*variable[1:])]
        if len(images) != 1:
            listed = ", ".join(name for name, _, _ in images) if images else "none"
            raise InputError(
                f"{path}: expected one array H×W or H×W×3; got {listed}. Save the one that is meant by itself."
            )
        name, shape, kind = images[0]
        check_size(path, shape, _BYTES[kind])
        return Raster(scipy.io.loadmat(path, variable_names=[name])[name])
    except (InputError, MemoryError):
        raise
    except Exception as error:  # whatever a damaged file makes of the parser
        raise unreadable(path, f"SciPy says: {error}") from None


def _is_image(shape: Sequence[int], kind: str) -> bool:
    """Whether a variable of a file may be an image: an array of numbers with more than one row and column."""
    return kind in _BYTES and len(shape) in (2, 3) and min(shape[:2]) > 1
