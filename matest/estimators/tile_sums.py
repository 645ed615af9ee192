"""A pass over tiles: the likelihood of each is expanded, and something is summed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Generic, NamedTuple, TypeVar

import torch
from torch import Tensor

from matest.division import over_groups
from matest.samples import Tile, Tiles
from matest.samples.likelihood import LeastSquares
from matest.samples.residual_scale import ResidualScale

Sums = TypeVar("Sums")


class Expanded(NamedTuple, Generic[Sums]):
    """A model at the samples of a tile.

    Attributes:
        reference: radiance [n, C] that the likelihood is expanded about; None: the measured.
        sums: gives what is summed, from the tile and its least-squares problem.
    """

    reference: Tensor | None
    sums: Callable[[Tile, LeastSquares], Sums]


def over_tiles(tiles: Tiles, expand: Callable[[Tile], Expanded[Sums]], residual_scale: ResidualScale) -> list[Sums]:
    """The sums of every tile, in their order; of one whose smooth squares are split, several.

    Arguments are those of `each_tile`.
    """
    return list(each_tile(tiles, expand, residual_scale))


def each_tile(tiles: Tiles, expand: Callable[[Tile], Expanded[Sums]], residual_scale: ResidualScale) -> Iterator[Sums]:
    """The same one after another, so that they need not be kept.

    Args:
        tiles: groups of functions that give a tile each; the tiles of a group are worked on at the same time.
        expand: gives the model at a tile.
        residual_scale: see `likelihood.about`.
    """

    def sum_tile(get: Callable[[], Tile]) -> list[Sums]:
        with torch.no_grad():
            parts, tile = [], get()
            if not len(tile):
                return []
            reference, sums = expand(tile)
            if tile.merged is not None and reference is not None:
                tile, finer = tile.merged.judge(tile, reference, residual_scale)
                if finer is not None:
                    parts = sum_tile(lambda: finer)
            problem = tile.least_squares
            if problem is None:
                problem = tile.first_guess() if reference is None else tile.about(reference, residual_scale)
            return [*parts, sums(tile, problem)]

    return over_groups(sum_tile, tiles)
