"""Random smooth fields over an object."""

from __future__ import annotations

import math

import numpy as np

from matest.scene import Surface

# Waves of a field.
_WAVES = 8
# Cycles of these waves over the object's size: none is shorter than half of it.
_CYCLES = (0.5, 2.0)


def places(surface: Surface) -> np.ndarray:
    """An object's pixels [N, 2]: x (right) and y (up) from the middle of its box, in units of its longer side."""
    rows, columns = np.divmod(surface.pixels, surface.shape[1])
    corners = np.stack([columns, -rows], axis=1).astype(np.float64)
    low, high = corners.min(axis=0), corners.max(axis=0)
    unit: np.ndarray = (corners - (low + high) / 2) / (high - low).max()
    return unit


class Waves:
    """A random sum of cosines over places in units of the object's size."""

    def __init__(self, generator: np.random.Generator) -> None:
        turn = 2 * math.pi * generator.random(_WAVES)
        cycles = generator.uniform(*_CYCLES, _WAVES)
        self._vectors = 2 * math.pi * cycles[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        self._phases = 2 * math.pi * generator.random(_WAVES)
        self._amplitudes = generator.standard_normal(_WAVES)

    def values(self, places: np.ndarray) -> np.ndarray:
        """Its values [n] at places [n, 2]."""
        values: np.ndarray = np.cos(places @ self._vectors.T + self._phases) @ self._amplitudes
        return values

    def gradient(self, places: np.ndarray) -> np.ndarray:
        """Its gradient [n, 2] at places [n, 2]."""
        slopes: np.ndarray = -np.sin(places @ self._vectors.T + self._phases) @ (
            self._amplitudes[:, None] * self._vectors
        )
        return slopes

    def between(self, places: np.ndarray, low: float, high: float) -> np.ndarray:
        """A monotone function of its values that lies between two ends [n] at places [n, 2]."""
        values = self.values(places)
        spread = (values - values.mean()) / values.std()
        between: np.ndarray = low + (high - low) * (1 + np.tanh(spread)) / 2
        return between
