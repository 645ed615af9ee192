"""Least squares of lights' powers over the pixels of a matte sphere, by sums over cells of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sums:
    """Radiance y = E f + b of K photographs in C channels at P pixels, with weights.

    E of every photograph and channel are eliminated one by one, since only b (and an error of f's parameter, where its
    slope is known) is common to all: cost O(K).

    Attributes:
        share: f, the radiance under a light of power 1 [K, P].
        radiance: y [K, P, C].
        weights: of squared residuals, 0 where a pixel does not count [K, P, C].
        cell: number of each pixel's cell [P].
        slope: change of f with its parameter [K, P]; None: f is exact.
    """

    share: Array
    radiance: Array
    weights: Array
    cell: NDArray[np.int64]
    slope: Array | None = None

    def solve(self) -> Array:
        """E [K, C], with f exact."""
        return _powers(self._moments(np.ones(len(self.cell), dtype=bool), None))[0]

    def without_cells(self) -> Array:
        """E without each cell in turn [cells, K, C], with the parameter of f free."""
        power = self.solve()
        parts = [self._moments(self.cell == number, power) for number in np.unique(self.cell)]
        total = np.sum(parts, axis=0)
        return np.stack([_powers(total - part)[0] for part in parts])

    def residuals(self, power: Array) -> tuple[Array, Array]:
        """E f + b, and y without it, each [K, P, C]."""
        _, common = _powers(self._moments(np.ones(len(self.cell), dtype=bool), None))
        model = power[:, None] * self.share[..., None] + common[:, 0]
        return model, self.radiance - model

    def cost(self) -> float:
        """Weighted sum of squares at the solution."""
        _, residual = self.residuals(self.solve())
        return float((self.weights * residual**2).sum())

    def misfit(self, power: Array) -> float:
        """Rms residual over rms radiance of what counts."""
        _, residual = self.residuals(power)
        counts = self.weights > 0
        return float(np.sqrt((residual[counts] ** 2).mean() / (self.radiance[counts] ** 2).mean()))

    def _moments(self, pixels: NDArray[np.bool_], power: Array | None) -> Array:
        """Weighted products of f, the common columns and y with each other, summed over pixels [K, C, n, n].

        Args:
            pixels: that count [P].
            power: E, which scales the slope [K, C]; None: without a column for it.
        """
        share, radiance = self.share[:, pixels], self.radiance[:, pixels]
        columns = [np.broadcast_to(share[..., None], radiance.shape), np.ones_like(radiance)]
        if power is not None and self.slope is not None:
            columns.append(power[:, None] * self.slope[:, pixels, None])
        stacked = np.stack([*columns, radiance], axis=-1)
        moments: Array = np.einsum("kpc,kpca,kpcb->kcab", self.weights[:, pixels], stacked, stacked, optimize=True)
        return moments


def _powers(moments: Array) -> tuple[Array, Array]:
    """E [K, C], and the coefficients of the common columns [C, n − 2], from moments [K, C, n, n].

    What is unknown is eliminated in turn: E of each photograph and channel, b of each channel, the parameter of f.
    """
    own = np.maximum(moments[..., 0, 0], 1e-300)
    cross, right = moments[..., 0, 1:-1], moments[..., 0, -1]
    normal = (moments[..., 1:-1, 1:-1] - cross[..., :, None] * cross[..., None, :] / own[..., None, None]).sum(axis=0)
    rest = (moments[..., 1:-1, -1] - cross * (right / own)[..., None]).sum(axis=0)
    first = np.maximum(normal[:, 0, 0], 1e-300)
    coefficients = np.zeros_like(rest)
    if rest.shape[1] == 2:
        curvature = (normal[:, 1, 1] - normal[:, 0, 1] ** 2 / first).sum()
        coefficients[:, 1] = (rest[:, 1] - normal[:, 0, 1] * rest[:, 0] / first).sum() / max(curvature, 1e-300)
        rest = rest - normal[:, :, 1] * coefficients[:, 1:]
    coefficients[:, 0] = rest[:, 0] / first
    powers: Array = (right - (cross * coefficients).sum(axis=-1)) / own
    return powers, coefficients
