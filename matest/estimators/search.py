"""Global search of the shape parameters: amplitudes are eliminated, what is left is one to three numbers."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from matest.brdf.terms import Product
from matest.estimators.basis import NodesBasis, TangentBasis, mixture
from matest.estimators.compressed import Compressed
from matest.estimators.linear import amplitudes
from matest.estimators.moments import joined, moments
from matest.estimators.passes import compress
from matest.estimators.unknowns import Problem
from matest.samples import Batch, Tile
from matest.samples.likelihood import LeastSquares, Means
from matest.samples.tiles import in_memory

# Nodes per shape parameter, at most so many in all.
_NODES, _ALL_NODES = 15, 400
# Samples and lights, times nodes, that a model is evaluated at together.
_AT_ONCE = 1 << 16
# A logarithmic grid starts here, as a share of the upper end.
_LOG_START = 0.01
# Strengths of the ρ² term tried when the light scale is unknown: facet albedo of the brightest channel.
_BRIGHTEST = (0.2, 0.6, 0.95)


@dataclass(frozen=True)
class Search:
    """Amplitudes and cost at every node of a grid over the shape parameters.

    Attributes:
        problem: what is estimated; its gauge limit follows from the images.
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
        chosen = _minima(self.cost.reshape([len(node) for node in self.nodes] or [1]), count)
        return [self._fill(node, combinations[node]) for node in chosen]

    def _fill(self, node: int, shapes: tuple[float, ...]) -> Tensor:
        problem = self.problem
        unknowns = _with_shapes(problem, shapes)
        names = [name for name in problem.amplitudes if name not in self.gauges]
        for column, name in enumerate(names):
            values = self.solved[node, :, column]
            unknowns[problem.where[name]] = values if problem.count(name) > 1 else values.mean()
        for name, value in self.gauges.items():
            unknowns[problem.where[name]] = value[node]
        return unknowns


def search(problem: Problem, batches: list[Batch], compressed: Compressed | None = None) -> Search:
    """Evaluate the grid; every node's amplitudes are the bounded least-squares solution there.

    Weights are those of a first guess (`likelihood.first_guess`).

    Args:
        problem: what is estimated.
        batches: the samples.
        compressed: of them, where the problem separates and this is known already.
    """
    count = min(_NODES, int(_ALL_NODES ** (1 / max(len(problem.shapes), 1))))
    nodes = [_grid(problem, name, count) for name in problem.shapes]
    points = [_with_shapes(problem, combination) for combination in itertools.product(*nodes)]
    if compressed is None:
        factors, gram, moment = normal_equations(problem, batches, points)
    else:
        factors, gram, moment = _mixed(problem, compressed, points)

    trials: list[dict[str, Tensor]] = [{}]
    if problem.gauges:
        none = {name: torch.zeros(len(gram), 1, dtype=torch.float64) for name in problem.gauges}
        solved, cost = amplitudes(problem, factors, gram, moment, none)
        brightest = float(solved[cost.argmin()].max().clamp(min=1e-9))
        problem = problem.limited(1 / brightest)
        trials = [{name: none[name] + share / brightest for name in none} for share in _BRIGHTEST]
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
        return _mixed(problem, compress(problem, in_memory(batches), None, reference), points)
    return _evaluated(problem, batches, points, reference)


@torch.no_grad()
def _evaluated(problem: Problem, batches: list[Batch], points: list[Tensor], reference: Tensor | None) -> Normal:
    tiles = [Tile(batch) for batch in batches]
    if reference is None:
        views = [tile.first_guess() for tile in tiles]
    else:
        about = TangentBasis(problem, reference, derivatives=False)
        views = [tile.about(about.radiance(tile.batch)) for tile in tiles]
    parts = []
    for tile, view in zip(tiles, views, strict=True):
        samples, lights = len(tile), tile.batch.points.wi.shape[-2]
        ahead = max(_AT_ONCE // max(samples * lights, 1), 1)
        for first in range(0, len(points), ahead):
            nodes = points[first : first + ahead]
            columns = NodesBasis(problem, nodes).columns(tile, cut=False)
            repeated = _repeated(view, len(nodes))
            labels = torch.arange(first, first + len(nodes)).repeat_interleave(samples)
            parts.append(moments(columns, repeated, repeated.response, labels))
    total = joined(parts)
    return TangentBasis(problem, points[0], derivatives=False).factors, total.gram, total.moment


def _repeated(view: LeastSquares, times: int) -> LeastSquares:
    """The same samples so many times."""
    response, weight, plain = (part.repeat(times, 1) for part in view[:3])
    means = None if view.means is None else Means(*(part.repeat(times, 1) for part in view.means))
    return LeastSquares(response, weight, plain, means)


def _mixed(problem: Problem, compressed: Compressed, points: list[Tensor]) -> Normal:
    """From the moments of the images."""
    gram, moment = (part.sum(0) for part in (compressed.moments.gram, compressed.moments.moment))
    factors: list[Product] = []
    mixtures = []
    for unknowns in points:
        factors, weights = mixture(problem, unknowns)
        # Columns to terms, [C, K, T].
        mixtures.append(torch.stack([torch.block_diag(*rows).T for rows in zip(*weights, strict=True)]))
    mixed = torch.stack(mixtures)
    return factors, mixed.mT @ gram @ mixed, (mixed.mT @ moment[..., None])[..., 0]


def _grid(problem: Problem, name: str, count: int) -> list[float]:
    domain = problem.domain(name)
    if problem.declared(name).periodic:
        own = problem.declared(name).domain
        return [own.lower + own.width * node / count for node in range(count)]
    if problem.declared(name).log:
        low = max(domain.lower, _LOG_START * domain.upper)
        return torch.logspace(math.log10(low), math.log10(0.95 * domain.upper), count).tolist()
    # From the lower end up: the far end of an angle (90°) is no surface.
    return torch.linspace(domain.lower + 0.02 * domain.width, domain.lower + 0.8 * domain.width, count).tolist()


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
