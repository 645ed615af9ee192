"""Camera RAW: what the sensor counted from black to white, with two by two pixels of the colour filter as one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from matest.errors import InputError
from matest.photographs.readers.orientation import upright
from matest.photographs.readers.raster import Raster, unreadable

if TYPE_CHECKING:
    import rawpy

# Suffixes of cameras' own files that LibRaw decodes, and of Adobe's.
SUFFIXES = (".dng", ".cr2", ".cr3", ".nef", ".arw", ".orf", ".raf", ".rw2", ".pef", ".srw")
# The orientation tag of EXIF by LibRaw's code of the turn that a file asks for.
_ORIENTATIONS = {3: 3, 5: 8, 6: 6}
# Sensitivity that exposures are relative to: a file without one counts as this.
_ISO = 100.0


def read_raw(path: Path) -> Raster:
    """Red, the mean of both greens, and blue of every two by two pixels, as fractions from black to white.

    The colours are the sensor's own: no white balance, no matrix, nothing filled in. Where one of two greens is
    saturated, so is their mean.

    Raises:
        InputError: rawpy is missing, the file is damaged, or the colour filter is not Bayer's.
    """
    try:
        import rawpy
    except ImportError:
        raise InputError(
            f'{path}: camera RAW needs rawpy, which is not installed; pip install "matest-brdf[raw]", or convert the '
            "image to a linear TIFF."
        ) from None
    try:
        with rawpy.imread(str(path)) as raw:
            pixels = _binned(path, raw)
            orientation = _ORIENTATIONS.get(raw.sizes.flip, 1)
            exposure = _exposure(raw)
    except rawpy.LibRawError as error:
        reason = error.args[0] if error.args else error
        text = reason.decode(errors="replace") if isinstance(reason, bytes) else str(reason)
        raise unreadable(path, f"LibRaw says: {text}") from None
    except NotImplementedError:
        raise _no_bayer(path) from None  # a filter that rawpy does not know
    note = (
        "camera RAW is read as the sensor counted, from black to white, two by two pixels as one: camera and mask "
        "belong to images of half the size, and the channels are the sensor's own, not those of Rec.709"
    )
    return upright(Raster(pixels, (note,), exposure), orientation)


def _binned(path: Path, raw: rawpy.RawPy) -> np.ndarray:
    """Pixels [H / 2, W / 2, 3], float32."""
    names = raw.color_desc.decode("latin-1")
    if raw.raw_type != type(raw.raw_type).Flat or raw.raw_pattern is None or raw.raw_pattern.shape != (2, 2):
        raise _no_bayer(path)
    # Place in the list of colours of each of the four pixels; the visible part may begin at any of them.
    colours = raw.raw_colors_visible[:2, :2]
    letters = [names[colour] for colour in colours.flat]
    if sorted(letters) != ["B", "G", "G", "R"]:
        raise _no_bayer(path)
    counts = raw.raw_image_visible
    height, width = (size // 2 * 2 for size in counts.shape)
    white = _white(raw)
    black = np.array(raw.black_level_per_channel, dtype=np.float32)
    if not (white > black).all():
        raise unreadable(path, f"its black levels {black.tolist()} are not below its white levels {white.tolist()}")
    planes: dict[str, list[np.ndarray]] = {"R": [], "G": [], "B": []}
    for place, (letter, colour) in enumerate(zip(letters, colours.flat, strict=True)):
        plane = counts[place // 2 : height : 2, place % 2 : width : 2].astype(np.float32)
        planes[letter].append(np.minimum((plane - black[colour]) / (white[colour] - black[colour]), 1))
    one, other = planes["G"]
    green = np.where(np.maximum(one, other) >= 1, np.float32(1), (one + other) / 2)
    return np.stack([planes["R"][0], green, planes["B"][0]], axis=-1)


def _white(raw: rawpy.RawPy) -> np.ndarray:
    """Level of saturation of every channel [4]: the camera's own where the file has it."""
    own = np.array(raw.camera_white_level_per_channel or [0] * 4, dtype=np.float32)
    return np.where(own > 0, np.minimum(own, raw.white_level), np.float32(raw.white_level))


def _exposure(raw: rawpy.RawPy) -> float | None:
    """What a picture's values are proportional to: seconds × sensitivity / f-number²; None where no time is stated."""
    settings = raw.other
    if not settings.shutter_speed > 0:
        return None
    sensitivity = settings.iso_speed if settings.iso_speed > 0 else _ISO
    opening = settings.aperture if settings.aperture > 0 else 1.0
    return float(settings.shutter_speed * sensitivity / _ISO / opening**2)


def _no_bayer(path: Path) -> InputError:
    return InputError(
        f"{path}: expected a sensor with Bayer's colour filter, red, green, green and blue in two by two pixels; "
        "convert the image to a linear TIFF."
    )
