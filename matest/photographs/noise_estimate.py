"""Read noise and gain of a camera, estimated from its own photographs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from matest.photographs.images import full_scale
from matest.photographs.noise import FLOAT_FLOOR, Noise, quantisation, steps
from matest.photographs.photometry import Encoding
from matest.photographs.windows import chosen_images

# Windows of the smallest sample whose noise is estimated: fewer have too uncertain medians.
_MIN_WINDOWS = 100
# Signal below this share of the brightest is in shadow and says nothing of the gain.
_SHADOW_SHARE = 1e-3
# Classes of brightness, at most: a line needs no more points.
_MAX_CLASSES = 20
# Windows of a class on average, at least, so that its median is certain to about 20 %.
_CLASS_WINDOWS = 50
# Share of the windows of a class that may reach an end of the sensor's range.
_MAX_CLIPPED_SHARE = 0.02
# A window whose range is this many times the typical one is more than noise.
_WIDE_RANGE = 4.0
# Share of the windows that are darker than any wild value: what lies among the others is an edge or in a highlight.
_DARKER_SHARE = 0.95
# Wild values lie this many times as far from the median of their window as the next. A highlight has no such gap, and
# noise has it in one window in a million.
_WILD_GAP = 10.0
# Pixels of a window, at least, that wild ones are compared with.
_TAME_PIXELS = 5
# Second difference along rows and columns: 0 for planes and for curvature along rows or columns alone.
_SECOND_DIFFERENCE = np.array([1, -2, 1, -2, 4, -2, 1, -2, 1], dtype=np.float32)
# Standard deviation of that difference of independent noise of 1: the root of the sum of its squares.
_SECOND_DIFFERENCE_GAIN = 6
# Median of |x| for x of a normal distribution of standard deviation 1.
_NORMAL_MEDIAN = 0.6745
# Relative standard error of a variance from the median of n absolute values of a normal distribution, times √n.
_MEDIAN_ERROR = 2.333
# Sum of the squared correlations of second differences at all windows of an image: (35/18)².
_OVERLAP = 3.78
# Fits of the line, each with the errors that the one before gives; they settle in three or four.
_ROUNDS = 6


def noise_of_photographs(stored: Sequence[np.ndarray], encoding: Encoding, index: np.ndarray) -> Noise:
    """The noise estimated from photographs of a surface, with standard errors.

    A second difference removes planes and curvature along rows or columns, so that noise remains. Its variance is a
    line over local brightness: read² + gain·signal. The median over the windows of a brightness class ignores edges;
    windows with wild values would fill the brightest classes, and are left out.

    Args:
        stored: per image the surface's pixels [N, C] as in the file.
        encoding: from pixels to radiance.
        index: of the pixels of n windows [n, 9].
    """
    dtype = stored[0].dtype
    floor = quantisation(encoding, dtype)
    parts = [_measured(stored[image], encoding, index) for image in chosen_images(stored)]
    level, spread, width, whole, lone = (np.concatenate(column) for column in zip(*parts, strict=True))
    lit = level > _SHADOW_SHARE * level.max(initial=0)
    level, spread, width, whole = level[lit], spread[lit], width[lit], whole[lit]
    if np.count_nonzero(whole) < _MIN_WINDOWS:
        return Noise(max(floor, FLOAT_FLOOR * float(level.max(initial=1e-3))), 0.0)
    # A wild value spoils the windows of nine pixels, and is the middle of one: all lie above the median of the others.
    middle = 0.5 * (1 - min(9 * np.count_nonzero(lone) / max(len(lone), 1), 1.0))
    # Second differences are sums of whole steps: uniform noise one step wide fills the gaps between them.
    spread = np.abs(spread + width * (np.random.default_rng(0).random(level.size) - 0.5))
    classes = np.array_split(np.argsort(level), min(_MAX_CLASSES, level.size // _CLASS_WINDOWS))
    # Where some windows reach an end of the sensor's range, the others are those that happen to have little noise.
    used = [rows[whole[rows]] for rows in classes if np.count_nonzero(~whole[rows]) <= _MAX_CLIPPED_SHARE * len(rows)]
    if not used:
        return Noise(max(floor, FLOAT_FLOOR * float(level.max())), 0.0)
    x = np.array([level[rows].mean() for rows in used])
    y = np.array([np.quantile(spread[rows], middle) / (_SECOND_DIFFERENCE_GAIN * _NORMAL_MEDIAN) for rows in used]) ** 2
    rounded = np.array([np.square(width[rows]).mean() for rows in used]) / 12
    # Subtract the uniform noise added above, and the rounding beyond that of the floor: the fit adds that itself.
    y = (y - rounded / _SECOND_DIFFERENCE_GAIN**2 - (rounded - floor**2).clip(0)).clip(0)
    overlap = 1 + (_OVERLAP - 1) * len(index) / len(stored[0])
    sizes = np.array([len(rows) for rows in used]) / overlap
    return _line(x, y, sizes, floor**2 + (FLOAT_FLOOR * x.max()) ** 2)


def _measured(stored: np.ndarray, encoding: Encoding, index: np.ndarray) -> tuple[np.ndarray, ...]:
    """Of the m windows of an image with no wild value, and for all channels: what its noise is estimated from.

    Args:
        stored: the surface's pixels [N, C] as in the file.
        encoding: from pixels to radiance.
        index: of the pixels of the windows [n, 9].

    Returns:
        Mean signal, second difference, width of a step, whether no value is clipped, and whether the pixel in the
        middle is wild nevertheless, five arrays [m].
    """
    # Twice as fast as indexing.
    pixels = np.take(stored, index.ravel(), axis=0)
    # Zero is a clipped value of integers, and of floats that a program has cut off.
    clipped = _by_place(encoding.saturated(pixels) | (pixels == 0))
    signal = _by_place(encoding.signal(pixels, index.ravel()))
    widths = _widths(pixels[4::9], encoding).ravel()
    wild, lone = _wild(signal, widths)
    if wild.any():
        signal, widths, clipped, lone = signal[:, ~wild], widths[~wild], clipped[:, ~wild], lone[~wild]
    return signal.mean(axis=0), _SECOND_DIFFERENCE @ signal, widths, np.logical_not(clipped.any(axis=0)), lone


def _wild(signal: np.ndarray, widths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Windows with bright values that their neighbours rule out, and those whose middle alone is such a value.

    Where it is no brighter than the surface, a value off the middle may as well be the corner of a shadow.

    Args:
        signal: of the pixels of n windows [9, n].
        widths: of a stored step there [n].

    Returns:
        Two arrays, bool [n].
    """
    if not signal.size:
        nowhere = np.zeros(signal.shape[1], dtype=bool)
        return nowhere, nowhere
    highest, lowest = signal.max(axis=0), signal.min(axis=0)
    wide = highest - lowest > _WIDE_RANGE * np.median(highest - lowest)
    bright = np.maximum(highest, -lowest) > np.quantile(signal[4], _DARKER_SHARE)
    suspects = signal[:, wide].astype(np.float64)
    typical = np.median(suspects, axis=0)
    distances = np.abs(suspects - typical)
    # Differences of a step, or as small as the errors of floats, are no distance.
    smallest = np.maximum(widths[wide], FLOAT_FLOOR * np.abs(typical))
    ordered = np.sort(distances, axis=0)[_TAME_PIXELS - 1 :]
    gaps = ordered[1:] > _WILD_GAP * np.maximum(ordered[:-1], smallest)
    wild, lone = np.zeros_like(wide), np.zeros_like(wide)
    wild[wide] = gaps.any(axis=0)
    lone[wide] = gaps[-1] & (distances[4] == ordered[-1])
    return wild & bright, lone


