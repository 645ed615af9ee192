"""The noise of a camera: from read-out, photons and rounding to integers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from matest.photographs.images import full_scale
from matest.photographs.photometry import Encoding

# Relative error of float images that no noise model describes: rounding and geometry.
FLOAT_FLOOR = 1e-4
# Smallest peak signal for `FLOAT_FLOOR`, fractions of full scale: the noise of black images must not be 0.
_MIN_PEAK = 1e-30
# A pixel is wild, and no peak of the surface, if it is this many times as bright as the brightest of the windows.
_WILD_PEAK = 10.0


@dataclass(frozen=True)
class Noise:
    """variance = read² + gain·signal, in fractions of full scale (signal above black, linear).

    Attributes:
        read: standard deviation at black.
        gain: variance that every unit of signal adds.
        read_std, gain_std: standard errors of the two where they are estimated; 0 where they are stated.
    """

    read: float
    gain: float
    read_std: float = 0.0
    gain_std: float = 0.0

    def with_rounding(self, encoding: Encoding, dtype: np.dtype) -> Noise:
        """The noise of the sensor, and that of rounding at black to the integers of an image file."""
        return Noise(float(np.hypot(self.read, quantisation(encoding, dtype))), self.gain)


def stated_noise(stated: Noise, encoding: Encoding, pixels: np.ndarray, index: np.ndarray) -> Noise:
    """The stated noise of the sensor with that of rounding.

    Float images without stated noise get the relative error `FLOAT_FLOOR`, which stands for rounding and geometry.

    Args:
        stated: without rounding.
        encoding: from pixels to radiance.
        pixels: the surface's in one of the images [N, C].
        index: of the pixels of some windows [n, 9].
    """
    noise = stated.with_rounding(encoding, pixels.dtype)
    if noise.read:
        return noise
    signal = encoding.signal(pixels, slice(None))
    peak = float(signal.max())
    if len(index) and peak > _WILD_PEAK * (shown := float(np.median(signal[index], axis=1).max())):
        peak = shown
    return Noise(FLOAT_FLOOR * max(peak, _MIN_PEAK), noise.gain)


@lru_cache(maxsize=8)
def steps(transfer: str | float, top: int) -> np.ndarray:
    """Width in linear signal of each of the integers 0 to `top` that an encoding stores, fractions of full scale."""
    edges = Encoding(transfer).linear(((np.arange(top + 2) - 0.5) / top).clip(0))
    widths = np.diff(edges)
    # Code 0 covers as much below zero as above it.
    widths[0] *= 2
    return widths.astype(np.float32)


def quantisation(encoding: Encoding, dtype: np.dtype) -> float:
    """Standard deviation of rounding to the stored integers, linear fractions of full scale, at black.

    A linear encoding has this standard deviation at every level. For others `rounding` adds the growth with the signal.
    """
    if dtype.kind != "u":
        return 0.0
    return encoding.step * float(steps(encoding.transfer, int(full_scale(dtype)))[0]) / math.sqrt(12)


def rounding(encoding: Encoding, dtype: np.dtype) -> tuple[float, float]:
    """c and p of the variance c·signal^p of rounding beyond `quantisation`, fractions of full scale; or 0 and 1.

    sRGB's curve and power laws have steps that are a power of the signal themselves (sRGB's from 0.003 of full scale).
    """
    if dtype.kind != "u" or encoding.transfer == "linear":
        return 0.0, 1.0
    # The derivative of the signal by the code, as a factor times a power of the signal.
    if encoding.transfer == "srgb":
        factor, power = 2.4 / 1.055, 1.4 / 2.4
    else:
        factor = float(encoding.transfer)
        power = max(1 - 1 / factor, 0.0)
    return (encoding.step * factor / full_scale(dtype)) ** 2 / 12, 2 * power
