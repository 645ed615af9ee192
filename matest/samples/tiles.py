"""Tiles: batches as an estimator works on them, computed when a worker asks for them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from torch import Tensor

from matest.samples import likelihood
from matest.samples.batch import Batch
from matest.samples.likelihood import LeastSquares, Means
from matest.samples.residual_scale import NOISE_ALONE, ResidualScale, half_angle, like_angled

if TYPE_CHECKING:
    from matest.samples.merging import MergedSquares


@dataclass(frozen=True, eq=False)
class Tile:
    """A batch with data that only an estimator needs.

    Attributes:
        batch: the samples.
        means: the pixels that each sample replaces; None: every sample is one pixel.
        merged: the squares of pixels that the first samples replace; None: there are none.
        least_squares: the problem that replaces the likelihood, if it is fixed already; None: it is computed.
        cache: values that depend on the points alone, by name; None where tiles are not kept.
    """

    batch: Batch
    means: Means | None = None
    merged: MergedSquares | None = None
    least_squares: LeastSquares | None = None
    cache: dict[str, Any] | None = None

    def __len__(self) -> int:
        return len(self.batch)

    @property
    def half_angles(self) -> Tensor:
        """See `residual_scale.half_angle`."""
        cache = {} if self.cache is None else self.cache
        if "half angles" not in cache:
            cache["half angles"] = half_angle(self.batch.points).expand(len(self))
        angles: Tensor = cache["half angles"]
        return angles

    def first_guess(self) -> LeastSquares:
        """See `likelihood.first_guess`."""
        _, classes = like_angled(self.half_angles)
        return likelihood.first_guess(self.batch.radiance, self.batch.noise, self.means, classes)

    def about(self, reference: Tensor, residual_scale: ResidualScale = NOISE_ALONE) -> LeastSquares:
        """See `likelihood.about`."""
        batch = self.batch
        return likelihood.about(reference, batch.radiance, batch.noise, self.means, residual_scale.at(batch.points))


# Tiles of one group are computed at the same time, groups one after the other.
Tiles = Iterable[Sequence[Callable[[], Tile]]]


def in_memory(tiles: Iterable[Batch | Tile]) -> list[list[Callable[[], Tile]]]:
    """Tiles, or batches of single pixels, that are in memory."""
    return [[partial(_itself, tile if isinstance(tile, Tile) else Tile(tile)) for tile in tiles]]


def _itself(tile: Tile) -> Tile:
    return tile
