"""The protocol of samples: what an estimate is made from, whatever their source."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol, runtime_checkable

import torch
from torch import Tensor

from matest.parameters import Role
from matest.samples.batch import Batch
from matest.samples.groups import Groups
from matest.samples.residual_scale import NOISE_ALONE, ResidualScale
from matest.samples.tiles import Tiles


@runtime_checkable
class Samples(Protocol):
    """Samples of one material: photographs of an object, a measured table, another model.

    Numbers of batches are float32 or float64, as the source has them; sums over them are made in float64. Samples of
    one group follow one another within a batch: its label comes in one run.

    Attributes:
        channels: C of the radiance.
        relative: whether the strength of the light is known up to one common factor only.
        noise_stated: whether the noise is known; if not, it was estimated from the samples.
        device: where batches lie.
    """

    @property
    def channels(self) -> int: ...

    @property
    def relative(self) -> bool: ...

    @property
    def noise_stated(self) -> bool: ...

    @property
    def device(self) -> torch.device | str: ...

    @property
    def groups(self) -> Groups:
        """How the samples are grouped."""

    def __len__(self) -> int:
        """Number of samples."""

    def optics(self, quantity: Role) -> Tensor | None:
        """The stated wavelength of the channels (µm) or solid angle of the lights (sr); None: not stated."""

    def pilot(self, count: int, seed: int) -> list[Batch]:
        """About `count` samples with every angle and every image, which carry most of the information."""

    def tiles(self, residual_scale: ResidualScale = NOISE_ALONE) -> Tiles:
        """All samples, or fewer that replace many; outliers are judged by the `residual_scale`."""

    def batches(self, size: int, *, shuffle: bool = False, seed: int = 0, skip: int = 0) -> Iterator[Batch]:
        """All samples in batches of `size` for a training loop; the first `skip` are left out."""
