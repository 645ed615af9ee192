"""Samples texel by texel: all photographs of some pixels of the object at once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from matest.samples import likelihood
from matest.samples.batch import Batch
from matest.samples.likelihood import LeastSquares, MeasurementNoise
from matest.samples.residual_scale import NOISE_ALONE, ResidualScale, half_angle
from matest.scene import Points

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
        points: geometry and light [I or 1, n or 1, ...]; the viewer is the same in all images.
        radiance: measured [I·n, C]; each channel is an array of its own.
        noise: of it.
        usable: whether each sample counts; the others are in shadow or at the rim, bool [I·n].
    """

    texels: Tensor
    points: Points
    radiance: Tensor
    noise: MeasurementNoise
    usable: Tensor

    def __len__(self) -> int:
        return len(self.texels)

    @property
    def images(self) -> int:
        """I."""
        return len(self.radiance) // max(len(self), 1)

    @cached_property
    def batch(self) -> Batch:
        """The samples, points being those of all images and texels in a grid."""
        return Batch(self.points, self.radiance, self.noise)

    @cached_property
    def in_a_row(self) -> Batch:
        """The samples one after another."""
        points, count = self.points, len(self.radiance)
        grid = (self.images, len(self))

        def flat(part: Tensor, inner: int) -> Tensor:
            return part.expand(*grid, *part.shape[-inner:]).reshape(count, *part.shape[-inner:])

        ambient = None if points.ambient is None else flat(points.ambient, 1)
        row = Points(flat(points.wi, 2), flat(points.wo, 1), flat(points.irradiance, 2), ambient)
        return Batch(row, self.radiance, self.noise)

    @property
    def half_angles(self) -> Tensor:
        """Of all samples [I·n], see `half_angle`."""
        return half_angle(self.points).expand(self.images, len(self)).flatten()

    def some(self, places: Tensor) -> TexelTile:
        """Some of the texels, by their places in this tile, int64 [m]."""
        return self._taken(self.texels[places], self.rows_of(places), 1, places)

    def of_images(self, images: Sequence[int]) -> TexelTile:
        """The same texels in some of the images, by their places."""
        places = torch.tensor(list(images), dtype=torch.int64)
        rows = (places[:, None] * len(self) + torch.arange(len(self))).flatten()
        return self._taken(self.texels, rows, 0, places)

    def _taken(self, texels: Tensor, rows: Tensor, axis: int, places: Tensor) -> TexelTile:
        """Samples at some rows [m], which lie at some places along an axis of the grid of points."""

        def at(part: Tensor) -> Tensor:
            return part if part.shape[axis] == 1 else part.index_select(axis, places)

        points = self.points
        ambient = None if points.ambient is None else at(points.ambient)
        return TexelTile(
            texels,
            Points(at(points.wi), at(points.wo), at(points.irradiance), ambient),
            self.radiance.T[:, rows].T,
            self.noise[rows],
            self.usable[rows],
        )

    def measuring(self, radiance: Tensor) -> TexelTile:
        """The same texels where a sensor without noise has measured some radiance [I·n, C]."""
        clipped = None
        if self.noise.limits is not None:
            lower, upper = self.noise.limits
            clipped = (radiance >= upper).to(torch.int8) - (radiance <= lower).to(torch.int8)
        return replace(self, radiance=radiance, noise=replace(self.noise, clipped=clipped))

    def rows_of(self, places: Tensor) -> Tensor:
        """The samples of some of the texels, int64 [I·m]."""
        return (torch.arange(self.images)[:, None] * len(self) + places).flatten()

    def first_guess(self, reference: Tensor) -> LeastSquares:
        """A problem in which variances are those of a reference [I·n, C], or of measured values where these are higher.

        What is measured may be dark by accident, and the reference may lack a highlight. Wild values do not count.
        """
        measured = self.radiance
        weight = self.batch.weight(torch.maximum(reference, measured))
        some = measured[:: max(len(measured) // _JUDGED, 1)].abs()
        if len(some):
            weight = weight * (measured.abs() <= _WILD * some.quantile(_TAME_SHARE, dim=0)).to(weight)
        return self._of_usable(LeastSquares(measured, weight, torch.ones_like(weight, dtype=torch.bool)))

    def ratios(self, radiance: Tensor) -> Tensor:
        """How much brighter each texel is in each channel than some radiance [I·n, C] on average [C, n]."""
        counts = self.usable.to(radiance)
        model, measured = (
            (part.T * counts).unflatten(1, (self.images, -1)).sum(1) for part in (radiance, self.radiance)
        )
        ratio = measured / model.clamp(min=torch.finfo(radiance.dtype).tiny)
        return ratio.clamp(_LEAST_RATIO, 1 / _LEAST_RATIO)

    def about(self, reference: Tensor, residual_scale: ResidualScale = NOISE_ALONE) -> LeastSquares:
        """See `likelihood.about`."""
        scale = residual_scale.at(self.points)
        if isinstance(scale, Tensor):
            scale = scale.unflatten(0, (-1, 1 if len(scale) == self.images else len(self)))
            scale = scale.expand(self.images, len(self), 1).flatten(0, 1)
        return self._of_usable(likelihood.about(reference, self.radiance, self.noise, None, scale))

    def _of_usable(self, squares: LeastSquares) -> LeastSquares:
        """The same with no weight for samples that do not count."""
        # A product with numbers 0 and 1: torch is ten times slower where it chooses.
        return squares._replace(
            weight=squares.weight * self.usable[:, None].to(squares.weight), plain=squares.plain & self.usable[:, None]
        )


# Tiles of one group are computed at the same time, groups one after the other.
TexelTileGroups = Iterable[Sequence[Callable[[], TexelTile]]]
