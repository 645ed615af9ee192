"""Integer codes of any full scale, as one of the types that pixels have: uint8, uint16 or float32."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from matest.errors import InputError
from matest.photographs.readers.raster import Raster

# Full scale of 32-bit codes.
_MAX_32 = 2**32 - 1
# Times this a 16-bit code is the 32-bit code of the same fraction of full scale.
_STRETCH = _MAX_32 // 65535


def raster_of_codes(codes: np.ndarray, maximum: int) -> Raster:
    """Codes from 0 to `maximum` as the same fractions of full scale.

    They are integers where 255 or 65535 is a multiple of `maximum`, otherwise the float32 next to code / maximum, of
    which every code below 2²⁴ can be told again.
    """
    for dtype in (np.uint8, np.uint16):
        factor, remainder = divmod(int(np.iinfo(dtype).max), maximum)
        if factor and not remainder:
            codes = codes.astype(dtype, copy=False)
            return Raster(codes if factor == 1 else np.multiply(codes, factor, dtype=dtype))
    note = (
        f"codes from 0 to {maximum} are read as fractions of {maximum} and then are like floats: linear unless "
        "encoding.transfer says otherwise"
    )
    return Raster((codes / maximum).astype(np.float32), (note,))


def raster_of_32_bits(path: Path, codes: np.ndarray) -> Raster:
    """32-bit codes: uint16 where all are stretched 16-bit codes, otherwise float32.

    Raises:
        InputError: codes that float32 cannot tell from their neighbours.
    """
    if not (codes % _STRETCH).any():
        return Raster((codes // _STRETCH).astype(np.uint16))
    raster = raster_of_codes(codes, _MAX_32)
    if (np.rint(raster.pixels * float(_MAX_32 + 1)) != codes).any():
        raise InputError(
            f"{path}: its 32-bit integers have more digits than float32 keeps; save the image with 16-bit integers or "
            "32-bit floats."
        )
    return raster
