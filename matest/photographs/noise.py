"""The noise of a camera: from read-out, photons and rounding to integers, as stated or estimated from photographs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from matest.photographs.images import full_scale
from matest.photographs.photometry import Encoding
from matest.scene import Surface

# Relative error of float images that no noise model describes: rounding and geometry.
FLOAT_FLOOR = 1e-4
# Smallest peak signal for `FLOAT_FLOOR`, fractions of full scale: the noise of black images must not be 0.
_MIN_PEAK = 1e-30
# Most images from which noise is estimated: their pixels determine two numbers well enough.
_NOISE_IMAGES = 8
# Fewest pixels from which noise is estimated: the medians of fewer are too uncertain.
_MIN_PIXELS = 100
# Smallest signal from which the gain is estimated, share of the brightest: pixels below it are in shadow.
_SHADOW_SHARE = 1e-3
# Most classes of brightness: a line needs no more points.
_MAX_CLASSES = 20
# Fewest pixels of a class on average: its median is then certain to about 20 %.
_CLASS_PIXELS = 50
# Fewest pixels of a class that counts: equal brightness may leave classes nearly empty.
_MIN_CLASS_PIXELS = 20
# Second difference along rows and columns: 0 for planes and for curvature along rows or columns alone.
_SECOND_DIFFERENCE = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], dtype=np.float64)
# Standard deviation of that difference of independent noise of 1: the root of the sum of its squares.
_SECOND_DIFFERENCE_GAIN = 6
# Median of |x| for x of a normal distribution of standard deviation 1.
_NORMAL_MEDIAN = 0.6745


@dataclass(frozen=True)
class Noise:
    """variance = read² + gain·signal, in fractions of full scale (signal above black, linear)."""

    read: float
    gain: float

    def with_rounding(self, encoding: Encoding, dtype: np.dtype) -> Noise:
        """The noise of the sensor, and that of rounding at black to the integers of an image file."""
        return Noise(float(np.hypot(self.read, quantisation(encoding, dtype))), self.gain)


def stated_noise(stated: Noise, encoding: Encoding, pixels: np.ndarray) -> Noise:
    """The stated noise of the sensor with that of rounding, for images like `pixels` [N, C].

    Float images without stated noise get the relative error `FLOAT_FLOOR`, which stands for rounding and geometry.
    """
    noise = stated.with_rounding(encoding, pixels.dtype)
    if noise.read:
        return noise
    peak = float(encoding.signal(pixels, slice(None)).max())
    return Noise(FLOAT_FLOOR * max(peak, _MIN_PEAK), noise.gain)


def noise_of_photographs(stored: Sequence[np.ndarray], encoding: Encoding, surface: Surface) -> Noise:
    """An estimate of the noise from photographs of a surface.

    Args:
        stored: per image the surface's pixels [N, C] as in the file.
        encoding: from pixels to radiance.
        surface: their place in the image.
    """
    dtype = stored[0].dtype
    signals, valid = [], []
    for image in np.linspace(0, len(stored) - 1, min(len(stored), _NOISE_IMAGES)).round().astype(int):
        pixels = stored[image]
        clipped = encoding.saturated(pixels) | (pixels <= 0)
        signals.append(surface.image(encoding.signal(pixels, slice(None)).astype(np.float32)))
        valid.append(surface.image(~clipped & ~surface.rim[:, None]))
    black = float(np.mean(encoding.black))

    def step(signal: np.ndarray) -> np.ndarray:
        if dtype.kind != "u":
            return np.zeros_like(signal)
        top = int(full_scale(dtype))
        codes = (encoding.encoded(signal + black) * top).round().clip(0, top).astype(int)
        return steps(encoding.transfer, top)[codes]

    return estimate_noise(signals, valid, quantisation(encoding, dtype), step)


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
    return float(steps(encoding.transfer, int(full_scale(dtype)))[0]) / math.sqrt(12) if dtype.kind == "u" else 0.0


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
    return (factor / full_scale(dtype)) ** 2 / 12, 2 * power


def estimate_noise(
    images: list[np.ndarray],
    valid: list[np.ndarray],
    floor: float,
    step: Callable[[np.ndarray], np.ndarray] = np.zeros_like,
) -> Noise:
    """Read noise and gain from images.

    A second difference removes planes and curvature along rows or columns, so that noise remains. Its variance is a
    line over local brightness: read² + gain·signal. The median over the pixels of a brightness class ignores edges.

    Args:
        images: linear signals H×W×C, fractions of full scale.
        valid: H×W×C, True where a pixel is of the object and not clipped; only windows of 3×3 such pixels count.
        floor: smallest read noise of the result (quantisation).
        step: distance of neighbouring stored values at a signal; rounding beyond the floor is subtracted.
    """
    import cv2

    levels, spreads = [], []
    for image, mask in zip(images, valid, strict=True):
        for channel in range(image.shape[2]):
            plane = np.ascontiguousarray(image[..., channel], dtype=np.float64)
            whole = cv2.erode(np.ascontiguousarray(mask[..., channel], dtype=np.uint8), np.ones((3, 3), np.uint8)) > 0
            levels.append(cv2.blur(plane, (3, 3))[whole])
            spreads.append(cv2.filter2D(plane, -1, _SECOND_DIFFERENCE)[whole])
    level, spread = np.concatenate(levels), np.concatenate(spreads)
    # Second differences are sums of whole steps: uniform noise one step wide fills the gaps between them.
    dither = step(level)
    spread = np.abs(spread + dither * (np.random.default_rng(0).random(level.size) - 0.5))
    lit = level > _SHADOW_SHARE * level.max(initial=0)
    level, spread, dither = level[lit], spread[lit], dither[lit]
    if level.size < _MIN_PIXELS:
        return Noise(max(floor, FLOAT_FLOOR * float(level.max(initial=1e-3))), 0.0)
    edges = np.quantile(level, np.linspace(0, 1, min(_MAX_CLASSES, level.size // _CLASS_PIXELS) + 1))
    bins = np.clip(np.searchsorted(edges, level, side="right") - 1, 0, len(edges) - 2)
    counts = np.bincount(bins, minlength=len(edges) - 1)
    used = np.flatnonzero(counts >= _MIN_CLASS_PIXELS)
    x = np.array([level[bins == b].mean() for b in used])
    y = np.array([(np.median(spread[bins == b]) / (_SECOND_DIFFERENCE_GAIN * _NORMAL_MEDIAN)) ** 2 for b in used])
    widths = np.array([np.square(dither[bins == b]).mean() for b in used])
    # Subtract the uniform noise added above, and the rounding beyond that of the floor.
    y = (y - widths / (12 * _SECOND_DIFFERENCE_GAIN**2) - (widths / 12 - floor**2).clip(0)).clip(0)
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
