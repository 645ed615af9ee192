"""A model with parameters of its own at every texel: its columns over a tile, and their coefficients."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from copy import copy
from functools import cached_property
from typing import Protocol

import torch
from torch import Tensor

from matest.estimators.basis import NodesBasis, SeparatedBasis, TangentBasis, derivative, product
from matest.estimators.columns import Columns
from matest.estimators.texels.sums import Coefficients
from matest.estimators.texels.unknowns import TexelUnknowns
from matest.estimators.texels.weights import UnitWeights, WeightTable, unit_weights
from matest.samples import Tile
from matest.samples.texels import TexelTile

# Samples × lights × nodes that a model is evaluated at together.
_EVALUATED_TOGETHER = 1 << 18

# Values of the mapped shapes, by name.
Node = Mapping[str, float]


class TexelModel(Protocol):
    """A model whose parameters in common are known.

    Attributes:
        separates: whether its columns do not depend on θ.
    """

    @property
    def separates(self) -> bool: ...

    def columns(self, tile: TexelTile, theta: Tensor) -> Columns:
        """Its columns over a tile at θ [T, n]."""

    def coefficients(self, theta: Tensor, names: Collection[str] = ()) -> Coefficients:
        """The coefficients of the columns at θ [T, n], and their slopes by some parameters."""


def texel_model(texels: TexelUnknowns, unknowns: Tensor) -> TexelModel:
    """The model of a problem where parameters in common are those of u [P]."""
    return (SeparatedTexels if texels.problem.separates else ShadedTexels)(texels, unknowns)


def radiance(columns: Columns, coefficients: Coefficients, images: int) -> Tensor:
    """Radiance [I·n, C] of a tile; each channel is an array of its own."""
    values = columns.values.unflatten(-1, (images, -1))
    weights = coefficients.total.to(values) * columns.tint[:, None, None]
    parts = [(weight[:, None] * values[min(c, len(values) - 1)]).sum(0).flatten() for c, weight in enumerate(weights)]
    return torch.stack(parts).T


class SeparatedTexels:
    """A model whose columns depend on no parameter: one evaluation of them serves all values of θ."""

    separates = True

    def __init__(self, texels: TexelUnknowns, unknowns: Tensor) -> None:
        self._texels, self._unknowns = texels, unknowns
        self._basis = SeparatedBasis(texels.problem, unknowns)

    def columns(self, tile: TexelTile, theta: Tensor) -> Columns:  # noqa: ARG002
        """See `TexelModel`."""
        return self._basis.columns(Tile(tile.batch))

    def coefficients(self, theta: Tensor, names: Collection[str] = ()) -> Coefficients:
        """See `TexelModel`."""
        problem = self._texels.problem
        values = self._texels.values(self._unknowns, theta)
        weights = self._weights(theta, values)
        totals: list[Tensor] = []
        slopes: dict[str, list[Tensor]] = {name: [] for name in names}
        for k, factors in enumerate(problem.brdf.structure.products):
            amplitude = product(values, factors)[:, None]
            plain = weights.plain[k].to(theta)
            totals.append(self._every(amplitude * plain, theta))
            for name in names:
                if name in problem.shapes:
                    part = amplitude * weights.slopes[name][k].to(theta)
                else:
                    part = _column(derivative(values, problem.ties, factors, name), theta)[:, None] * plain
                slopes[name].append(self._every(part, theta))
        return Coefficients(torch.cat(totals, dim=1), {name: torch.cat(parts, dim=1) for name, parts in slopes.items()})

    def _weights(self, theta: Tensor, values: Mapping[str, Tensor]) -> UnitWeights:
        """The weights of the columns at θ."""
        if not self._texels.shapes:
            return self._in_common
        if self._table is not None:
            return self._table.at(theta[self._texels.at(self._texels.shapes[0])][0])
        return unit_weights(self._texels, values)

    @cached_property
    def _in_common(self) -> UnitWeights:
        """The weights where all texels have the same shapes."""
        nothing = torch.zeros(len(self._texels.rows), 1, dtype=torch.float64)
        return unit_weights(self._texels, self._texels.values(self._unknowns, nothing))

    @cached_property
    def _table(self) -> WeightTable | None:
        """The weights at any value of the only mapped shape; None where there are several, or it has no ends."""
        texels = self._texels
        is_one = len(texels.shapes) == 1 and all(texels.problem.count(name) == 1 for name in texels.problem.shapes)
        domain = texels.problem.domain(texels.shapes[0])
        return WeightTable.of(texels, self._unknowns) if is_one and math.isfinite(domain.width) else None

    def _every(self, part: Tensor, theta: Tensor) -> Tensor:
        """Coefficients of every channel and texel [C, K, n]."""
        return part.expand(self._texels.problem.channels, -1, theta.shape[1])


class ShadedTexels:
    """A model whose columns are evaluated wherever θ goes.

    The light of the sky is reflected as by the shapes in common: a table over the sky for every texel would take
    longer than all lights together.
    """

    separates = False

    def __init__(self, texels: TexelUnknowns, unknowns: Tensor) -> None:
        self._texels, self._unknowns = texels, unknowns
        self._basis = _TexelBasis(texels.problem, unknowns)

    def columns(self, tile: TexelTile, theta: Tensor) -> Columns:
        """See `TexelModel`."""
        own = {name: theta[self._texels.at(name)].T[None, :, None] for name in self._texels.shapes}
        ties = {name: own[source] for name, source in self._texels.problem.ties.items() if source in own}
        return self._basis.of_samples(own | ties).columns(Tile(tile.batch))

    def node_columns(self, tile: TexelTile, nodes: Sequence[Node]) -> Iterator[Columns]:
        """The first columns, those with a radiance, where the mapped shapes are those of each node."""
        batch = tile.in_a_row
        together = max(_EVALUATED_TOGETHER // max(len(batch) * batch.points.wi.shape[-2], 1), 1)
        for first in range(0, len(nodes), together):
            points = [self._at_node(node) for node in nodes[first : first + together]]
            columns = NodesBasis(self._texels.problem, points).columns(Tile(batch), cut=False)
            for values in columns.values.unflatten(-1, (len(points), -1)).unbind(2):
                yield Columns(values, columns.tint)

    def coefficients(self, theta: Tensor, names: Collection[str] = ()) -> Coefficients:
        """See `TexelModel`."""
        problem, basis = self._texels.problem, self._basis
        values = self._texels.values(self._unknowns, theta)
        products = [self._every(product(values, factors), theta) for factors in basis.factors]
        no_radiance = torch.zeros_like(products[0])
        slopes = {}
        for name in names:
            if name in problem.shapes:
                by_term = [no_radiance] * len(products)
                by_shape = [products[k] if shape == name else no_radiance for shape, k in basis.derivatives]
            else:
                by_factor = [derivative(values, problem.ties, factors, name) for factors in basis.factors]
                by_term = [self._every(_column(each, theta), theta) for each in by_factor]
                by_shape = [no_radiance] * len(basis.derivatives)
            slopes[name] = torch.stack([*by_term, *by_shape], dim=1)
        return Coefficients(torch.stack([*products, *[no_radiance] * len(basis.derivatives)], dim=1), slopes)

    def _at_node(self, node: Node) -> Tensor:
        """u [P] at a node."""
        unknowns = self._unknowns.clone()
        for name, value in node.items():
            unknowns[self._texels.problem.where[name]] = value
        return unknowns

    def _every(self, part: Tensor, theta: Tensor) -> Tensor:
        """A coefficient of every channel and texel [C, n]."""
        return part.expand(self._texels.problem.channels, theta.shape[1])


def _column(part: Tensor | float, theta: Tensor) -> Tensor:
    """A derivative [1 or C, 1 or n] that may be a mere number."""
    return torch.as_tensor(part).to(theta).reshape(1, 1) if not isinstance(part, Tensor) else part


class _TexelBasis(TangentBasis):
    """The terms of a model, and their derivatives, with values of its shape parameters at every sample."""

    _in_common: TangentBasis | None = None

    def of_samples(self, values: Mapping[str, Tensor]) -> _TexelBasis:
        """The same basis where some shape parameters have values [1, n, 1, 1 or C] at the points of a grid."""
        out = copy(self)
        out._in_common = self
        out._values = {**self._values, **values}
        return out

    def _over_sky(self, like: Tensor) -> list[Tensor]:
        return super()._over_sky(like) if self._in_common is None else self._in_common._over_sky(like)
