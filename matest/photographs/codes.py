"""What stored values say of a sensor: the distance of its codes, and the level at which it clips."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from matest.photographs.images import full_scale
from matest.photographs.noise import Noise, steps
from matest.photographs.photometry import Encoding

# Gaps between the smallest stored values that show how far apart codes lie near black: so many are not alike by chance.
_GAPS = 16
# Smallest distance of stretched codes: with less, gaps that are missing by chance look like theirs.
_MIN_STRETCH = 4
# Distance of codes in units of the smallest: up to this they are neighbours, beyond a code between them is missing.
_NEIGHBOURS = 1.5
# Pixels whose values are compared at a time: enough for the processor's vectors.
_ROWS = 64
# Values at one level that are called a pile, at least: fewer may be alike by chance.
_MIN_PILE = 20
# How many times as many values as at any other level below it a pile has.
_PILE_RATIO = 10
# Share of the level: the stretch below a pile that it is compared with.
_BELOW = 0.02
# Codes of that stretch, at least.
_MIN_BELOW = 5
# Noise in steps from which on one level cannot hold a pile of values, however even the surface.
_RESOLVED = 0.5
# The same for floats as a share of the signal: well above what stands for their rounding (`FLOAT_FLOOR`).
_FLOAT_NOISE = 5e-4


def code_step(stored: Sequence[np.ndarray], index: np.ndarray) -> float:
    """The distance of neighbouring codes near black, in integers; 1 unless codes were stretched.

    Twelve bits stored in sixteen, white balance or a tone curve leave integers out.

    Args:
        stored: per image the surface's pixels [N, C] as in the file.
        index: of the pixels that are looked at, those of `windows`.
    """
    if stored[0].dtype.kind != "u":
        return 1.0
    present = np.zeros((int(full_scale(stored[0].dtype)) + 1, stored[0].shape[1]), dtype=bool)
    for image in {0, len(stored) - 1}:
        for channel, values in enumerate(np.take(stored[image], index.ravel(), axis=0).T):
            present[values, channel] = True
    return min(_distance(np.flatnonzero(codes)) for codes in present.T)


def _distance(codes: np.ndarray) -> float:
    """The distance of neighbouring codes among the smallest of some different ones, ascending."""
    gaps = np.diff(codes[codes > 0][: _GAPS + 1].astype(np.float64))
    if len(gaps) < _GAPS or gaps.min() < _MIN_STRETCH:
        return 1.0
    distance = float(gaps[gaps < _NEIGHBOURS * gaps.min()].mean())
    # Codes that are missing by chance leave gaps of every width; stretched ones multiples of their distance, rounded.
    remainder = np.abs(gaps - distance * np.round(gaps / distance))
    return distance if remainder.max() <= 1 else 1.0


@dataclass(frozen=True)
class Clipping:
    """Levels at which values pile up.

    Attributes:
        levels: the stored value at which each channel clips; None for one that does not.
        count: values at these levels, in all images: of every channel, and of the object's rim and shadows too.
    """

    levels: tuple[float | None, ...]
    count: int

    @property
    def sentence(self) -> str:
        """What people should know of it."""
        levels = ", ".join("none" if level is None else f"{level:.5g}" for level in self.levels)
        if len({*self.levels}) == 1:
            levels = f"{self.levels[0]:.5g}"
        return (
            f"{self.count:,} values of single channels, of the object's rim too, pile up at the highest stored level "
            f"({levels}), below full scale: they count as saturated there. If the sensor does not clip at it, state "
            "encoding.saturation."
        )


def highest(stored: Sequence[np.ndarray]) -> np.ndarray:
    """The highest stored value of each channel in each of I images [I, C]."""
    return np.stack([_maxima(pixels) for pixels in stored])


def _maxima(pixels: np.ndarray) -> np.ndarray:
    """The highest value of each channel [C], of at least 0: rows are compared in bulk, which is ten times as fast."""
    whole = len(pixels) - len(pixels) % _ROWS
    bulk = pixels[:whole].reshape(-1, _ROWS * pixels.shape[1]).max(axis=0, initial=0)
    return np.concatenate([bulk.reshape(_ROWS, -1), pixels[whole:]]).max(axis=0)


def clipping(stored: Sequence[np.ndarray], maxima: np.ndarray, encoding: Encoding, noise: Noise) -> Clipping | None:
    """The levels below saturation at which values pile up, far above the numbers just below; None where they do not.

    An even and bright surface has many like values too, but not if noise is larger than a step; where it is smaller, a
    level counts only if several images end at it.

    Args:
        stored: per image the surface's pixels [N, C] as in the file.
        maxima: the highest value of each channel in each image [I, C].
        encoding: from pixels to radiance.
        noise: of values that do not clip.
    """
    clipped: list[float | None] = [None] * maxima.shape[1]
    count = 0
    levels = maxima.max(axis=0)
    # Values above the stated saturation are saturated anyhow.
    open_ended = (levels > 0) & ~encoding.saturated(levels[None])[0]
    for channel in np.flatnonzero(open_ended).tolist():
        level = levels[channel].item()
        columns = [stored[image][:, channel] for image in np.flatnonzero(maxima[:, channel] == level).tolist()]
        piles = [int(np.count_nonzero(column == level)) for column in columns]
        if _is_pile(columns, piles, level, encoding, noise):
            clipped[channel] = level
            count += sum(piles)
    return Clipping(tuple(clipped), count) if count else None


def _is_pile(
    columns: Sequence[np.ndarray], piles: Sequence[int], level: float, encoding: Encoding, noise: Noise
) -> bool:
    """Whether the values at the highest level of a channel are clipped ones.

    Args:
        columns: the channel's values in each image that reaches the level [N].
        piles: number of values at the level in each image.
        level: the highest stored value of the channel.
        encoding: from pixels to radiance.
        noise: of values that do not clip.
    """
    if sum(piles) < _MIN_PILE:
        return False
    codes = columns[0].dtype
    bottom = level - max(_BELOW * level, _MIN_BELOW * encoding.step if codes.kind == "u" else 0.0)
    below = [column[(column < level) & (column >= bottom)] for column in columns]
    _, others = np.unique(np.concatenate(below), return_counts=True)
    if sum(piles) < _PILE_RATIO * others.max(initial=1):
        return False
    images = sum(pile >= _MIN_PILE for pile in piles)
    return _is_resolved(level, codes, encoding, noise) or (images > 1 and len(others) >= _MIN_BELOW)


def _is_resolved(level: float, codes: np.dtype, encoding: Encoding, noise: Noise) -> bool:
    """Whether noise spreads the values of an even surface at a level over several steps."""
    signal = float(encoding.linear(np.array(level / full_scale(codes)))) - float(np.mean(encoding.black))
    std = float(np.sqrt(noise.read**2 + noise.gain * max(signal, 0.0)))
    if codes.kind != "u":
        return std > _FLOAT_NOISE * signal
    top = int(full_scale(codes))
    return std > _RESOLVED * encoding.step * float(steps(encoding.transfer, top)[int(level)])
