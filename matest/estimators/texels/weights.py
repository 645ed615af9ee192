"""The weights of the columns of a model that separates, for shapes that differ from texel to texel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from matest.brdf import Term
from matest.directions import Directions
from matest.estimators.texels.unknowns import TexelUnknowns

# Nodes of a table over the domain of a shape: cubics between them are exact to single precision.
_NODES = 257


class UnitWeights(NamedTuple):
    """The weights of the columns of every term, its factors being 1, and their slopes by shape parameters.

    Attributes:
        plain: of each term [1 or W, Q, 1 or n].
        slopes: of each term, by the parameter's name [1 or W, Q, 1 or n].
    """

    plain: list[Tensor]
    slopes: Mapping[str, list[Tensor]]


def unit_weights(texels: TexelUnknowns, values: Mapping[str, Tensor]) -> UnitWeights:
    """The weights where parameters have these values [1 or C, 1 or n]."""
    terms, leaves = _probe(texels, values)
    plain: list[Tensor] = []
    slopes: dict[str, list[Tensor]] = {name: [] for name in leaves}
    for term, size in zip(terms, texels.problem.brdf.structure.columns, strict=True):
        weights = torch.ones(1, 1, size, dtype=torch.float64) if term.weights is None else term.weights
        plain.append(weights.detach()[(None,) * (3 - weights.ndim)].permute(1, 2, 0))
        for name, leaf in leaves.items():
            slopes[name].append(_by_leaf(weights, leaf, size))
    return UnitWeights(plain, slopes)


@dataclass(frozen=True, eq=False)
class WeightTable:
    """The weights at any value of one shape parameter, by cubic interpolation (Hermite).

    Attributes:
        name: of the parameter.
        start: of its domain.
        step: between nodes.
        sizes: Q of each term.
        rows: coefficients of the cubics of all terms between each node and the next, of ascending powers [S − 1, 4 K].
        others: slopes of all terms by other shape parameters, interpolated linearly [S, K].
    """

    name: str
    start: float
    step: float
    sizes: tuple[int, ...]
    rows: Tensor
    others: Mapping[str, Tensor]

    @classmethod
    def of(cls, texels: TexelUnknowns, unknowns: Tensor) -> WeightTable:
        """Over the domain of the only mapped shape, parameters in common being those of u [P]."""
        (name,) = texels.shapes
        domain = texels.problem.domain(name)
        theta = texels.spread(unknowns, _NODES)
        theta[texels.at(name)] = torch.linspace(domain.lower, domain.upper, _NODES, dtype=torch.float64)
        weights = unit_weights(texels, texels.values(unknowns, theta))
        step = domain.width / (_NODES - 1)

        def stacked(parts: list[Tensor]) -> Tensor:
            return torch.cat([part[0].expand(-1, _NODES) for part in parts]).T

        slopes = {key: stacked(parts) for key, parts in weights.slopes.items()}
        values, rises = stacked(weights.plain), slopes.pop(name) * step
        change = values[1:] - values[:-1]
        bend_before, bend_after = rises[:-1] - change, change - rises[1:]
        powers = (values[:-1], rises[:-1], bend_after - 2 * bend_before, bend_before - bend_after)
        rows = torch.cat(powers, dim=1)
        sizes = tuple(texels.problem.brdf.structure.columns)
        return cls(name, domain.lower, step, sizes, rows, slopes)

    def at(self, values: Tensor) -> UnitWeights:
        """The weights at values [n]."""
        place = (values - self.start) / self.step
        node = place.detach().floor().clamp(0, _NODES - 2).long()
        t = place - node
        constant, linear, square, cubic = self.rows.to(values).index_select(0, node).T.contiguous().chunk(4)
        last = square + t * cubic
        middle = linear + t * last
        weights = constant + t * middle
        # Horner's scheme again, for the derivative.
        slopes = middle + t * (last + t * cubic)
        by_name = {self.name: self._terms(slopes / self.step)}
        for name, table in self.others.items():
            table = table.to(values)
            by_name[name] = self._terms(torch.lerp(table[node], table[node + 1], t[:, None]).T)
        return UnitWeights(self._terms(weights), by_name)

    def _terms(self, columns: Tensor) -> list[Tensor]:
        """Columns of all terms [K, n] by term, each [1, Q, n]."""
        return [part[None] for part in columns.split(self.sizes)]


def _probe(texels: TexelUnknowns, values: Mapping[str, Tensor]) -> tuple[tuple[Term, ...], dict[str, Tensor]]:
    """The terms at one pair of directions, and the shape parameters [n, W] that they depend on."""
    problem = texels.problem
    width = max((problem.count(name) for name in problem.shapes), default=1)
    length = max((values[name].shape[1] for name in problem.shapes), default=1)
    leaves = {name: values[name].T.expand(length, width).clone().requires_grad_() for name in problem.shapes}
    given = {name: value.T for name, value in values.items()} | leaves
    given |= {name: leaves[source] for name, source in problem.ties.items() if source in leaves}
    normal = torch.tensor([[0.0, 0.0, 1.0]], dtype=next(iter(values.values())).dtype)
    with torch.enable_grad():
        return problem.brdf.replace(given).terms(Directions(normal, normal)), leaves


@torch.enable_grad()
def _by_leaf(weights: Tensor, leaf: Tensor, size: int) -> Tensor:
    """Derivatives of weights [n, W, Q] by a parameter [n, W] that each depends on alone, [W, Q, n]."""
    if not weights.requires_grad:
        return weights.new_zeros(1, size, 1)
    parts = []
    for column in range(size):
        (slope,) = torch.autograd.grad(weights[..., column].sum(), leaf, retain_graph=True, allow_unused=True)
        parts.append(torch.zeros_like(leaf) if slope is None else slope)
    return torch.stack(parts, dim=-1).permute(1, 2, 0)
