"""The least-squares problem of the texels of a tile, and the priors of their unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from torch import Tensor

from matest.estimators.columns import Columns
from matest.estimators.texels.models import TexelModel, radiance
from matest.estimators.texels.sums import TexelGram, TexelNormal
from matest.estimators.texels.unknowns import Row
from matest.samples.likelihood import LeastSquares
from matest.samples.texels import TexelTile


class TexelPrior(NamedTuple):
    """Gaussian priors of the unknowns of n texels, both [T, n].

    Attributes:
        mean: of each.
        precision: inverse variance.
    """

    mean: Tensor
    precision: Tensor

    def added(self, normal: TexelNormal, theta: Tensor) -> TexelNormal:
        """A problem at θ with the priors' terms; further rows have none."""
        count = len(theta)
        below = self.mean - theta
        gradient, information = normal.gradient.clone(), normal.information.clone()
        gradient[:count] += self.precision * below
        information.diagonal()[:, :count] += self.precision.T
        return TexelNormal(normal.cost + (self.precision * below.square()).sum(0), gradient, information)

    def some(self, places: Tensor) -> TexelPrior:
        """Those of some of the texels."""
        return TexelPrior(self.mean[:, places], self.precision[:, places])


@dataclass(frozen=True, eq=False)
class TexelProblem:
    """The least-squares problem of the texels of a tile.

    Attributes:
        tile: of n texels.
        model: of them.
        squares: of the samples.
        columns: of the model, where it separates.
        sums: of these, likewise.
    """

    tile: TexelTile
    model: TexelModel
    squares: LeastSquares
    columns: Columns | None = None
    sums: TexelGram | None = None

    @classmethod
    def of(cls, first: TexelProblem, squares: LeastSquares, theta: Tensor) -> TexelProblem:
        """The problem of other least squares, which are expanded near θ."""
        if first.columns is None:
            return replace(first, squares=squares)
        reference = first.model.coefficients(theta).total
        return replace(first, squares=squares, sums=TexelGram.of(first.columns, squares, reference, first.tile.images))

    def normal(self, theta: Tensor, rows: Sequence[Row]) -> TexelNormal:
        """What the samples tell of some unknowns."""
        at = self.model.coefficients(theta, {row.name for row in rows})
        if self.sums is not None:
            return self.sums.normal(at, rows)
        columns = self.model.columns(self.tile, theta)
        return TexelGram.of(columns, self.squares, at.total, self.tile.images).normal(at, rows)

    def by_image(self, theta: Tensor, rows: Sequence[Row]) -> TexelNormal:
        """What the samples of each photograph tell of some unknowns [..., I, n]."""
        images = self.tile.images
        at = self.model.coefficients(theta.repeat(1, images), {row.name for row in rows})
        normal = TexelGram.of(self._columns_at(theta), self.squares, at.total, 1).normal(at, rows)
        return TexelNormal(*(part.unflatten(-1, (images, -1)) for part in normal))

    def radiance(self, theta: Tensor) -> Tensor:
        """Of the samples [I·n, C]."""
        return radiance(self._columns_at(theta), self.model.coefficients(theta), self.tile.images)

    def _columns_at(self, theta: Tensor) -> Columns:
        """The columns at θ, which may be the same everywhere."""
        return self.model.columns(self.tile, theta) if self.columns is None else self.columns

    def some(self, places: Tensor) -> TexelProblem:
        """That of some of the texels; where the model separates, of its sums alone."""
        if len(places) == len(self.tile):
            return self
        if self.sums is not None:
            return replace(self, sums=self.sums.some(places))
        rows = self.tile.rows_of(places)
        return TexelProblem(self.tile.some(places), self.model, self.squares.some(rows))
