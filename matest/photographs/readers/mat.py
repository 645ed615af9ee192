"""MATLAB's arrays: the one image that a file holds, as stored."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from matest.errors import InputError
from matest.photographs.readers.raster import Raster, unreadable

# First bytes of a file of version 7.3, which is HDF5.
_VERSION_7_3 = b"MATLAB 7.3"


def read_mat(path: Path) -> Raster:
    import scipy.io

    try:
        with path.open("rb") as file:
            if file.read(len(_VERSION_7_3)) == _VERSION_7_3:
                raise InputError(f"{path}: MATLAB's version 7.3 is not read; save it with save(…, '-v7').")
        content = scipy.io.loadmat(path)
    except InputError:
        raise
    except Exception as error:  # whatever a damaged file makes of the parser
        raise unreadable(path, f"SciPy says: {error}") from None
    images = {name: array for name, array in content.items() if _is_image(array)}
    if len(images) != 1:
        listed = ", ".join(images) if images else "none"
        raise InputError(
            f"{path}: expected one array H×W or H×W×3; got {listed}. Save the one that is meant by itself."
        )
    return Raster(next(iter(images.values())))


def _is_image(array: object) -> bool:
    """Whether a variable of a file may be an image: an array of numbers with more than one row and column."""
    return (
        isinstance(array, np.ndarray) and array.dtype.kind in "fu" and array.ndim in (2, 3) and min(array.shape[:2]) > 1
    )
