"""Shadows of large images from few rays: a coarse pass, refined about the edges that it shows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from matest.scene.surface import Surface

# Pixels on a side of the squares between those that are traced first.
_CELL = 4


@dataclass(frozen=True, eq=False)
class Grid:
    """Square cells of `_CELL`² pixels, R rows of S, over the object in an image.

    Attributes:
        shape: (R, S). The last row and column of cells have no pixels.
        cell: number of the cell that each pixel of the surface lies in [N].
        members: the pixels of the surface in each cell, row by row, −1 where there is none [R S, `_CELL`²].
        whole: whether all pixels of a cell lie on the surface and off its rim [R S].
    """

    shape: tuple[int, int]
    cell: np.ndarray
    members: np.ndarray
    whole: np.ndarray

    @classmethod
    def over(cls, surface: Surface) -> Grid:
        """The grid over the pixels of a surface."""
        rows = surface.pixels // surface.shape[1]
        columns = surface.pixels - rows * surface.shape[1]
        rows -= rows.min() // _CELL * _CELL
        columns -= columns.min() // _CELL * _CELL
        shape = (int(rows.max()) // _CELL + 2, int(columns.max()) // _CELL + 2)
        cell = rows // _CELL * shape[1] + columns // _CELL
        members = np.full((shape[0] * shape[1], _CELL**2), -1, dtype=np.int32)
        members[cell, rows % _CELL * _CELL + columns % _CELL] = np.arange(len(surface), dtype=np.int32)
        whole = np.all(members >= 0, axis=1)
        assert isinstance(whole, np.ndarray)
        whole[cell[surface.rim]] = False
        return cls(shape, cell, members, whole)

    def shadow(self, facing: np.ndarray, blocked: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Whether each pixel is shadowed [N].

        Args:
            facing: whether it faces the light; no others are shadowed [N].
            blocked: traces some pixels [n], bool [n].
        """
        shadow = np.zeros(len(facing), dtype=bool)
        corner = np.where((self.members[:, 0] >= 0) & facing[self.members[:, 0]], self.members[:, 0], -1)
        index = np.sort(corner[corner >= 0])
        shadow[index] = blocked(index)
        value = np.where(corner >= 0, shadow[corner], -1)
        # Cells with a traced pixel that is lit, and that is shadowed; the corner stands for cells not traced.
        holds = np.stack([value == 0, value == 1])
        waiting = self._even(value, facing)
        cells = np.flatnonzero(~waiting & (self.members >= 0).any(axis=1))
        while len(cells):
            index = self.members[cells, 1:].ravel()
            index = index[index >= 0]
            index = index[facing[index]]
            shadow[index] = blocked(index)
            for kind in (0, 1):
                holds[kind, self.cell[index[shadow[index] == kind]]] = True
            # The cells about an edge are traced too: it may leave the cells that showed it.
            cells = np.flatnonzero(waiting & self._spread(holds[0]) & self._spread(holds[1]))
            waiting[cells] = False
        shadow[self.members[waiting & (value == 1)]] = True
        return shadow

    def _even(self, value: np.ndarray, facing: np.ndarray) -> np.ndarray:
        """Whether a cell is whole, faces the light, and its corner and those of the next cells are alike [R S].

        Args:
            value: of the corners, −1 where there is none [R S].
            facing: of the pixels [N].
        """
        corners, alike = value.reshape(self.shape), np.zeros(self.shape, dtype=bool)
        first, others = corners[:-1, :-1], (corners[1:, :-1], corners[:-1, 1:], corners[1:, 1:])
        alike[:-1, :-1] = (first >= 0) & np.all([first == other for other in others], axis=0)
        even = alike.ravel() & self.whole
        even[self.cell[~facing]] = False
        return even

    def _spread(self, cells: np.ndarray) -> np.ndarray:
        """Whether a cell or one of the eight about it is among some [R S]."""
        import cv2

        return cv2.dilate(cells.reshape(self.shape).view(np.uint8), np.ones((3, 3), np.uint8)).ravel() > 0
