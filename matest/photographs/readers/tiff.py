"""TIFF and BigTIFF: integers of 1 to 32 bits and floats, planes or pixels together, without loss."""

from __future__ import annotations

import logging
import math
import threading
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from matest.errors import InputError
from matest.photographs.readers import alpha
from matest.photographs.readers.codes import raster_of_32_bits, raster_of_codes
from matest.photographs.readers.orientation import TAG, upright
from matest.photographs.readers.raster import Raster, check_size, unreadable

if TYPE_CHECKING:
    from tifffile import TiffPage

# Values of the tag PhotometricInterpretation.
_WHITE_IS_ZERO = 0
_BLACK_IS_ZERO = 1
_RGB = 2
_COLOUR_CHANNELS = {_WHITE_IS_ZERO: 1, _BLACK_IS_ZERO: 1, _RGB: 3}
# None, CCITT (three), LZW, Deflate, PackBits, Deflate by its older number, LZMA, Zstandard.
_LOSSLESS = (1, 2, 3, 4, 5, 8, 32773, 32946, 34925, 50000)
# Bits of the integers that uint8, uint16 or float32 can hold; of 32 bits most can.
_INTEGER_BITS = (*range(1, 17), 32)
# Values of the tag ExtraSamples, the meaning of a channel beyond the colours.
_ASSOCIATED_ALPHA = 1
_ALPHA = 2


def read_tiff(path: Path) -> Raster:
    """The first page.

    Raises:
        InputError: damaged, or stored in a way that does not give back what the camera measured.
    """
    import tifffile

    complaints = _Complaints()
    try:
        with complaints, tifffile.TiffFile(path) as file:
            page = file.pages.first
            _check(path, page, file.filehandle.size)
            # tifffile drops axes of length 1.
            pixels = page.asarray(maxworkers=1).reshape(page.shape)
            others = sum(isinstance(other, tifffile.TiffPage) and not other.is_reduced for other in file.pages[1:])
            orientation = page.tags.valueof(TAG, 1)
    except (InputError, MemoryError):
        raise
    # Tags of a damaged file make tifffile and its decoders raise whatever they like.
    except Exception as error:
        raise unreadable(path, error) from None
    if page.axes == "SYX":
        pixels = np.moveaxis(pixels, 0, -1)
    raster = _with_alpha(path, page, _at_full_scale(path, page, pixels))
    notes = (*raster.notes, f"only the first of {others + 1} pages is read") if others else raster.notes
    if complaints.texts:
        notes = (*notes, f"the file may be damaged (tifffile says: {complaints.texts[0]})")
    return upright(Raster(raster.pixels, notes), orientation)


class _Complaints(logging.Handler):
    """What tifffile complains of in this thread, the first lines; without a handler it is printed."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.texts: list[str] = []
        self._thread = threading.get_ident()

    def emit(self, record: logging.LogRecord) -> None:
        if record.thread == self._thread:
            self.texts.append(next(iter(record.getMessage().splitlines()), ""))

    def __enter__(self) -> None:
        logging.getLogger("tifffile").addHandler(self)

    def __exit__(self, *_: object) -> None:
        logging.getLogger("tifffile").removeHandler(self)


def _check(path: Path, page: TiffPage, file_bytes: int) -> None:
    """Refuse what would be read inexactly, and files of which a part is missing."""
    if not all(isinstance(size, int) for size in (page.imagelength, page.imagewidth)):
        raise unreadable(path, "its header states several widths or heights")
    if page.photometric not in _COLOUR_CHANNELS:
        raise InputError(f"{path}: expected grey or RGB; the TIFF stores {_name(page.photometric)}. Convert it to RGB.")
    if page.samplesperpixel < _COLOUR_CHANNELS[page.photometric]:
        raise unreadable(path, f"it has {page.samplesperpixel} of three channels")
    if page.compression not in _LOSSLESS:
        raise InputError(
            f"{path}: TIFF with {_name(page.compression)} compression may have lost what was measured; save it without "
            "compression or with Deflate."
        )
    kind = page.dtype.kind if page.dtype is not None else ""
    if kind not in ("b", "u", "f") or (kind == "u" and page.bitspersample not in _INTEGER_BITS):
        raise InputError(
            f"{path}: expected unsigned integers of 1 to 16 or 32 bits or floats; got {page.bitspersample} bits of "
            f"{_name(page.sampleformat)}. Convert the TIFF."
        )
    if page.axes not in ("YX", "YXS", "SYX"):
        raise InputError(f"{path}: expected one image; the TIFF is a volume of shape {page.shape}. Save one slice.")
    check_size(path, (page.imagelength, page.imagewidth), math.ceil(page.bitspersample / 8), page.samplesperpixel)
    segments = list(zip(page.dataoffsets, page.databytecounts, strict=False))
    if len(segments) != math.prod(page.chunked) or not all(count for _, count in segments):
        raise unreadable(path, "some of its strips or tiles are missing")
    if any(offset + count > file_bytes for offset, count in segments):
        raise unreadable(path, f"the file is truncated after {file_bytes} bytes")


def _at_full_scale(path: Path, page: TiffPage, pixels: np.ndarray) -> Raster:
    """Floats as stored, integers as fractions of the full scale that their bits have; black is zero."""
    if pixels.dtype.kind == "f":
        if page.photometric == _WHITE_IS_ZERO:
            raise InputError(f"{path}: floats whose white is zero have no black; save the TIFF with black as zero.")
        return Raster(pixels)
    maximum = 2**page.bitspersample - 1
    if page.photometric == _WHITE_IS_ZERO:
        grey = (slice(None), slice(None), slice(0, 1)) if pixels.ndim == 3 else ...
        pixels = pixels.copy()
        pixels[grey] = maximum - pixels[grey]
    return raster_of_32_bits(path, pixels) if page.bitspersample == 32 else raster_of_codes(pixels, maximum)


def _with_alpha(path: Path, page: TiffPage, raster: Raster) -> Raster:
    """Colours, with alpha last if there is one, and without other channels."""
    colours, pixels = _COLOUR_CHANNELS[page.photometric], raster.pixels
    meaning = page.extrasamples[0] if page.extrasamples else None
    if pixels.ndim == 2 or meaning not in (_ASSOCIATED_ALPHA, _ALPHA):
        return Raster(pixels if pixels.ndim == 2 else pixels[..., :colours], raster.notes)
    if meaning == _ALPHA:
        return Raster(pixels[..., : colours + 1], raster.notes)
    coverage = pixels[..., colours]
    if pixels.dtype.kind == "f":
        divided = alpha.without_alpha(path, pixels[..., :colours], coverage)
        return Raster(np.concatenate([divided, coverage[..., None]], axis=2), (*raster.notes, alpha.NOTE))
    if (coverage != np.iinfo(pixels.dtype).max).any():
        raise InputError(
            f"{path}: alpha was multiplied into integers, and dividing it out is not exact; save it without alpha."
        )
    return Raster(pixels[..., : colours + 1], raster.notes)


def _name(value: object) -> str:
    """What people call the value of a tag."""
    return str(getattr(value, "name", value))