def _by_place(values: np.ndarray) -> np.ndarray:
    """Values [9·n, C] of n windows by their place in the window [9, n·C]: sums over it then run along memory."""
    return values.reshape(-1, 9, values.shape[1]).transpose(1, 0, 2).reshape(9, -1)


def _widths(pixels: np.ndarray, encoding: Encoding) -> np.ndarray:
    """The width in linear signal of the step that each stored value stands for; 0 for floats."""
    if pixels.dtype.kind != "u":
        return np.zeros(pixels.shape)
    return encoding.step * steps(encoding.transfer, int(full_scale(pixels.dtype)))[pixels]


def _line(x: np.ndarray, y: np.ndarray, counts: np.ndarray, smallest: float) -> Noise:
    """Non-negative fit of y = read² + gain·x, with standard errors.

    A variance is uncertain in proportion to its true value, which the fit itself gives: one that happens to be small
    must not count for more.

    Args:
        x: brightness of each class.
        y: variance of each.
        counts: of independent values that each variance is from.
        smallest: read² of the result is not below this.
    """
    design = np.stack([np.ones_like(x), x], axis=1)
    expected = np.full_like(y, y.mean())
    for _ in range(_ROUNDS):
        error = _MEDIAN_ERROR * np.maximum(expected, smallest) / np.sqrt(counts)
        scaled = design / error[:, None]
        read2, gain = np.linalg.lstsq(scaled, y / error, rcond=None)[0]
        if gain < 0:
            read2, gain = float(np.average(y, weights=error**-2)), 0.0
        elif read2 < 0:
            read2, gain = 0.0, float(np.average(y / x, weights=(x / error) ** 2))
        expected = design @ [read2, gain]
    misfit = max(float(np.square((y - expected) / error).sum()) / max(len(y) - 2, 1), 1.0)
    read2_std, gain_std = np.sqrt(misfit * np.linalg.pinv(scaled.T @ scaled).diagonal())
    read2 = max(float(read2), smallest)
    read_std = np.sqrt(read2 + read2_std) - np.sqrt(read2)
    return Noise(float(np.sqrt(read2)), float(gain), read_std=float(read_std), gain_std=float(gain_std))
