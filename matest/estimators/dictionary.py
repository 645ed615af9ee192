"""A dictionary of columns: the terms of several models at the nodes of their shape parameters, each evaluated once."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import torch
from torch import Tensor

from matest.brdf import Brdf, Sum
from matest.directions import Directions
from matest.estimators.basis import Basis
from matest.estimators.columns import Columns
from matest.estimators.search import Normal
from matest.estimators.unknowns import Problem
from matest.samples import Tile

# Share of the largest radiance of all columns: less than this is rounding.
_NEGLIGIBLE = 1e-12

# Nodes of the free shape parameters of a problem, by path: the same number of each, or a single one.
Grid = Mapping[str, Sequence[float]]


class _Part(NamedTuple):
    """The columns of one term of a problem.

    Attributes:
        axis: position of the free shape parameter that the term depends on; None: it depends on none.
        first: position of its first column in the dictionary.
        weights: of its columns at every node [S, 1 or C, Q]; None: each column is the term at one node.
    """

    axis: int | None
    first: int
    weights: Tensor | None


class Dictionary(Basis):
    """The columns of several problems at the nodes of grids over their shape parameters.

    Columns that problems share are evaluated once.

    Args:
        problems: with the grid of each; all for the same samples.

    Raises:
        ValueError: a term that depends on several shape parameters.
    """

    def __init__(self, problems: Sequence[tuple[Problem, Grid]]) -> None:
        super().__init__(problems[0][0], None)
        self._problems = problems
        self._components: dict[tuple[object, ...], _Component] = {}
        self._parts: list[list[_Part]] = []
        starts: dict[tuple[object, ...], list[int]] = {}
        size = 0
        for problem, grid in problems:
            parts: list[_Part] = []
            for component in _components(problem, grid):
                if component.key not in starts:
                    self._components[component.key] = component
                    ends = list(itertools.accumulate(component.sizes, initial=size))
                    starts[component.key], size = ends[:-1], ends[-1]
                parts += component.parts(starts[component.key])
            self._parts.append(parts)
        self.coefficients = torch.zeros(problems[0][0].channels, size, dtype=torch.float64)

    def columns(self, tile: Tile, *, cut: bool = False) -> Columns:
        """The K columns. Without coefficients no light can be cut."""
        columns = super().columns(tile, cut=cut)
        # Products of the far tails of narrow lobes would leave the range of normal numbers, where a processor is slow.
        negligible = columns.values.abs() < _NEGLIGIBLE * columns.values.abs().amax()
        return replace(columns, values=columns.values.masked_fill(negligible, 0.0))

    def normal_equations(self, member: int, gram: Tensor, moment: Tensor) -> Normal:
        """Those of one of the problems at every combination of its nodes, in the order of `itertools.product`.

        Args:
            member: position of the problem.
            gram: of all columns [C, K, K].
            moment: of all columns [C, K].
        """
        problem, grid = self._problems[member]
        indices = [*itertools.product(*(range(len(grid[name])) for name in problem.shapes))]
        nodes = torch.tensor(indices, dtype=torch.int64).reshape(len(indices), len(problem.shapes))
        mix = torch.zeros(
            len(nodes), problem.channels, self.coefficients.shape[1], len(self._parts[member]), dtype=torch.float64
        )
        for term, (axis, first, weights) in enumerate(self._parts[member]):
            node = torch.zeros(len(nodes), dtype=torch.int64) if axis is None else nodes[:, axis]
            if weights is None:
                mix[torch.arange(len(nodes)), :, first + node, term] = 1
            else:
                mix[:, :, first : first + weights.shape[-1], term] = weights[node]
        kept = mix.any(-1).any(0).any(0).nonzero()[:, 0]
        mix = mix[:, :, kept]
        gram, moment = gram[:, kept][:, :, kept], moment[:, kept]
        return problem.brdf.structure.products, mix.mT @ gram @ mix, (mix.mT @ moment[..., None])[..., 0]

    def _shapes(self, directions: Directions, lead: torch.Size, like: Tensor) -> list[Tensor]:
        return [shape for part in self._components.values() for shape in part.shapes(directions, lead, like)]


@dataclass(frozen=True, eq=False)
class _Component:
    """One component of the model of a problem, at all nodes of its shape parameters side by side.

    Attributes:
        brdf: the component.
        prefix: of the paths of its parameters.
        problem: that it belongs to.
        grid: of the problem.
    """

    brdf: Brdf
    prefix: str
    problem: Problem
    grid: Grid

    @cached_property
    def key(self) -> tuple[object, ...]:
        """What its columns depend on."""
        return self.brdf.expression, *((name, *value.reshape(-1).tolist()) for name, value in self._values.items())

    @cached_property
    def sizes(self) -> list[int]:
        """The number of columns of each term."""
        return [self._columns(term) if self._mixes(term) else self._nodes(term) for term in self._terms]

    def parts(self, starts: Sequence[int]) -> Iterator[_Part]:
        """Each of its terms, whose columns start at these positions."""
        for term, first in zip(self._terms, starts, strict=True):
            axis = self._axis(term)
            position = None if axis is None else self.problem.shapes.index(axis)
            yield _Part(position, first, self._weights(term) if self._mixes(term) else None)

    def shapes(self, directions: Directions, lead: torch.Size, like: Tensor) -> Iterator[Tensor]:
        """Every column [..., 1 or C] at directions of size `lead`, term by term."""
        # Mixtures take any value: their columns depend on none.
        side_by_side = any(self._axis(term) and not self._mixes(term) for term in self._terms)
        nodes = slice(None if side_by_side else 1)
        values = {
            name: (value[nodes].reshape(-1, *[1] * (len(lead) + 1)) if name in self._gridded else value).to(like)
            for name, value in self._values.items()
        }
        for k, term in enumerate(self.brdf.replace(values).terms(directions)):
            if self._mixes(k) and term.columns is not None:
                yield from (column.expand(*lead, -1) for column in term.columns.split(1, dim=-1))
            elif self._axis(k) is None:
                yield term.shape.expand(*lead, -1)
            else:
                yield from term.shape.expand(-1, *lead, -1)

    @property
    def _terms(self) -> range:
        return range(len(self.brdf.structure.terms))

    @cached_property
    def _values(self) -> dict[str, Tensor]:
        """Values of the parameters that its shapes depend on: those held, a scalar or [C], and the nodes [S]."""
        names = {name for term in self.brdf.structure.terms for name in term.shape_parameters}
        values = {}
        for name in self.brdf.declared:
            nodes = self.grid.get(self._source(name))
            if name in names and nodes is not None:
                values[name] = torch.tensor(nodes if len(nodes) > 1 else nodes[0], dtype=torch.float64)
            elif name in names:
                values[name] = self.problem.held[self._source(name)].double()
        return values

    @cached_property
    def _gridded(self) -> set[str]:
        """Its parameters that run through several nodes."""
        return {name for name in self.brdf.declared if len(self.grid.get(self._source(name), ())) > 1}

    def _source(self, name: str) -> str:
        """The path of the parameter whose value one of its own takes."""
        path = self.prefix + name
        return self.problem.ties.get(path, path)

    def _axis(self, term: int) -> str | None:
        """The path of the free shape parameter that a term depends on."""
        names = {self._source(name) for name in self.brdf.structure.terms[term].shape_parameters & self._gridded}
        if len(names) > 1:
            raise ValueError(f"{self.brdf.expression}: one term depends on {' and '.join(sorted(names))}.")
        return next(iter(names), None)

    def _mixes(self, term: int) -> bool:
        """Whether a term is a mixture, by weights that depend on the node, of columns that do not."""
        return self._axis(term) is not None and not (self.brdf.structure.terms[term].column_parameters & self._gridded)

    def _columns(self, term: int) -> int:
        return self.brdf.structure.terms[term].columns

    def _nodes(self, term: int) -> int:
        axis = self._axis(term)
        return 1 if axis is None else len(self.grid[axis])

    def _weights(self, term: int) -> Tensor:
        """Weights of the columns of a mixture at every node [S, 1 or C, Q]."""
        values = {name: value[:, None] if name in self._gridded else value for name, value in self._values.items()}
        normal = torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64)
        weights = self.brdf.replace(values).terms(Directions(normal, normal))[term].weights
        assert weights is not None
        return weights


def _components(problem: Problem, grid: Grid) -> Iterator[_Component]:
    if isinstance(problem.brdf, Sum):
        for part in problem.brdf.components:
            yield _Component(part, f"{part.name}.", problem, grid)
    else:
        yield _Component(problem.brdf, "", problem, grid)
