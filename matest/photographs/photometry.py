"""From pixel values to radiance and its variance, and the noise of a camera estimated from its own pictures."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from matest.photographs.images import full_scale

# Relative error of float images that no noise model describes: rounding and geometry.
FLOAT_FLOOR = 1e-4


@dataclass(frozen=True)
class Noise:
    """variance = read² + gain·signal, in fractions of full scale (signal above black, linear)."""

    read: float
    gain: float


@dataclass(frozen=True)
class Encoding:
    """How a pixel encodes radiance: radiance = (linear pixel − black) · scale / exposure.

    Attributes:
        transfer: "linear", "srgb" or the exponent of a power law.
        scale: radiance of full scale.
        black: pedestal as a fraction of full scale; a number, or per object pixel and channel [N, C].
        flat: flat field per object pixel [N, C], divided out; None = 1.
        saturation: fraction of full scale (as stored) from which on a pixel is saturated; None = never.
    """

    transfer: str | float = "linear"
    scale: float = 1.0
    black: float | np.ndarray = 0.0
    flat: np.ndarray | None = None
    saturation: float | None = None

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

    def limits(self, dtype: np.dtype, index: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Signals at which the sensor clips at its lower and upper end, each [1 or n, 1 or C]; None if it never does.

        Integers clip below half a step above zero, and from half a step below the first saturated value on.
        """
        if dtype.kind != "u" and self.saturation is None:
            return None
        lower, upper = -math.inf, math.inf
        if dtype.kind == "u":
            step = 1 / full_scale(dtype)
            lower = float(self.linear(np.array(0.5 * step)))
        if self.saturation is not None:
            top = min(self.saturation, 1.0)
            if dtype.kind == "u":
                top = (math.ceil(top / step) - 0.5) * step
            upper = float(self.linear(np.array(top)))
        black = self.black if isinstance(self.black, float) else self.black[index]
        flat = 1.0 if self.flat is None else self.flat[index]
        lower_end, upper_end = (np.atleast_2d((end - black) / flat) for end in (lower, upper))
        return lower_end, upper_end

    def saturated(self, stored: np.ndarray) -> np.ndarray:
        """True where the stored value is at or above saturation, [n, C]."""
        if self.saturation is None:
            return np.zeros(stored.shape, dtype=bool)
        if stored.dtype.kind == "u":
            return stored >= min(self.saturation, 1.0) * full_scale(stored.dtype)
        return stored > self.saturation


def srgb(linear: np.ndarray) -> np.ndarray:
    """8-bit sRGB from linear values, white at 1: for pictures that people look at."""
    return np.round(255 * Encoding("srgb").encoded(np.clip(linear, 0, 1))).astype(np.uint8)


@lru_cache(maxsize=8)
def steps(transfer: str | float, top: int) -> np.ndarray:
    """Width in linear signal of each of the integers 0 to `top` that an encoding stores, fractions of full scale."""
    edges = Encoding(transfer).linear(((np.arange(top + 2) - 0.5) / top).clip(0))
    widths = np.diff(edges)
    # The lowest reaches as far below zero as above.
    widths[0] *= 2
    return widths.astype(np.float32)


def quantisation(encoding: Encoding, dtype: np.dtype) -> float:
    """Standard deviation of rounding to the stored integers, linear fractions of full scale, at black.

    A linear encoding has the same at every level; of others `rounding` is what grows with the signal.
    """
    return float(steps(encoding.transfer, int(full_scale(dtype)))[0]) / math.sqrt(12) if dtype.kind == "u" else 0.0


def rounding(encoding: Encoding, dtype: np.dtype) -> tuple[float, float]:
    """c and p of the variance c·signal^p of rounding beyond `quantisation`, fractions of full scale; or 0 and 1.

    sRGB's curve and power laws have steps that are a power of the signal themselves (sRGB's from 0.003 of full scale).
    """
    if dtype.kind != "u" or encoding.transfer == "linear":
        return 0.0, 1.0
    slope, power = (2.4 / 1.055, 1.4 / 2.4) if encoding.transfer == "srgb" else _power_law(float(encoding.transfer))
    return (slope / full_scale(dtype)) ** 2 / 12, 2 * power


