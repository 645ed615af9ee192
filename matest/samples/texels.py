"""Samples texel by texel: all photographs of some pixels of the object at once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from matest.samples import likelihood
from matest.samples.batch import Batch
from matest.samples.likelihood import LeastSquares
from matest.samples.residual_scale import NOISE_ALONE, ResidualScale

# Values this many times as large as nearly all others of a tile are wild.
_WILD = 1e3
# Share of the values that are not.
_TAME_SHARE = 0.9
# Values by which that is judged.
_JUDGED = 4_000
# Least factor of a texel.
_LEAST_RATIO = 1e-3


@dataclass(frozen=True, eq=False)
class TexelTile:
    """I samples of each of n texels, those of the first image first.

    Attributes:
        texels: their places among the N pixels of the object, int64 [n].
        batch: of I·n samples.
        usable: whether each sample counts; the others are in shadow or at the rim, bool [I·n].
    """

    texels: Tensor
    batch: Batch
    usable: Tensor

    def __len__(self) -> int:
        return len(self.texels)

    @property
    def images(self) -> int:
        """I."""
        return len(self.batch) // max(len(self), 1)

    def some(self, places: Tensor) -> TexelTile:
        """Some of the texels, by their places in this tile, int64 [m]."""
        rows = self.rows_of(places)
        return TexelTile(self.texels[places], self.batch[rows], self.usable[rows])

    def of_images(self, images: Sequence[int]) -> TexelTile:
        """The same texels in some of the images, by their places."""
        rows = torch.arange(len(self.batch)).unflatten(0, (self.images, -1))[list(images)].flatten()
        return TexelTile(self.texels, self.batch[rows], self.usable[rows])

    def measuring(self, radiance: Tensor) -> TexelTile:
        """The same texels where a sensor without noise has measured some radiance [I·n, C]."""
        noise, clipped = self.batch.noise, None
        if noise.limits is not None:
            lower, upper = noise.limits
            clipped = (radiance >= upper).to(torch.int8) - (radiance <= lower).to(torch.int8)
        batch = replace(self.batch, radiance=radiance, noise=replace(noise, clipped=clipped))
        return replace(self, batch=batch)

    def rows_of(self, places: Tensor) -> Tensor:
        """The samples of some of the texels, int64 [I·m]."""
        return (torch.arange(self.images)[:, None] * len(self) + places).flatten()

    def first_guess(self, reference: Tensor) -> LeastSquares:
        """A problem in which variances are those of a reference [I·n, C], or of measured values where these are higher.

        What is measured may be dark by accident, and the reference may lack a highlight. Wild values do not count.
        """
        measured = self.batch.radiance
        weight = self.batch.weight(torch.maximum(reference, measured))
        some = measured[:: max(len(measured) // _JUDGED, 1)].abs()
        if len(some):
            weight = torch.where(measured.abs() <= _WILD * some.quantile(_TAME_SHARE, dim=0), weight, 0.0)
        return self._of_usable(LeastSquares(measured, weight, torch.ones_like(weight, dtype=torch.bool)))

    def scaled(self, radiance: Tensor) -> Tensor:
        """Radiance [I·n, C] with a factor for every texel and channel, so that its sum is that of the measured."""
        counts = self.usable.to(radiance).unflatten(0, (self.images, -1))
        parts = []
        for channel in range(radiance.shape[1]):
            model, measured = (
                part[:, channel].unflatten(0, (self.images, -1)) for part in (radiance, self.batch.radiance)
            )
            ratio = (measured * counts).sum(0) / (model * counts).sum(0).clamp(min=torch.finfo(radiance.dtype).tiny)
            parts.append((model * ratio.clamp(_LEAST_RATIO, 1 / _LEAST_RATIO)).flatten())
        return torch.stack(parts).T

    def about(self, reference: Tensor, residual_scale: ResidualScale = NOISE_ALONE) -> LeastSquares:
        """See `likelihood.about`."""
        batch = self.batch
        return self._of_usable(
            likelihood.about(reference, batch.radiance, batch.noise, None, residual_scale.at(batch.points))
        )

    def _of_usable(self, squares: LeastSquares) -> LeastSquares:
        """The same with no weight for samples that do not count."""
        weight = torch.where(self.usable[:, None], squares.weight, 0.0)
        return squares._replace(weight=weight, plain=squares.plain & self.usable[:, None])


# Tiles of one group are computed at the same time, groups one after the other.
TexelTiles = Iterable[Sequence[Callable[[], TexelTile]]]
