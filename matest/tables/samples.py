"""A measured table as samples: the radiance f cos θi of a surface under an irradiance of 1."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from matest.parameters import Role
from matest.samples import Batch, Groups, Tile, Tiles
from matest.samples.account import Account
from matest.samples.likelihood import MeasurementNoise, Readout
from matest.samples.residual_scale import NOISE_ALONE, ResidualScale
from matest.scene import Points
from matest.tables.loss import Loss
from matest.tables.table import Table

# Radians. Incidences that differ by less are one.
_SAME_INCIDENCE = math.radians(0.5)
# With more distinct incidences than this, bands of them are the groups.
_MAX_INCIDENCES = 24
# Radians: width of such a band.
_BAND = math.radians(10)
# Rows of a tile: torch is busy, and its tensors fit the cache.
_TILE_ROWS = 16_384
# Share of a subsample that is drawn evenly over the rows, which lie closer near highlights; the rest by solid angle.
_EVEN_SHARE = 0.5


class TableNoise(NamedTuple):
    """Noise of the compared values of each channel: variance = floor² + (relative · y)².

    Attributes:
        relative: standard deviation as a share of the value [C].
        floor: standard deviation of what is dark [C]; of a cost that is no likelihood that of all values.
    """

    relative: Tensor
    floor: Tensor


class Incidence(NamedTuple):
    """Values measured under nearly one polar angle of the light.

    Attributes:
        label: as people read it.
        theta: mean polar angle, rad.
        rows: of the table.
    """

    label: str
    theta: float
    rows: slice


@dataclass(frozen=True, eq=False)
class TableSamples:
    """The samples of a table, grouped by incidence: what is left out in turn, and the clusters of the jackknife.

    Attributes:
        table: whose rows follow one another in incidence.
        loss: what a fit minimises.
        noise: of the values.
        incidences: the groups.
        noise_stated: whether the user stated the noise; if not, it is estimated from the residuals of the fit.
    """

    table: Table
    loss: Loss
    noise: TableNoise
    incidences: tuple[Incidence, ...]
    noise_stated: bool = True
    device: str = "cpu"

    @classmethod
    def of(cls, table: Table, loss: Loss, noise: TableNoise, *, noise_stated: bool) -> TableSamples:
        """The samples of a table in any order."""
        order, incidences = _incidences(table)
        measure = None if table.measure is None else table.measure[order]
        ordered = replace(table, wi=table.wi[order], wo=table.wo[order], values=table.values[order], measure=measure)
        return cls(ordered, loss, noise, incidences, noise_stated)

    def with_noise(self, noise: TableNoise) -> TableSamples:
        return replace(self, noise=noise)

    @property
    def channels(self) -> int:
        return self.table.values.shape[1]

    @property
    def relative(self) -> bool:
        return self.table.relative

    @cached_property
    def groups(self) -> Groups:
        return Groups(torch.arange(len(self.incidences)))

    @cached_property
    def labels(self) -> Tensor:
        """The incidence of every row, int64 [n]."""
        counts = torch.tensor([one.rows.stop - one.rows.start for one in self.incidences])
        return torch.arange(len(self.incidences)).repeat_interleave(counts)

    @cached_property
    def radiance(self) -> Tensor:
        """y = f cos θi [n, C]."""
        return self.table.values * self.table.wi[:, 2:]

    @cached_property
    def variance_shares(self) -> Tensor:
        """Variance of each row relative to that of a row of mean solid angle [n, 1]."""
        shares = self.loss.variance_shares(self.table.wi[:, 2:])
        return shares if self.table.measure is None else shares / self.table.measure

    @cached_property
    def account(self) -> Account:
        return Account(
            names=[one.label for one in self.incidences],
            notes=self.table.notes,
            images=range(len(self.incidences)),
            counts=[one.rows.stop - one.rows.start for one in self.incidences],
            skipped={"saturated": 0, **self.table.skipped},
            subject="measurements",
        )

    def __len__(self) -> int:
        return len(self.table)

    def optics(self, quantity: Role) -> Tensor | None:
        return self.table.wavelengths if quantity is Role.WAVELENGTH else None

    def rows(self, index: slice | Tensor, variance: Tensor | float = 1.0) -> Batch:
        """A batch of some rows, with this many times their variance."""
        table, radiance = self.table, self.radiance[index]
        shares = self.variance_shares[index] * variance
        readout = Readout(
            read=self.noise.floor.square() * shares,
            gain=torch.zeros(1, 1, dtype=radiance.dtype),
            rounding=self.noise.relative.square() * shares,
            power=torch.full((1, 1), 2.0, dtype=radiance.dtype),
        )
        points = Points(table.wi[index][:, None], table.wo[index], radiance.new_ones(1, 1, 1))
        return Batch(
            points, radiance, MeasurementNoise(readout, comparison=self.loss.comparison), groups=self.labels[index]
        )

    def pilot(self, count: int, seed: int) -> list[Batch]:
        """About `count` rows of all incidences, or all rows of a small table, one batch an incidence.

        Rows are drawn half evenly over the table, which is finer near highlights, and half by their solid angle. Each
        counts for those that it stands for.
        """
        if len(self) <= count:
            return [self.rows(one.rows) for one in self.incidences]
        even = torch.full((len(self),), 1 / len(self), dtype=torch.float64)
        by_angle = even if self.table.measure is None else self.table.measure[:, 0] / self.table.measure.sum()
        chances = _EVEN_SHARE * even + (1 - _EVEN_SHARE) * by_angle
        # One draw in each of so many strata of equal chance: every part of every incidence has its share.
        generator = torch.Generator().manual_seed(seed)
        marks = (torch.arange(count) + torch.rand(count, generator=generator, dtype=torch.float64)) / count
        drawn = torch.searchsorted(chances.cumsum(0), marks).clamp(max=len(self) - 1).unique()
        stands_for = (1 / (count * chances[drawn])).clamp(min=1)
        labels = self.labels[drawn]
        return [
            self.rows(drawn[labels == number], 1 / stands_for[labels == number, None])
            for number in labels.unique().tolist()
        ]

    def tiles(self, residual_scale: ResidualScale = NOISE_ALONE) -> Tiles:  # noqa: ARG002
        starts = range(0, len(self), _TILE_ROWS)
        return [[partial(self._tile, start) for start in starts]]

    def _tile(self, start: int) -> Tile:
        return Tile(self.rows(slice(start, start + _TILE_ROWS)))

    def batches(self, size: int, *, shuffle: bool = False, seed: int = 0, skip: int = 0) -> Iterator[Batch]:
        order = torch.arange(len(self))
        if shuffle:
            order = torch.randperm(len(self), generator=torch.Generator().manual_seed(seed))
        # Labels of a group come in one run.
        yield from (self.rows(rows.sort().values) for rows in order.split(size)[skip:])


def _incidences(table: Table) -> tuple[Tensor, tuple[Incidence, ...]]:
    """An order of the rows by incidence, and the incidences."""
    theta = torch.acos(table.wi[:, 2].clamp(-1, 1)).double().numpy()
    order = np.argsort(theta, kind="stable")
    ascending = theta[order]
    starts = np.flatnonzero(np.diff(ascending, prepend=-np.inf) > _SAME_INCIDENCE)
    banded = len(starts) > _MAX_INCIDENCES or ascending[starts[-1] :].max() - ascending[starts].max() > _BAND
    if banded:
        starts = np.searchsorted(ascending, np.arange(0, math.pi / 2, _BAND))
        starts = starts[np.diff(starts, append=len(order)) > 0]
    ends = np.append(starts[1:], len(order))
    parts = [ascending[start:end] for start, end in zip(starts, ends, strict=True)]
    labels = [_band(part) if banded else f"{np.degrees(part.mean()):.3g}°" for part in parts]
    slices = [slice(int(start), int(end)) for start, end in zip(starts, ends, strict=True)]
    incidences = (
        Incidence(label, float(part.mean()), rows) for label, part, rows in zip(labels, parts, slices, strict=True)
    )
    return torch.from_numpy(order), tuple(incidences)


def _band(angles: np.ndarray) -> str:
    """The band of angles as people read it."""
    number = int(angles[0] / _BAND + 1e-9)
    return " to ".join(f"{round(math.degrees(end * _BAND))}°" for end in (number, number + 1))
