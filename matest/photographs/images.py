"""Image files as arrays [H, W, C] in RGB order; integers stay as they are in the file."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from matest.errors import InputError

# Suffixes of the formats that can be read.
FORMATS = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".exr", ".hdr", ".npy")
# Bytes at the end of every complete file of a format.
_END_MARKERS = {".png": b"IEND\xaeB`\x82", ".jpg": b"\xff\xd9", ".jpeg": b"\xff\xd9"}
# Bytes at the end of a file that are searched for the marker: some programs append a few of their own.
_TAIL = 4096


def read_image(path: Path) -> np.ndarray:
    """An image as H×W×C, C = 1 or 3, uint8, uint16 or float32; an alpha channel is dropped.

    Raises:
        InputError: missing, truncated or unreadable, an unsupported format, NaN or infinite values.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such image; put it there or correct 'file'.")
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise InputError(f"{path}: expected one of {', '.join(FORMATS)}; got '{suffix}'. Convert the image.")
    image = {".npy": _read_npy, ".exr": _read_exr}.get(suffix, _read_opencv)(path)
    image = image.astype(image.dtype.newbyteorder("="), copy=False)
    if image.ndim == 2:
        image = image[..., None]
    if image.ndim != 3 or image.shape[2] not in (1, 2, 3, 4) or not image.size:
        raise InputError(f"{path}: expected a grey or RGB image, H×W or H×W×3; got shape {image.shape}. Convert it.")
    image = image[..., : 1 if image.shape[2] < 3 else 3]
    if image.dtype.kind == "f":
        image = image.astype(np.float32, copy=False)
        if not np.isfinite(image).all():
            count = int((~np.isfinite(image)).any(axis=2).sum())
            raise InputError(
                f"{path}: expected finite values; {count} pixels are NaN or infinite. Mask them out by replacing them "
                "with 0 and excluding them in the mask."
            )
    elif image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path}: expected 8 or 16 bit integers or floats; got {image.dtype}. Convert the image.")
    return image


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
        OpenEXR.File(header, channels).write(os.fspath(path))
        return
    import cv2

    if image.ndim == 3 and image.shape[2] == 3:
        image = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    success, content = cv2.imencode(path.suffix, np.ascontiguousarray(image))
    if not success:
        raise OSError(f"{path}: the image could not be encoded.")
    path.write_bytes(content.tobytes())


def read_mask(path: Path) -> np.ndarray:
    """A mask as H×W floats in [0, 1] (anti-aliased edges kept); nonzero = object."""
    image = read_image(path).max(axis=2).astype(np.float64)
    if not image.any():
        raise InputError(f"{path}: expected a mask whose nonzero pixels are the object; it is zero everywhere.")
    return image / image.max()


def full_scale(dtype: np.dtype) -> float:
    """The code of full scale: 255, 65535, or 1 for floats, which are taken as stored."""
    return float(np.iinfo(dtype).max) if dtype.kind == "u" else 1.0


def _unreadable(path: Path, reason: str) -> InputError:
    return InputError(f"{path}: the image cannot be read ({reason}); export or copy it again.")


def _read_opencv(path: Path) -> np.ndarray:
    import cv2

    data = path.read_bytes()
    ending = _END_MARKERS.get(path.suffix.lower())
    # Decoders fill the missing part of a truncated file with grey or zeros and only warn.
    if ending and ending not in data[-_TAIL:]:
        raise _unreadable(path, f"the file is truncated after {len(data)} bytes, its end marker is missing")
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    if image is None:
        raise _unreadable(path, f"it is no {path.suffix[1:].upper()} file that OpenCV decodes")
    if image.ndim == 3 and image.shape[2] >= 3:
        image = image[..., 2::-1]
    # OpenCV expands grey with alpha (PNG colour type 4, at byte 25 of the header) to four channels.
    return image[..., :1] if path.suffix.lower() == ".png" and data[25:26] == b"\x04" else image


def _read_npy(path: Path) -> np.ndarray:
    try:
        return np.load(path, allow_pickle=False)
    except (ValueError, OSError, EOFError) as error:
        raise _unreadable(path, f"NumPy says: {str(error).splitlines()[0]}") from None


def _read_exr(path: Path) -> np.ndarray:
    import OpenEXR

    try:
        with OpenEXR.File(os.fspath(path), separate_channels=True) as file:
            channels = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
    except (RuntimeError, ValueError, OSError) as error:
        raise _unreadable(path, f"OpenEXR says: {str(error).splitlines()[0]}") from None
    for names in (("R", "G", "B"), ("X", "Y", "Z"), ("Y",)):
        if all(name in channels for name in names):
            return np.stack([channels[name] for name in names], axis=-1)
    if len(channels) == 1:
        return next(iter(channels.values()))
    raise InputError(f"{path}: expected channels R, G, B or Y; got {', '.join(channels)}. Rename the channels.")
