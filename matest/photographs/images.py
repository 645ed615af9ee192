"""Image files as arrays [H, W, C] in RGB order; integers stay as they are in the file."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from matest.errors import InputError
from matest.photographs.readers import READERS

# Largest number that a file may hold or state: squares of radiance and its noise must stay within single precision.
LARGEST = 1e15
# Compression of PNG by libpng's numbers: quick, and as small as slower ones where there is noise.
_RUN_LENGTHS = 3
# Filter of PNG likewise: the difference from the pixel to the left.
_LEFT = 16


@dataclass(frozen=True)
class ImageFile:
    """An image as read from its file.

    Attributes:
        pixels: H×W×C, C = 1 or 3, uint8, uint16 or float32; alpha is not multiplied into them.
        coverage: alpha H×W of the same type; None if there is none.
        notes: what was done to the stored values, as clauses that a user should read.
        exposure: that the file states, proportional to its values; None if none.
    """

    pixels: np.ndarray
    coverage: np.ndarray | None = None
    notes: tuple[str, ...] = ()
    exposure: float | None = None


def read_image(path: Path, *, coloured: bool = True) -> np.ndarray:
    """The pixels of `read_image_file`."""
    return read_image_file(path, coloured=coloured).pixels


def read_image_file(path: Path, *, coloured: bool = True) -> ImageFile:
    """An image, the way up that it belongs, with what was done to make it so.

    Args:
        path: of the file.
        coloured: whether its channels are colours, which are those of Rec.709 then, not vectors or shares.

    Raises:
        InputError: missing, damaged or unreadable, an unsupported format, NaN, infinite or immense values.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such image; put it there or correct 'file'.")
    suffix = path.suffix.lower()
    if suffix not in READERS:
        raise InputError(f"{path}: expected one of {', '.join(READERS)}; got '{suffix}'. Convert the image.")
    raster = READERS[suffix](path)
    image = raster.pixels.astype(raster.pixels.dtype.newbyteorder("="), copy=False)
    if image.ndim == 2:
        image = image[..., None]
    if image.ndim != 3 or image.shape[2] not in (1, 2, 3, 4) or not image.size:
        raise InputError(f"{path}: expected a grey or RGB image, H×W or H×W×3; got shape {image.shape}. Convert it.")
    if image.dtype.kind == "f":
        # What is beyond single precision becomes infinite, which is refused as any NaN is, a signalling one too.
        with np.errstate(over="ignore", invalid="ignore"):
            image = image.astype(np.float32, copy=False)
    elif image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path}: expected 8 or 16 bit integers or floats; got {image.dtype}. Convert the image.")
    colours = 1 if image.shape[2] < 3 else 3
    pixels, coverage = image[..., :colours], image[..., colours] if image.shape[2] > colours else None
    # False for NaN too.
    usable = np.abs(image) < LARGEST if image.dtype.kind == "f" else np.array(True)
    notes = raster.notes
    if coloured and raster.to_rec709 is not None:
        # As above; primaries next to one another make any number larger.
        with np.errstate(over="ignore", invalid="ignore"):
            pixels = (pixels @ raster.to_rec709.T).astype(np.float32)
        usable = usable & (np.abs(pixels) < LARGEST).all(axis=2, keepdims=True)
        notes = (*notes, "colours of the primaries that the file states are converted to those of Rec.709")
    if not usable.all():
        count = int((~usable).any(axis=2).sum())
        number, them = ("1 pixel holds", "it") if count == 1 else (f"{count:,} pixels hold", "them")
        raise InputError(
            f"{path}: expected numbers below {LARGEST:g}; {number} NaN, infinity or larger ones. Set {them} to 0 in "
            f"the file; in a photograph leave {them} out of the mask too."
        )
    return ImageFile(pixels, coverage, notes, raster.exposure)


def write_image(path: Path, image: np.ndarray) -> None:
    """Write H×W or H×W×C (RGB): EXR or NPY from floats, PNG or TIFF from uint8 or uint16."""
    if path.suffix.lower() == ".npy":
        np.save(path, image)
        return
    if path.suffix.lower() == ".exr":
        import OpenEXR

        pixels = np.ascontiguousarray(image, dtype=np.float32)
        if pixels.ndim == 3 and pixels.shape[2] == 1:
            pixels = pixels[..., 0]
        channels = {"Y": pixels} if pixels.ndim == 2 else {"RGB": pixels}
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        try:
            OpenEXR.File(header, channels).write(os.fspath(path))
        except RuntimeError as error:
            # The library names the file, then the reason.
            reason = str(error).rpartition('". ')[2].rstrip(".")
            raise OSError(None, f"the image cannot be written ({reason})", os.fspath(path)) from None
        return
    if path.suffix.lower() == ".png":
        import imagecodecs

        # Each byte less that of the pixel to the left; then runs of like bytes.
        options = {"level": 1, "strategy": _RUN_LENGTHS, "filter": _LEFT}
        path.write_bytes(imagecodecs.png_encode(np.ascontiguousarray(image), **options))
        return
    import cv2

    if image.ndim == 3 and image.shape[2] == 3:
        image = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    success, content = cv2.imencode(path.suffix, np.ascontiguousarray(image))
    if not success:
        raise OSError(f"{path}: the image could not be encoded.")
    path.write_bytes(content.tobytes())


def read_mask(path: Path) -> np.ndarray:
    """A mask as H×W floats in [0, 1] (anti-aliased edges kept); nonzero = object.

    It is the alpha channel where alpha differs between pixels, so that a photograph with alpha is its own mask, and
    the brightest channel otherwise.
    """
    file = read_image_file(path, coloured=False)
    level = file.pixels.max(axis=2) if file.coverage is None or _constant(file.coverage) else file.coverage
    image = level.astype(np.float32)
    if not image.any():
        raise InputError(f"{path}: expected a mask whose nonzero pixels are the object; it is zero everywhere.")
    image /= image.max()
    return image


def _constant(coverage: np.ndarray) -> bool:
    return bool((coverage == coverage.flat[0]).all())


def full_scale(dtype: np.dtype) -> float:
    """The code of full scale: 255, 65535, or 1 for floats, which are taken as stored."""
    return float(np.iinfo(dtype).max) if dtype.kind == "u" else 1.0
