"""OpenEXR: floats in named channels, which may form layers, on a window of the image."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from matest.errors import InputError
from matest.photographs.readers import alpha
from matest.photographs.readers.chromaticities import to_rec709
from matest.photographs.readers.raster import Raster, check_size, unreadable

# Channels of a picture: colours, else vectors, else grey.
_COLOURS = ("R", "G", "B")
_VECTORS = ("X", "Y", "Z")
_GREY = ("Y",)
# Channels of half the resolution that make a colour picture of the luminance Y.
_CHROMA = {"RY", "BY"}
# Last words of the names that renderers give to the layer with the whole picture.
_WHOLE = ("combined", "beauty")
# Types of channels that are read, by OpenEXR's names.
_DTYPES = {"HALF": np.float16, "FLOAT": np.float32}


@dataclass(frozen=True)
class _Layer:
    """Channels with a common name before the last dot: "" for those without one.

    Attributes:
        name: that they have in common.
        channels: what their names have after the last dot.
    """

    name: str
    channels: tuple[str, ...]

    @property
    def picture(self) -> tuple[str, ...]:
        """The channels that make a picture; none if they make no one."""
        for names in (_COLOURS, _VECTORS, _GREY):
            if set(names) <= set(self.channels):
                return names
        return self.channels if len(self.channels) == 1 else ()

    def full(self, channel: str) -> str:
        """The name that a channel has in the file."""
        return f"{self.name}.{channel}" if self.name else channel


def read_exr(path: Path) -> Raster:
    """The layer without a name, or else the one that must be meant, of the first part.

    Raises:
        InputError: no layer is a picture, or several are and none must be meant.
    """
    import OpenEXR

    try:
        with OpenEXR.File(os.fspath(path), header_only=True) as file:
            names = [channel.name for channel in file.parts[0].header["channels"]]
            chromaticities = file.parts[0].header.get("chromaticities")
            windows = [file.parts[0].header[key] for key in ("dataWindow", "displayWindow")]
            parts = [part.name() for part in file.parts[1:]]
    except (RuntimeError, ValueError, OSError, KeyError) as error:
        raise unreadable(path, f"OpenEXR says: {error}") from None
    if chromaticities is not None and not _finite(chromaticities):
        raise unreadable(path, "its chromaticities are no numbers")
    layer, notes = _choice(path, _layers(names), parts)
    if layer.picture == _GREY and _CHROMA & set(layer.channels):
        raise InputError(f"{path}: it stores luminance and chroma (Y, RY, BY); save it with channels R, G, B.")
    covered = "A" in layer.channels and layer.picture in (_COLOURS, _GREY)
    channels = (*layer.picture, "A") if covered else layer.picture
    data, display = (_box(window) for window in windows)
    for box in (data, display):
        check_size(path, box.shape, 4, channels=len(channels))
    pixels = _decode(path, [layer.full(channel) for channel in channels], data)
    if covered and (pixels[..., -1] != 1).any():
        pixels[..., :-1] = alpha.without_alpha(path, pixels[..., :-1], pixels[..., -1])
        notes.append(alpha.NOTE)
    if data != display:
        pixels = _displayed(path, pixels, data, display)
        notes.append("the data window is padded with 0 and cropped to the display window")
    coloured = chromaticities is not None and layer.picture == _COLOURS
    return Raster(pixels, tuple(notes), to_rec709=to_rec709(path, chromaticities) if coloured else None)


def _finite(chromaticities: Any) -> bool:
    """Whether an attribute, which may be of any type, is eight finite numbers."""
    numbers = isinstance(chromaticities, tuple) and all(isinstance(value, int | float) for value in chromaticities)
    return numbers and len(chromaticities) == 8 and bool(np.isfinite(chromaticities).all())


def _layers(names: Sequence[str]) -> list[_Layer]:
    channels: dict[str, list[str]] = {}
    for name in names:
        layer, _, channel = name.rpartition(".")
        channels.setdefault(layer, []).append(channel)
    return [_Layer(layer, tuple(some)) for layer, some in channels.items()]


def _choice(path: Path, layers: list[_Layer], parts: list[str]) -> tuple[_Layer, list[str]]:
    """The layer to read, and a note if it has a name or there are other pictures.

    Args:
        path: of the file, for the refusal.
        layers: of the first part.
        parts: names of the others, which OpenEXR does not decode with all its checks.
    """
    pictures = [layer for layer in layers if layer.picture]
    if not pictures:
        names = ", ".join(layer.full(channel) for layer in layers for channel in layer.channels)
        raise InputError(f"{path}: expected channels R, G, B or Y; got {names}. Rename the channels.")
    whole = [layer for layer in pictures if layer.name.lower().rpartition(".")[2] in _WHOLE]
    candidates = [layer for layer in pictures if not layer.name] or (pictures if len(pictures) == 1 else whole)
    if len(candidates) != 1:
        names = ", ".join(layer.name for layer in pictures)
        raise InputError(
            f"{path}: expected one picture; got the layers {names}. Save the one that counts without a name."
        )
    layer = candidates[0]
    others = [other.name for other in pictures if other is not layer] + parts
    if not others and not layer.name:
        return layer, []
    read = f"layer {layer.name} is read" if layer.name else "the channels without a layer are read"
    return layer, [read + (f", not {', '.join(others)}" if others else "")]


@dataclass(frozen=True)
class _Box:
    """Columns and rows from the first to behind the last."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def shape(self) -> tuple[int, int]:
        return self.bottom - self.top, self.right - self.left


def _box(window: tuple[Iterable[Any], Iterable[Any]]) -> _Box:
    (left, top), (right, bottom) = ((int(column), int(row)) for column, row in window)
    return _Box(left, top, right + 1, bottom + 1)


def _decode(path: Path, names: list[str], data: _Box) -> np.ndarray:
    """Channels of the first part [H, W, C], float32; this class of OpenEXR raises what the newer one only prints."""
    import OpenEXR

    try:
        file = OpenEXR.InputFile(os.fspath(path))
        stored = [file.header()["channels"][name] for name in names]
        dtypes = [_DTYPES.get(str(channel.type)) for channel in stored]
        planes = file.channels(names) if None not in dtypes else []
        file.close()
    except (RuntimeError, ValueError, OSError, KeyError, TypeError) as error:
        raise unreadable(path, f"OpenEXR says: {error}") from None
    if None in dtypes or any((channel.xSampling, channel.ySampling) != (1, 1) for channel in stored):
        listed = ", ".join(f"{name} ({channel.type})" for name, channel in zip(names, stored, strict=True))
        raise InputError(f"{path}: expected floats at every pixel; got {listed}. Convert the image.")
    pixels = np.empty((*data.shape, len(names)), np.float32)
    for number, (plane, dtype) in enumerate(zip(planes, dtypes, strict=True)):
        pixels[..., number] = np.frombuffer(plane, dtype).reshape(data.shape)
    return pixels


def _displayed(path: Path, pixels: np.ndarray, data: _Box, display: _Box) -> np.ndarray:
    """Pixels of the data window on the display window, 0 where there are none."""
    top, bottom = max(data.top, display.top), min(data.bottom, display.bottom)
    left, right = max(data.left, display.left), min(data.right, display.right)
    if top >= bottom or left >= right:
        raise InputError(f"{path}: its data window lies outside of its display window; nothing of it is in the image.")
    image = np.zeros((*display.shape, pixels.shape[2]), pixels.dtype)
    image[top - display.top : bottom - display.top, left - display.left : right - display.left] = pixels[
        top - data.top : bottom - data.top, left - data.left : right - data.left
    ]
    return image
