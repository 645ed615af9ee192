"""From pixel values to radiance, and back."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from matest.photographs.images import full_scale


@dataclass(frozen=True)
class Encoding:
    """How a pixel encodes radiance: radiance = (linear pixel − black) · scale / exposure.

    Attributes:
        transfer: "linear", "srgb" or the exponent of a power law.
        scale: radiance of full scale.
        black: pedestal as a fraction of full scale; a number, or per object pixel and channel [N, C].
        flat: flat field per object pixel [N, C], divided out; None = 1.
        saturation: fraction of full scale (as stored) from which on a value is saturated, a number or one per channel;
            None = never.
        step: distance of neighbouring stored integers; more than 1 where a camera's codes were stretched.
    """

    transfer: str | float = "linear"
    scale: float = 1.0
    black: float | np.ndarray = 0.0
    flat: np.ndarray | None = None
    saturation: float | tuple[float, ...] | None = None
    step: float = 1.0

    def take(self, selection: np.ndarray) -> Encoding:
        """The encoding of some of the object's pixels (boolean [N])."""
        black = self.black if isinstance(self.black, float) else self.black[selection]
        return replace(self, black=black, flat=None if self.flat is None else self.flat[selection])

    def linear(self, fraction: np.ndarray) -> np.ndarray:
        """Undo the transfer function on values as fractions of full scale."""
        if self.transfer == "linear":
            return fraction
        if self.transfer == "srgb":
            return np.where(fraction <= 0.04045, fraction / 12.92, ((fraction.clip(0.04045) + 0.055) / 1.055) ** 2.4)
        return np.clip(fraction, 0, None) ** float(self.transfer)

    def encoded(self, linear: np.ndarray) -> np.ndarray:
        """Apply the transfer function: the inverse of `linear`."""
        linear = np.clip(linear, 0, None)
        if self.transfer == "linear":
            return linear
        if self.transfer == "srgb":
            return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear.clip(0.0031308) ** (1 / 2.4) - 0.055)
        return linear ** (1 / float(self.transfer))

    def signal(self, stored: np.ndarray, index: np.ndarray | slice, unit: float = 1.0) -> np.ndarray:
        """Stored pixels [n, C] of the object pixels `index` as linear signals above black; full scale is `unit`."""
        if stored.dtype.kind == "u":
            top = int(full_scale(stored.dtype))
            if self.transfer == "linear":
                linear = np.multiply(stored, np.float32(unit / top), dtype=np.float32)
            else:
                table = (unit * self.linear(np.arange(top + 1) / top)).astype(np.float32)
                linear = table[stored]
        else:
            linear = self.linear(stored)
            if unit != 1:
                linear = linear * np.float32(unit)
        black = self.black if isinstance(self.black, float) else self.black[index]
        if isinstance(black, np.ndarray) or black:
            linear = linear - np.asarray(unit * black, dtype=np.float32)
        if self.flat is not None:
            linear = linear / self.flat[index]
        return linear

    def limits(self, dtype: np.dtype, index: np.ndarray | slice) -> tuple[np.ndarray, np.ndarray] | None:
        """Signals at which the sensor clips at its lower and upper end, each [1 or n, 1 or C]; None if it never does.

        Integers clip below half a step above zero, and from half a step below the first saturated value on.
        """
        if dtype.kind != "u" and self.saturation is None:
            return None
        lower, upper = -math.inf, np.array(math.inf)
        if dtype.kind == "u":
            lower = float(self.linear(np.array(0.5 * self.step / full_scale(dtype))))
        if self.saturation is not None:
            top = np.minimum(self.saturation, 1.0) if dtype.kind == "u" else np.array(self.saturation)
            if dtype.kind == "u":
                top = (np.ceil(top * full_scale(dtype)) - 0.5 * self.step) / full_scale(dtype)
            upper = self.linear(top)
        black = self.black if isinstance(self.black, float) else self.black[index]
        flat = 1.0 if self.flat is None else self.flat[index]
        lower_end, upper_end = (np.atleast_2d((end - black) / flat) for end in (lower, upper))
        return lower_end, upper_end

    def saturated(self, stored: np.ndarray) -> np.ndarray:
        """True where the stored value is at or above saturation, [n, C]."""
        if self.saturation is None:
            return np.zeros(stored.shape, dtype=bool)
        if stored.dtype.kind == "u":
            return stored >= np.minimum(self.saturation, 1.0) * full_scale(stored.dtype)
        return stored > np.asarray(self.saturation)


def srgb(linear: np.ndarray) -> np.ndarray:
    """8-bit sRGB of linear values, white at 1, for a screen."""
    return np.round(255 * Encoding("srgb").encoded(np.clip(linear, 0, 1))).astype(np.uint8)


def as_tensor(array: np.ndarray, dtype: torch.dtype, device: torch.device | str) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(array)).to(device, dtype)
