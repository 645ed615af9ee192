"""Global search of the shape parameters, one to three numbers: the amplitudes are solved for at every node."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from matest.brdf.terms import Product
from matest.estimators.basis import NodesBasis, TangentBasis, mixture
from matest.estimators.column_statistics import ColumnStatistics
from matest.estimators.linear import amplitudes
from matest.estimators.moments import moments, sum_moments
from matest.estimators.passes import compress
from matest.estimators.unknowns import Problem
from matest.samples import Batch, Tile
from matest.samples.likelihood import LeastSquares, Means
from matest.samples.tiles import in_memory

# Nodes per shape parameter: close enough for the descent from a node to reach the optimum beside it.
_NODES = 15
# Nodes of the whole grid: several shape parameters get fewer each, or the search would cost more than the fit.
_MAX_NODES = 400
# Samples × lights × nodes that a model is evaluated at together: enough for torch to be busy, and in the cache.
_EVALUATED_TOGETHER = 1 << 16
# Share of the upper end at which a logarithmic grid starts: lobes narrower than that fall between samples.
_LOG_START = 0.01
# Shares of the domain between which an even grid lies: the far end of an angle (90°) is no surface.
_GRID_START = 0.02
_GRID_END = 0.8
# Share of the upper end at which a logarithmic grid ends.
_LOG_END = 0.95
# Facet albedos of the brightest channel that are tried where the light scale is unknown: they set the ρ² terms.
_BRIGHTEST_ALBEDOS = (0.2, 0.6, 0.95)


@dataclass(frozen=True)
class Search:
    """Amplitudes and cost at every node of a grid over the shape parameters.

    Attributes:
        problem: what is estimated; the limit of its gauge follows from the samples.
        nodes: values of each shape parameter.
        solved: amplitudes [G, C, A] at every combination of nodes.
        gauges: value [G, 1] of each gauge parameter there.
        cost: weighted sum of squares up to a constant [G].
    """

    problem: Problem
    nodes: list[list[float]]
    solved: Tensor
    gauges: dict[str, Tensor]
    cost: Tensor

    def starts(self, count: int = 3) -> list[Tensor]:
        """The best local minima as vectors of unknowns, best first."""
        combinations = list(itertools.product(*self.nodes))
        minima = _minima(self.cost.reshape([len(node) for node in self.nodes] or [1]), count)
        return [self.unknowns_at(node, combinations[node]) for node in minima]

    def unknowns_at(self, node: int, shapes: tuple[float, ...]) -> Tensor:
        """u [P] at a node with these shape parameters."""
        problem = self.problem
        unknowns = _with_shapes(problem, shapes)
        names = [name for name in problem.amplitudes if name not in self.gauges]
        for column, name in enumerate(names):
            values = self.solved[node, :, column]
            unknowns[problem.where[name]] = values if problem.count(name) > 1 else values.mean()
        for name, value in self.gauges.items():
            unknowns[problem.where[name]] = value[node]
        return unknowns


def search(problem: Problem, batches: list[Batch], compressed: ColumnStatistics | None = None) -> Search:
    """Evaluate the grid; every node's amplitudes are the bounded least-squares solution there.

    Weights are those of a first guess (`likelihood.first_guess`).

    Args:
        problem: what is estimated.
        batches: the samples.
        compressed: column statistics of the samples, where the problem separates; None: a pass over them.
    """
    count = min(_NODES, int(_MAX_NODES ** (1 / max(len(problem.shapes), 1))))
    nodes = [_grid(problem, name, count) for name in problem.shapes]
    points = [_with_shapes(problem, combination) for combination in itertools.product(*nodes)]
    if compressed is None:
        factors, gram, moment = normal_equations(problem, batches, points)
    else:
        factors, gram, moment = _from_column_statistics(problem, compressed, points)

    trials: list[dict[str, Tensor]] = [{}]
    if problem.gauges:
        no_gauge = {name: torch.zeros(len(gram), 1, dtype=torch.float64) for name in problem.gauges}
        solved, cost = amplitudes(problem, factors, gram, moment, no_gauge)
        brightest = float(solved[cost.argmin()].max().clamp(min=1e-9))
        problem = problem.limited(1 / brightest)
        trials = [{name: no_gauge[name] + share / brightest for name in no_gauge} for share in _BRIGHTEST_ALBEDOS]
    results = [(*amplitudes(problem, factors, gram, moment, trial), trial) for trial in trials]
    best = torch.stack([cost for _, cost, _ in results]).argmin(0)
    pick = torch.arange(len(gram))
    return Search(
        problem=problem,
        nodes=nodes,
        solved=torch.stack([solved for solved, _, _ in results])[best, pick],
        gauges={name: torch.stack([trial[name] for trial in trials])[best, pick] for name in problem.gauges},
        cost=torch.stack([cost for _, cost, _ in results])[best, pick],
    )


Normal = tuple[list[Product], Tensor, Tensor]


def normal_equations(
    problem: Problem, batches: list[Batch], points: list[Tensor], reference: Tensor | None = None
) -> Normal:
    """Factors of the T terms, their Gram matrices [G, C, T, T] and moments [G, C, T] at every point u [P].

    The likelihood is expanded about the model's radiance for `reference` u [P]; None: for a first guess.
    """
    if problem.separates:
        return _from_column_statistics(problem, compress(problem, in_memory(batches), None, reference), points)
    return _from_samples(problem, batches, points, reference)


@torch.no_grad()
def _from_samples(problem: Problem, batches: list[Batch], points: list[Tensor], reference: Tensor | None) -> Normal:
    tiles = [Tile(batch) for batch in batches]
    if reference is None:
        problems = [tile.first_guess() for tile in tiles]
    else:
        about = TangentBasis(problem, reference, derivatives=False)
        problems = [tile.about(about.radiance(tile.batch)) for tile in tiles]
    parts = []
    for tile, least_squares in zip(tiles, problems, strict=True):
        samples, lights = len(tile), tile.batch.points.wi.shape[-2]
        together = max(_EVALUATED_TOGETHER // max(samples * lights, 1), 1)
        for first in range(0, len(points), together):
            nodes = points[first : first + together]
            columns = NodesBasis(problem, nodes).columns(tile, cut=False)
            repeated = _repeated(least_squares, len(nodes))
            labels = torch.arange(first, first + len(nodes)).repeat_interleave(samples)
            parts.append(moments(columns, repeated, repeated.response, labels))
    total = sum_moments(parts)
    return TangentBasis(problem, points[0], derivatives=False).factors, total.gram, total.moment


def _repeated(least_squares: LeastSquares, times: int) -> LeastSquares:
    """The problem of as many copies of the samples."""
    response, weight, plain = (part.repeat(times, 1) for part in least_squares[:3])
    means = None if least_squares.means is None else Means(*(part.repeat(times, 1) for part in least_squares.means))
    return LeastSquares(response, weight, plain, means)


def _from_column_statistics(problem: Problem, compressed: ColumnStatistics, points: list[Tensor]) -> Normal:
    """Factors, Gram matrices and moments at every point, from one set of moments of all columns."""
    gram, moment = (part.sum(0) for part in (compressed.moments.gram, compressed.moments.moment))
    factors, weights = mixture(problem, points)
    # Columns to terms, [G, C, K, T].
    mixed = gram.new_zeros(len(points), *gram.shape[:2], len(weights))
    start = 0
    for term, of_columns in enumerate(weights):
        end = start + of_columns.shape[-1]
        mixed[:, :, start:end, term] = of_columns
        start = end
    return factors, mixed.mT @ gram @ mixed, (mixed.mT @ moment[..., None])[..., 0]


def _grid(problem: Problem, name: str, count: int) -> list[float]:
    domain = problem.domain(name)
    if problem.declared(name).periodic:
        period = problem.declared(name).domain
        return [period.lower + period.width * node / count for node in range(count)]
    if problem.declared(name).log:
        low = max(domain.lower, _LOG_START * domain.upper)
        return torch.logspace(math.log10(low), math.log10(_LOG_END * domain.upper), count).tolist()
    start, end = (domain.lower + share * domain.width for share in (_GRID_START, _GRID_END))
    return torch.linspace(start, end, count).tolist()


def _with_shapes(problem: Problem, shapes: tuple[float, ...]) -> Tensor:
    unknowns = problem.anywhere.clone()
    for name, value in zip(problem.shapes, shapes, strict=True):
        unknowns[problem.where[name]] = value
    return unknowns


def _minima(cost: Tensor, count: int) -> list[int]:
    """Flat indices of the lowest local minima of a grid, lowest first."""
    padded = np.pad(cost.numpy(), 1, constant_values=np.inf)
    neighbours = [padded[tuple(slice(k, k + n) for k, n in zip(shift, cost.shape, strict=True))]
                  for shift in itertools.product(range(3), repeat=cost.ndim)]  # fmt: skip
    lowest = np.flatnonzero((cost.numpy() <= np.min(neighbours, axis=0)).ravel())
    return lowest[np.argsort(cost.numpy().ravel()[lowest], kind="stable")][:count].tolist()
