"""The one evaluator of samples: a model near some unknowns as a weighted sum of columns.

Three bases serve three questions. `TangentBasis` has the terms of the model at some unknowns, and their derivatives.
`SeparatedBasis` has columns that no unknown touches, for models whose every term is Σq weights_q(parameters) ·
columns_q(directions): they are evaluated once, whatever the number of parameter values that are tried. `NodesBasis` has
the terms at many unknowns, for a search.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from matest.brdf import Brdf, Term
from matest.brdf.terms import Product
from matest.directions import Directions
from matest.estimators.columns import Columns, light_columns
from matest.estimators.unknowns import Problem
from matest.samples import Batch, Tile
from matest.scene import Points
from matest.scene.points import lit_pairs
from matest.shading import check_sky, lit_directions, sky_nodes, sky_terms


class Basis:
    """Columns of a problem, and their weights at some unknowns u [P].

    What does not depend on the tile is computed once.

    Attributes:
        coefficients: of the K columns in the radiance [C, K].
        slopes: of the K columns in the derivatives by each of the Q free parameters of a channel [C, K, Q].
        multiplier: of the radiance of each group; None: 1 throughout.
    """

    coefficients: Tensor
    slopes: Tensor

    def __init__(self, problem: Problem, unknowns: Tensor | None) -> None:
        self._problem = problem
        self._sky: list[Tensor] = []
        self.multiplier = None if unknowns is None else problem.multiplied(unknowns)

    def columns(self, tile: Tile, *, cut: bool = True) -> Columns:
        """The K columns; with `cut`, light whose reflectance at these unknowns is below zero gives nothing."""
        points, like = tile.batch.points, tile.batch.radiance
        pairs = lit_pairs(points) if points.ambient is None else None
        points = points if pairs is None else pairs.points
        shapes = self._lit_shapes(tile, points)
        columns = light_columns(
            points, shapes, lambda: self._over_sky(like), self.coefficients if cut else None, like.shape[-1]
        )
        return columns if pairs is None else columns.of_points(pairs)

    def radiance(self, batch: Batch) -> Tensor:
        """Model radiance [n, C]."""
        return self.radiance_of(self.columns(Tile(batch)), batch)

    def radiance_of(self, columns: Columns, batch: Batch) -> Tensor:
        """Model radiance [n, C] of a batch whose columns are known."""
        radiance = columns.radiance(self.coefficients)
        if self.multiplier is None:
            return radiance
        return radiance * self.multiplier.value[self._problem.groups.group_of(batch)].to(radiance)[:, None]

    def _shapes(self, directions: Directions, lead: torch.Size, like: Tensor) -> list[Tensor]:
        """Each of the K shapes [..., 1 or C] at directions of size `lead`; `like` gives dtype and device."""
        raise NotImplementedError

    def _lit_shapes(self, tile: Tile, points: Points) -> list[Tensor]:
        """The K shapes at every light of the points of a tile [n, L, 1 or C]."""
        return self._shapes(lit_directions(points), _lead(points), tile.batch.radiance)

    def _over_sky(self, like: Tensor) -> list[Tensor]:
        """The K shapes integrated over an even sky [33, 1 or C]."""
        if not self._sky:
            check_sky(self._problem.brdf)
            nodes = sky_nodes(like.dtype, like.device)
            lead = torch.Size((nodes.directions.cos_o.shape[0], nodes.weight.shape[1]))
            shapes = self._shapes(nodes.directions, lead, like)
            self._sky = [term.shape for term in sky_terms(tuple(Term((), shape) for shape in shapes))]
        return self._sky


def _lead(points: Points) -> torch.Size:
    # NumPy's function: torch's would import sympy.
    return torch.Size(
        np.broadcast_shapes(points.wi.shape[:-1], (*points.wo.shape[:-1], 1), points.irradiance.shape[:-1])
    )


class TangentBasis(Basis):
    """The terms of a model at some unknowns, at unit amplitude, and where asked for their derivatives.

    Columns are the shape of each term, then its derivatives by the shape parameters that it depends on.

    Attributes:
        factors: names multiplying each term.
        derivatives: shape parameter and number of the term of each further column.
        column_factors: names multiplying the term that each column belongs to.
    """

    def __init__(self, problem: Problem, unknowns: Tensor, *, derivatives: bool = True) -> None:
        super().__init__(problem, unknowns)
        self._values = problem.values(unknowns)
        self._leaves = problem.shapes if derivatives else ()
        # A value per channel of anything but a factor makes every shape per channel.
        self._width = max((self._values[name].numel() for name in problem.shaping), default=1)
        normal = torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64)
        terms, by_name = self._terms(Directions(normal, normal), torch.Size([1]), normal)
        self.factors = [term.factors for term in terms]
        # Those that are not zero.
        self.derivatives = [
            (name, k) for name, parts in by_name.items() for k, part in enumerate(parts) if part is not None
        ]
        amplitudes = torch.stack([product(self._values, factors).expand(problem.channels) for factors in self.factors])
        self.column_factors = [*self.factors, *(self.factors[k] for _, k in self.derivatives)]
        no_radiance = amplitudes.new_zeros(len(self.derivatives), problem.channels)
        self.coefficients = torch.cat([amplitudes, no_radiance]).T
        self.slopes = self.coefficients.new_zeros(*self.coefficients.shape, 0)
        if derivatives and problem.free:
            self.slopes = torch.stack([self._slope(name, amplitudes) for name in problem.free], dim=-1)

    def _slope(self, name: str, amplitudes: Tensor) -> Tensor:
        """Coefficients [C, K] of the derivative by a parameter."""
        problem = self._problem
        if name in problem.shapes:
            by_shape = [amplitudes[k] * (shape == name) for shape, k in self.derivatives]
            return torch.stack([*torch.zeros_like(amplitudes), *by_shape], dim=-1)
        by_factor = [derivative(self._values, problem.ties, factors, name) for factors in self.factors]
        rows = [torch.as_tensor(d).to(amplitudes).expand(problem.channels) for d in by_factor]
        return torch.stack([*rows, *amplitudes.new_zeros(len(self.derivatives), problem.channels)], dim=-1)

    def _shapes(self, directions: Directions, lead: torch.Size, like: Tensor) -> list[Tensor]:
        terms, slopes = self._terms(directions, lead, like)
        derivatives = [slopes[name][k] for name, k in self.derivatives]
        shapes = [*(term.shape for term in terms), *(slope for slope in derivatives if slope is not None)]
        # A derivative has the size of its own copy of the parameter; a shape may be smaller.
        return [shape.expand(*lead, shape.shape[-1]) for shape in shapes]

    def _terms(
        self, directions: Directions, lead: torch.Size, like: Tensor
    ) -> tuple[tuple[Term, ...], dict[str, list[Tensor | None]]]:
        """Terms and the derivative of every shape by every shape parameter, sample by sample; None where it is 0.

        Each sample gets its own copy of the parameters, so one reverse pass per term yields the whole Jacobian:
        samples do not mix.
        """
        problem = self._problem
        values = {name: value.to(like.device, like.dtype) for name, value in self._values.items()}
        leaves = {
            name: values[name].expand(*lead, self._width).clone().requires_grad_() for name in self._leaves
        }  # fmt: skip
        values |= leaves
        values |= {name: leaves[source] for name, source in problem.ties.items() if source in leaves}
        with torch.set_grad_enabled(bool(leaves)):
            terms = problem.brdf.replace(values).terms(directions)
            slopes: dict[str, list[Tensor | None]] = {name: [] for name in leaves}
            for term in terms if leaves else ():
                by_leaf: tuple[Tensor | None, ...] = (None,) * len(leaves)
                if term.shape.requires_grad:
                    by_leaf = torch.autograd.grad(
                        term.shape.sum(), list(leaves.values()), retain_graph=True, allow_unused=True
                    )
                for name, slope in zip(leaves, by_leaf, strict=True):
                    slopes[name].append(slope)
        return tuple(Term(term.factors, term.shape.detach()) for term in terms), slopes


@dataclass(frozen=True)
class Coefficients:
    """The weights of all columns of a model that separates, at some unknowns.

    Attributes:
        total: of the K columns of all terms, one after another, in the radiance [C, K].
        slopes: their derivatives by every free parameter of a channel [C, K, Q].
    """

    total: Tensor
    slopes: Tensor


class _CachedShapes(NamedTuple):
    """Shapes, and the model and its held values that they belong to."""

    brdf: Brdf
    held: Mapping[str, Tensor]
    shapes: list[Tensor]


class SeparatedBasis(Basis):
    """The columns of a model whose terms all separate into columns of the directions and weights of the parameters.

    Args:
        problem: one that `separates`.
        unknowns: u [P] that `coefficients` and `slopes` are for; None: coefficients of zero.
    """

    def __init__(self, problem: Problem, unknowns: Tensor | None) -> None:
        super().__init__(problem, unknowns)
        anywhere = problem.anywhere
        # The columns do not depend on these values.
        self._values = problem.values(anywhere)
        weights = coefficients(problem, anywhere if unknowns is None else unknowns)
        self.coefficients = torch.zeros_like(weights.total) if unknowns is None else weights.total
        self.slopes = weights.slopes

    def _shapes(self, directions: Directions, lead: torch.Size, like: Tensor) -> list[Tensor]:  # noqa: ARG002
        values = {name: value.to(like.device, like.dtype) for name, value in self._values.items()}
        shapes: list[Tensor] = []
        for term in self._problem.brdf.replace(values).terms(directions):
            shapes += [term.shape] if term.columns is None else term.columns.split(1, dim=-1)
        return shapes

    def _lit_shapes(self, tile: Tile, points: Points) -> list[Tensor]:
        """All shapes at every light, cached for the next pass where the samples stay in memory."""
        cached = (tile.cache or {}).get("shapes")
        if cached is not None and cached.brdf is self._problem.brdf and cached.held is self._problem.held:
            return cached.shapes
        shapes = super()._lit_shapes(tile, points)
        if tile.cache is not None:
            tile.cache["shapes"] = _CachedShapes(self._problem.brdf, self._problem.held, shapes)
        return shapes


class NodesBasis(Basis):
    """The terms of a model at S unknowns u [P]; the columns of a tile are those of S copies of its samples in a row."""

    def __init__(self, problem: Problem, points: Sequence[Tensor]) -> None:
        super().__init__(problem, None)
        node_values = [problem.values(unknowns) for unknowns in points]
        self._values = dict(node_values[0])
        for name in problem.shaping:
            if problem.ties.get(name, name) in problem.shapes:
                # One value, or one a channel.
                self._values[name] = torch.stack([values[name].reshape(1, 1, -1) for values in node_values])
        self._count = len(points)

    def _shapes(self, directions: Directions, lead: torch.Size, like: Tensor) -> list[Tensor]:
        values = {name: value.to(like.device, like.dtype) for name, value in self._values.items()}
        shapes = [term.shape for term in self._problem.brdf.replace(values).terms(directions)]
        return [shape.expand(self._count, *lead, shape.shape[-1]) for shape in shapes]


@torch.enable_grad()
def coefficients(problem: Problem, unknowns: Tensor) -> Coefficients:
    """The coefficients and their derivatives at `unknowns` u [P], of a problem that `separates`."""
    values = problem.values(unknowns)
    sizes = problem.brdf.structure.columns
    # Each column has its own copy of the shape parameters: one reverse pass a term yields all derivatives.
    terms, leaves = _probe(problem, [unknowns] * max(sizes))
    totals = []
    slopes: dict[str, list[Tensor]] = {name: [] for name in problem.free}
    for term, size in zip(terms, sizes, strict=True):
        weights = torch.ones(1, 1, dtype=torch.float64) if term.weights is None else term.weights
        weights = weights[:size].diagonal(dim1=0, dim2=2) if weights.ndim == 3 else weights
        by_leaf: dict[str, Tensor | None] = dict.fromkeys(leaves)
        if weights.requires_grad:
            grads = torch.autograd.grad(weights.sum(), list(leaves.values()), retain_graph=True, allow_unused=True)
            by_leaf = dict(zip(leaves, grads, strict=True))
        weights = weights.detach().expand(problem.channels, size)
        amplitude = product(values, term.factors).expand(problem.channels)[:, None]
        totals.append(amplitude * weights)
        for name in problem.free:
            if name not in leaves:
                by_amplitude = torch.as_tensor(derivative(values, problem.ties, term.factors, name)).to(weights)
                slopes[name].append(by_amplitude.expand(problem.channels)[:, None] * weights)
            elif (by_shape := by_leaf[name]) is None:
                slopes[name].append(torch.zeros_like(weights))
            else:
                slopes[name].append(amplitude * by_shape[:size].T)
    total = torch.cat(totals, dim=-1)
    stacked = [torch.cat(columns, dim=-1) for columns in slopes.values()]
    return Coefficients(total, torch.stack(stacked, dim=-1) if stacked else total.new_zeros(*total.shape, 0))


def mixture(problem: Problem, points: Sequence[Tensor]) -> tuple[list[Product], list[Tensor]]:
    """The factors of each term, and the weights [S, C, Q] of its columns at unit amplitude at S unknowns u [P]."""
    terms, _ = _probe(problem, points)
    out = []
    for term, size in zip(terms, problem.brdf.structure.columns, strict=True):
        weights = torch.ones(1, 1, dtype=torch.float64) if term.weights is None else term.weights
        out.append(weights.detach().expand(len(points), problem.channels, size))
    return [term.factors for term in terms], out


def _probe(problem: Problem, points: Sequence[Tensor]) -> tuple[tuple[Term, ...], dict[str, Tensor]]:
    """The terms at one pair of directions, with the estimated shape parameters at S unknowns u [P] as leaves [S, …]."""
    values = problem.values(points[0])
    width = max((problem.count(name) for name in problem.shapes), default=1)
    stacked = torch.stack([*points])
    leaves = {
        name: stacked[:, problem.where[name]].expand(-1, width).clone().requires_grad_() for name in problem.shapes
    }
    values |= leaves
    values |= {name: leaves[source] for name, source in problem.ties.items() if source in leaves}
    normal = torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64)
    with torch.enable_grad():
        return problem.brdf.replace(values).terms(Directions(normal, normal)), leaves


def product(values: Mapping[str, Tensor], factors: Product) -> Tensor:
    """The product of some factors."""
    out = torch.ones_like(next(iter(values.values())))
    for factor in factors:
        out = out * factor.value(values)
    return out


def derivative(values: Mapping[str, Tensor], ties: Mapping[str, str], factors: Product, name: str) -> Tensor | float:
    """Derivative of a product of factors by a parameter (and by those tied to it)."""
    total: Tensor | float = 0.0
    for position, factor in enumerate(factors):
        if name in (factor.name, ties.get(factor.name)):
            total = total + factor.slope * product(values, factors[:position] + factors[position + 1 :])
    return total
