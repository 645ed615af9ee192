"""OpenEXR: floats in named channels, which may form layers, on a window of the image."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from matest.errors import InputError
from matest.photographs.readers import alpha
from matest.photographs.readers.raster import Raster, unreadable

# Channels of a picture, in the order in which they are looked for.
_COLOURS, _VECTORS, _GREY = ("R", "G", "B"), ("X", "Y", "Z"), ("Y",)
# Channels of half the resolution that make a colour picture of the luminance Y.
_CHROMA = {"RY", "BY"}
# Last words of the names that renderers give to the layer with the whole picture.
_WHOLE = ("combined", "beauty")

# First column and row, last column and row.
Window = tuple[np.ndarray, np.ndarray]


@dataclass
class _Layer:
    """Channels with a common name before the last dot: "" for those without one.

    Attributes:
        window: of the image that the channels cover.
        display: the window that is the image.
        channels: planes, by what their name has after the last dot.
    """

    window: Window
    display: Window
    channels: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def picture(self) -> tuple[str, ...]:
        """The channels that make a picture; none if they make no one."""
        for names in (_COLOURS, _VECTORS, _GREY):
            if self.channels.keys() >= set(names):
                return names
        return tuple(self.channels) if len(self.channels) == 1 else ()


def read_exr(path: Path) -> Raster:
    """The layer without a name, or else the one that must be meant.

    Raises:
        InputError: no layer is a picture, or several are and none must be meant.
    """
    layers = _read(path)
    name, notes = _choice(path, layers)
    layer = layers[name]
    if layer.picture == _GREY and layer.channels.keys() & _CHROMA:
        raise InputError(f"{path}: it stores luminance and chroma (Y, RY, BY); save it with channels R, G, B.")
    pixels = np.stack([layer.channels[channel] for channel in layer.picture], axis=-1)
    coverage = layer.channels.get("A")
    if coverage is not None and layer.picture in (_COLOURS, _GREY):
        if (coverage != 1).any():
            pixels = alpha.without_alpha(path, pixels, coverage)
            notes.append(alpha.NOTE)
        pixels = np.concatenate([pixels, coverage[..., None]], axis=2)
    if not all(map(np.array_equal, layer.window, layer.display)):
        pixels = _displayed(path, pixels, layer)
        notes.append("the data window is padded with 0 and cropped to the display window")
    return Raster(pixels, tuple(notes))


def _read(path: Path) -> dict[str, _Layer]:
    """All layers by name; those of further parts have the name of the part before their own."""
    import OpenEXR

    layers: dict[str, _Layer] = {}
    try:
        with OpenEXR.File(os.fspath(path), separate_channels=True) as file:
            for number, part in enumerate(file.parts):
                for key, channel in part.channels.items():
                    before, _, channel_name = key.rpartition(".")
                    name = ".".join(word for word in (part.name() if number else "", before) if word)
                    windows = part.header["dataWindow"], part.header["displayWindow"]
                    layer = layers.setdefault(name, _Layer(*windows))
                    layer.channels[channel_name] = np.array(channel.pixels)
    except (RuntimeError, ValueError, OSError) as error:
        raise unreadable(path, f"OpenEXR says: {error}") from None
    return layers


def _choice(path: Path, layers: dict[str, _Layer]) -> tuple[str, list[str]]:
    """The name of the layer to read, and a note if it is not the only one, or has a name."""
    pictures = [name for name, layer in layers.items() if layer.picture]
    whole = [name for name in pictures if name.lower().rpartition(".")[2] in _WHOLE]
    candidates = [name for name in pictures if not name] or (pictures if len(pictures) == 1 else whole)
    if not pictures:
        names = ", ".join(_full(name, channel) for name, layer in layers.items() for channel in layer.channels)
        raise InputError(f"{path}: expected channels R, G, B or Y; got {names}. Rename the channels.")
    if len(candidates) != 1:
        raise InputError(
            f"{path}: expected one picture; got the layers {', '.join(pictures)}. Save the one that counts by itself, "
            "or without a name."
        )
    others = [name for name in pictures if name != candidates[0]]
    if not others and not candidates[0]:
        return candidates[0], []
    read = f"layer {candidates[0]} is read" if candidates[0] else "the channels without a layer are read"
    return candidates[0], [read + (f", not {', '.join(others)}" if others else "")]


def _full(layer: str, channel: str) -> str:
    return f"{layer}.{channel}" if layer else channel


def _displayed(path: Path, pixels: np.ndarray, layer: _Layer) -> np.ndarray:
    """Pixels of the data window on the display window, 0 where there are none."""
    (left, top), (right, bottom) = (_whole_numbers(corner) for corner in layer.display)
    x, y = _whole_numbers(layer.window[0])
    height, width, channels = pixels.shape
    image = np.zeros((bottom - top + 1, right - left + 1, channels), pixels.dtype)
    rows = slice(max(y, top), min(y + height, bottom + 1))
    columns = slice(max(x, left), min(x + width, right + 1))
    if rows.start >= rows.stop or columns.start >= columns.stop:
        raise InputError(f"{path}: its data window lies outside of its display window; nothing of it is in the image.")
    image[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left] = pixels[
        rows.start - y : rows.stop - y, columns.start - x : columns.stop - x
    ]
    return image


def _whole_numbers(corner: Iterable[int]) -> tuple[int, int]:
    """Column and row as Python's integers, which have no largest one."""
    column, row = map(int, corner)
    return column, row
