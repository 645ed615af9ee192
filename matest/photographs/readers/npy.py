"""NumPy's arrays, as stored."""

from __future__ import annotations

from pathlib import Path
from tokenize import TokenError

import numpy as np

from matest.photographs.readers.raster import Raster, unreadable


def read_npy(path: Path) -> Raster:
    try:
        return Raster(np.load(path, allow_pickle=False))
    except (ValueError, OSError, EOFError, TokenError, MemoryError) as error:
        raise unreadable(path, f"NumPy says: {error}") from None
