"""Arrays and files as text within a page: differences, compressed by zlib, in base64; `numbers.js` reads them back."""

from __future__ import annotations

import base64
import zlib

import numpy as np

# Effort of zlib: more takes longer and saves hardly anything.
_LEVEL = 5


def packed(codes: np.ndarray) -> str:
    """Unsigned integers of 8 or 16 bits [..., n] as text.

    Each is told by its difference from the one before it in its row, and of two bytes all low ones come before all high
    ones: smooth rows then compress well.
    """
    differences = codes.copy()
    differences[..., 1:] -= codes[..., :-1]
    planes = np.ascontiguousarray(differences.reshape(-1, 1)).view(np.uint8)
    return _compressed(planes.T.tobytes(), zlib.Z_DEFAULT_STRATEGY)


def packed_noise(codes: np.ndarray) -> str:
    """Integers of 8 bits with nothing in common as text: as `packed` has them in rows of one."""
    return _compressed(codes.tobytes(), zlib.Z_RLE)


def _compressed(content: bytes, strategy: int) -> str:
    writer = zlib.compressobj(_LEVEL, strategy=strategy)
    return base64.b64encode(writer.compress(content) + writer.flush()).decode("ascii")


def data_uri(content: bytes, kind: str) -> str:
    """A file within a page, such as `image/jpeg`."""
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"