def _power_law(gamma: float) -> tuple[float, float]:
    """Factor and power of the derivative of code^gamma, by the signal."""
    return gamma, max(1 - 1 / gamma, 0.0)


def estimate_noise(
    images: list[np.ndarray],
    valid: list[np.ndarray],
    floor: float,
    step: Callable[[np.ndarray], np.ndarray] = np.zeros_like,
) -> Noise:
    """Read noise and gain from the pictures themselves.

    A second-difference mask blind to planes and to curvature along rows or columns leaves noise; its variance against
    local brightness is a line: read² + gain·signal. The median over the pixels of a brightness class ignores edges.

    Args:
        images: linear signals H×W×C, fractions of full scale.
        valid: H×W×C, True where a pixel is of the object and not clipped; only windows of 3×3 such pixels count.
        floor: smallest read noise believed (quantisation).
        step: distance of neighbouring values at a signal; rounding beyond the floor makes no part of the noise.
    """
    import cv2

    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], dtype=np.float64)
    levels, spreads = [], []
    for image, mask in zip(images, valid, strict=True):
        for channel in range(image.shape[2]):
            plane = np.ascontiguousarray(image[..., channel], dtype=np.float64)
            whole = cv2.erode(np.ascontiguousarray(mask[..., channel], dtype=np.uint8), np.ones((3, 3), np.uint8)) > 0
            levels.append(cv2.blur(plane, (3, 3))[whole])
            spreads.append(cv2.filter2D(plane, -1, kernel)[whole])
    level, spread = np.concatenate(levels), np.concatenate(spreads)
    # As much as fills the gaps between values that are sums of whole steps.
    dither = step(level)
    spread = np.abs(spread + dither * (np.random.default_rng(0).random(level.size) - 0.5))
    lit = level > 1e-3 * level.max(initial=0)
    level, spread, dither = level[lit], spread[lit], dither[lit]
    if level.size < 100:
        return Noise(max(floor, FLOAT_FLOOR * float(level.max(initial=1e-3))), 0.0)
    edges = np.quantile(level, np.linspace(0, 1, min(20, level.size // 50) + 1))
    bins = np.clip(np.searchsorted(edges, level, side="right") - 1, 0, len(edges) - 2)
    counts = np.bincount(bins, minlength=len(edges) - 1)
    used = np.flatnonzero(counts >= 20)
    x = np.array([level[bins == b].mean() for b in used])
    # Median of |N(0, 1)| = 0.6745; the mask has gain 6.
    y = np.array([(np.median(spread[bins == b]) / (6 * 0.6745)) ** 2 for b in used])
    widths = np.array([np.square(dither[bins == b]).mean() for b in used])
    # Less the dither, and the rounding that the floor has not.
    y = (y - widths / (12 * 36) - (widths / 12 - floor**2).clip(0)).clip(0)
    return _line(x, y, counts[used], floor)


def _line(x: np.ndarray, y: np.ndarray, counts: np.ndarray, floor: float) -> Noise:
    """Non-negative weighted fit of y = read² + gain·x; a variance is uncertain in proportion to itself."""
    smallest = floor**2 + (FLOAT_FLOOR * x.max()) ** 2
    weight = np.sqrt(counts) / np.maximum(y, smallest)
    design = np.stack([np.ones_like(x), x], axis=1) * weight[:, None]
    read2, gain = np.linalg.lstsq(design, y * weight, rcond=None)[0]
    if gain < 0:
        read2, gain = float(np.average(y, weights=weight**2)), 0.0
    elif read2 < 0:
        read2, gain = 0.0, float(np.average(y / x, weights=(weight * x) ** 2))
    return Noise(float(np.sqrt(max(read2, smallest))), float(gain))


def as_tensor(array: np.ndarray, dtype: torch.dtype, device: torch.device | str) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(array)).to(device, dtype)
