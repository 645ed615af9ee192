"""A measured table as samples: directions and values of one model, without a photograph or a file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from matest.parameters import Role
from matest.samples import Batch, Groups, Tiles
from matest.samples.likelihood import MeasurementNoise, Readout
from matest.samples.residual_scale import NOISE_ALONE, ResidualScale
from matest.samples.tiles import in_memory
from matest.scene import Points


@dataclass(frozen=True, eq=False)
class Table:
    """Radiance of a sample lit by irradiance 1 and seen from n pairs of directions.

    Attributes:
        wi, wo: to the light and to the detector [n, 3].
        values: measured radiance f · cos θi [n, C].
        std: of the noise of each value [n, C].
        incidence: number of the incidence that each row was measured at, ascending [n].
    """

    wi: Tensor
    wo: Tensor
    values: Tensor
    std: Tensor
    incidence: Tensor
    relative: bool = False
    noise_stated: bool = True
    device: str = "cpu"

    @property
    def channels(self) -> int:
        return self.values.shape[1]

    @property
    def groups(self) -> Groups:
        return Groups(torch.arange(int(self.incidence.max()) + 1))

    def __len__(self) -> int:
        return len(self.values)

    def optics(self, quantity: Role) -> Tensor | None:  # noqa: ARG002
        return None

    def _rows(self, index: Tensor) -> Batch:
        points = Points(self.wi[index][:, None], self.wo[index], self.values.new_ones(1, 1, 1))
        noise = MeasurementNoise(Readout(self.std[index].square(), self.values.new_zeros(1, 1)))
        return Batch(points, self.values[index], noise, groups=self.incidence[index])

    def pilot(self, count: int, seed: int) -> list[Batch]:
        order = torch.randperm(len(self), generator=torch.Generator().manual_seed(seed))[:count]
        return [self._rows(order.sort().values)]

    def tiles(self, residual_scale: ResidualScale = NOISE_ALONE) -> Tiles:  # noqa: ARG002
        return in_memory([self._rows(torch.arange(len(self)))])

    def batches(self, size: int, *, shuffle: bool = False, seed: int = 0, skip: int = 0) -> Iterator[Batch]:
        order = torch.arange(len(self))
        if shuffle:
            order = torch.randperm(len(self), generator=torch.Generator().manual_seed(seed))
        yield from (self._rows(rows) for rows in order.split(size)[skip:])
