"""Unknowns of texels: parameters of which every texel has values of its own, beside those in common."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from matest.estimators.unknowns import Problem


@dataclass(frozen=True)
class Row:
    """One unknown.

    Attributes:
        name: of the parameter.
        channel: that it belongs to; None: to all.
        place: in u.
    """

    name: str
    channel: int | None
    place: int


@dataclass(frozen=True, eq=False)
class TexelUnknowns:
    """The unknowns of a problem of which every texel has its own, θ [T, n], and those in common, u [P].

    The places of θ in u are unused.

    Attributes:
        problem: what is estimated.
        mapped: names of the parameters of texels.
    """

    problem: Problem
    mapped: tuple[str, ...]

    @cached_property
    def rows(self) -> list[Row]:
        """Those of θ, in its order."""
        return [row for name in self.mapped for row in self._rows(name)]

    @cached_property
    def common(self) -> list[Row]:
        """The S unknowns of the model in common."""
        return [row for name in self.problem.free if name not in self.mapped for row in self._rows(name)]

    def _rows(self, name: str) -> list[Row]:
        place, count = self.problem.where[name], self.problem.count(name)
        return [Row(name, k if count > 1 else None, place.start + k) for k in range(count)]

    @cached_property
    def shapes(self) -> tuple[str, ...]:
        """Those of texels that shape the reflectance."""
        return tuple(name for name in self.mapped if name in self.problem.shapes)

    @cached_property
    def is_shape(self) -> Tensor:
        """Which unknowns of θ shape the reflectance [T]."""
        return torch.tensor([row.name in self.shapes for row in self.rows])

    @cached_property
    def places(self) -> Tensor:
        """Of θ in u [T]."""
        return torch.tensor([row.place for row in self.rows], dtype=torch.int64)

    @cached_property
    def common_places(self) -> Tensor:
        """Of the unknowns in common in u [S]."""
        return torch.tensor([row.place for row in self.common], dtype=torch.int64)

    @cached_property
    def lower(self) -> Tensor:
        """Of θ [T, 1]."""
        return self.problem.lower[self.places, None]

    @cached_property
    def upper(self) -> Tensor:
        """Of θ [T, 1]."""
        return self.problem.upper[self.places, None]

    def without_shapes(self) -> TexelUnknowns:
        """The same with one value for all texels of what shapes the reflectance."""
        return TexelUnknowns(self.problem, tuple(name for name in self.mapped if name not in self.shapes))

    def at(self, name: str) -> slice:
        """The rows of a mapped parameter in θ."""
        numbers = [k for k, row in enumerate(self.rows) if row.name == name]
        return slice(numbers[0], numbers[-1] + 1)

    def width(self, values: Tensor) -> Tensor:
        """How far θ may reasonably lie apart [T, 1]: the domain, or ten times some values in common [T, 1]."""
        span = self.upper - self.lower
        return torch.where(span.isfinite(), span, 10 * values.abs().clamp(min=1e-3))

    def spread(self, unknowns: Tensor, texels: int) -> Tensor:
        """θ [T, n] with the values in common."""
        return unknowns[self.places, None].repeat(1, texels)

    def values(self, unknowns: Tensor, theta: Tensor) -> dict[str, Tensor]:
        """The value of every parameter, [1 or C, n] of texels, [1 or C, 1] of others."""
        values = {name: value.reshape(-1, 1).to(theta) for name, value in self.problem.values(unknowns).items()}
        values |= {name: theta[self.at(name)] for name in self.mapped}
        return values | {name: values[source] for name, source in self.problem.ties.items()}
