"""Cells of a latitude-longitude map, each of which one direction stands for: a k-d tree over its light.

The error of one direction for a cell grows with its power and with the mean square distance of its light from that
direction (on the unit sphere), its spread. Cells are split one at a time: the one with the largest product of both,
where that leaves the least of it. Bright and compact sources get many small cells, dim skies few large ones.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

# Product of power and spread of a cell, as a share of the first one's, that is rounding.
_ROUNDING = 1e-12


class _Cell(NamedTuple):
    """Rows and columns of a map, each from the first to before the last."""

    top: int
    bottom: int
    left: int
    right: int


@dataclass(frozen=True, eq=False)
class Cells:
    """D cells of a map.

    Attributes:
        directions: unit vectors to the middle of the light of each [D, 3].
        powers: irradiance of a surface that faces it [D, C].
        spreads: mean square distance of the light of each from its middle [D].
        labels: number of the cell of every texel; of a dark one that of any [R, S].
    """

    directions: np.ndarray
    powers: np.ndarray
    spreads: np.ndarray
    labels: np.ndarray

    @property
    def spread(self) -> float:
        """The mean of the spreads over all light."""
        weight = self.powers.mean(axis=1)
        return float(weight @ self.spreads / weight.sum())


def light_cells(powers: np.ndarray, directions: np.ndarray, count: int) -> Cells:
    """At most so many cells of a map; fewer where each of them is a single texel, or dark.

    Args:
        powers: radiance times solid angle of every texel [R, S, C], not all of them 0.
        directions: unit vectors to the texels [R, S, 3].
        count: of cells.
    """
    weight = powers.mean(axis=2, keepdims=True)
    sums = _Sums(np.concatenate([weight, weight * directions], axis=2))
    whole = _Cell(0, powers.shape[0], 0, powers.shape[1])
    first = sums.scatter(whole)
    heap, done = [(-first, whole)], list[_Cell]()
    while heap and len(heap) + len(done) < count:
        scatter, cell = heapq.heappop(heap)
        parts = sums.split(cell) if -scatter > _ROUNDING * first else ()
        if not parts:
            done.append(cell)
        for part in parts:
            heapq.heappush(heap, (-sums.scatter(part), part))
    cells = [cell for cell in (*done, *(cell for _, cell in heap)) if sums.of(cell)[0] > 0]
    totals, by_channel = np.stack([sums.of(cell) for cell in cells]), _Sums(powers)
    labels = np.zeros(powers.shape[:2], dtype=np.int32)
    for number, cell in enumerate(cells):
        labels[cell.top : cell.bottom, cell.left : cell.right] = number
    return Cells(
        directions=totals[:, 1:] / np.linalg.norm(totals[:, 1:], axis=1, keepdims=True),
        powers=np.stack([by_channel.of(cell) for cell in cells]).clip(0),
        spreads=_scatter(totals) / totals[:, 0],
        labels=labels,
    )


class _Sums:
    """Sums of values [R, S, k] over cells, from a table of sums over all corners."""

    def __init__(self, values: np.ndarray) -> None:
        self._table = np.zeros((values.shape[0] + 1, values.shape[1] + 1, values.shape[2]))
        values.cumsum(axis=0).cumsum(axis=1, out=self._table[1:, 1:])

    def of(self, cell: _Cell) -> np.ndarray:
        """The sum over a cell [k]."""
        table = self._table
        below = table[cell.bottom, cell.right] - table[cell.bottom, cell.left]
        return np.asarray(below - (table[cell.top, cell.right] - table[cell.top, cell.left]))

    def scatter(self, cell: _Cell) -> float:
        """Power times spread of a cell, of weights and their products with directions."""
        return float(_scatter(self.of(cell)))

    def split(self, cell: _Cell) -> tuple[_Cell, ...]:
        """The halves of a cell that leave the least scatter; none of a single texel."""
        table, best = self._table, []
        if cell.bottom - cell.top > 1:
            rows = np.arange(cell.top + 1, cell.bottom)
            edge = table[:, cell.right] - table[:, cell.left]
            best.append(self._best(edge[rows] - edge[cell.top], edge[cell.bottom] - edge[rows], cell, 0))
        if cell.right - cell.left > 1:
            columns = np.arange(cell.left + 1, cell.right)
            edge = table[cell.bottom] - table[cell.top]
            best.append(self._best(edge[columns] - edge[cell.left], edge[cell.right] - edge[columns], cell, 1))
        return min(best, key=lambda one: one[0])[1] if best else ()

    @staticmethod
    def _best(before: np.ndarray, after: np.ndarray, cell: _Cell, axis: int) -> tuple[float, tuple[_Cell, _Cell]]:
        """The least scatter of two parts, and the parts, of the sums before and after every place to split [n, 4]."""
        scatter = _scatter(before) + _scatter(after)
        place = int(scatter.argmin())
        if axis == 0:
            row = cell.top + 1 + place
            return float(scatter[place]), (cell._replace(bottom=row), cell._replace(top=row))
        column = cell.left + 1 + place
        return float(scatter[place]), (cell._replace(right=column), cell._replace(left=column))


def _scatter(sums: np.ndarray) -> np.ndarray:
    """Power times spread, P (1 − |M|²/P²), of sums of weights and of weighted directions (P, M) [..., 4]."""
    power = np.maximum(sums[..., 0], np.finfo(float).tiny)
    return np.asarray(np.maximum(power - np.square(sums[..., 1:]).sum(-1) / power, 0))
