"""The best free mixture of the columns of several models: what no model among them could explain better."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.optimize import nnls
from torch import Tensor

from matest.estimators.dictionary import Dictionary
from matest.estimators.moments import SCORES, Moments, moments
from matest.estimators.one_step import expand_about
from matest.estimators.search import Search, shape_nodes, solve_nodes
from matest.estimators.unknowns import Problem
from matest.samples import Tile
from matest.samples.likelihood import LeastSquares
from matest.samples.residual_scale import ResidualScale

# Nodes of every shape parameter: close enough for the descent from a node to reach the optimum beside it.
_NODES = 12
# Times that a mixture is fitted again with less weight for outliers.
_MAX_ROUNDS = 3
# Share of outliers above which it is: with fewer they cannot have misled it.
_OUTLIER_SHARE = 0.001
# Share of the brightest column's square: darker columns are rounding.
_DARK = 1e-12
# Share of the largest eigenvalue of a Gram matrix of columns of single precision: less than this is rounding.
_SINGULAR = 1e-6


class Field:
    """Several problems at the nodes of their shape parameters, for the same samples.

    Args:
        problems: every term of each depends on one shape parameter at most.
        tile: the samples.
        squares: the least-squares problem that weighs them; None: that of a first guess.
    """

    def __init__(self, problems: Sequence[Problem], tile: Tile, squares: LeastSquares | None = None) -> None:
        self.problems = problems
        self._grids = [_grid(problem) for problem in problems]
        self._dictionary = Dictionary([*zip(problems, self._grids, strict=True)])
        self._columns = self._dictionary.columns(tile)
        self._sums = self._weighed(squares or tile.first_guess())

    def search(self, member: int) -> Search:
        """The amplitudes of one of the problems at every combination of its nodes."""
        normal = self._dictionary.normal_equations(member, self._sums.gram[0], self._sums.moment[0])
        return solve_nodes(self.problems[member], [*self._grids[member].values()], normal)

    def cost(self, search: Search) -> float:
        """rᵀWr at the best node."""
        return float(self._sums.scores[0, 0]) + float(search.cost.min())

    def mixture(self, tile: Tile) -> Mixture:
        """The best mixture of all columns; the sums stay weighed for a first guess unless many values are outliers."""
        mixture, outliers = self._mixture(tile)
        for _ in range(_MAX_ROUNDS):
            if outliers <= _OUTLIER_SHARE:
                break
            self._sums = self._weighed(mixture.squares)
            mixture, outliers = self._mixture(tile)
        return mixture

    def costs_left_out(self, mixture: Mixture) -> Tensor:
        """The error rᵀWr of a mixture of the columns at each part [B] when that is left out of its fit.

        Only columns with a weight in the mixture of all parts are mixed. The labels of the groups of its samples are
        the parts.
        """
        squares = mixture.squares
        mixed = (mixture.weights > 0).any(0).nonzero()[:, 0]
        columns = replace(self._columns, values=self._columns.values[:, mixed])
        sums = moments(columns, squares, squares.response, mixture.tile.batch.groups)
        gram, moment = sums.gram.sum(0), sums.moment.sum(0)
        costs = torch.zeros(len(sums.labels), dtype=torch.float64)
        for row, (part_gram, part_moment) in enumerate(zip(sums.gram, sums.moment, strict=True)):
            weights = non_negative(gram - part_gram, moment - part_moment)
            rise = (part_gram @ weights[..., None])[..., 0] - 2 * part_moment
            costs[row] = sums.scores[row, SCORES.index("cost")] + (weights * rise).sum()
        return costs

    def _mixture(self, tile: Tile) -> tuple[Mixture, float]:
        """The best mixture for the present weights, and the share of outliers about it."""
        weights = non_negative(self._sums.gram[0], self._sums.moment[0])
        radiance = self._columns.radiance(weights)
        residual_scale, (expanded,) = expand_about([radiance], [tile])
        squares = expanded.least_squares
        assert squares is not None
        outliers = float((squares.plain & (squares.weight == 0)).double().mean())
        cost = float((squares.weight * (squares.response - radiance).square()).sum())
        values = int((squares.weight > 0).sum())
        return Mixture(expanded, squares, residual_scale, cost, values, weights), outliers

    def _weighed(self, squares: LeastSquares) -> Moments:
        return moments(self._columns, squares, squares.response, None)


def _grid(problem: Problem) -> dict[str, list[float]]:
    """The nodes of the shape parameters of a problem.

    What is estimated on request alone (`f0`) stays where it is held otherwise: few samples show more of it.
    """
    held = {name: problem.declared(name).held for name in problem.shapes}
    nodes = shape_nodes(problem, _NODES)
    return {name: nodes[name] if value is None else [value] for name, value in held.items()}


@dataclass(frozen=True, eq=False)
class Mixture:
    """The best mixture, with no weight below zero, of the columns of some problems.

    Attributes:
        tile: the samples, their likelihood expanded about the mixture.
        squares: that expansion.
        residual_scale: typical residual there in standard deviations of the noise.
        cost: rᵀWr there.
        values: number of values of some weight.
        weights: of the columns [C, K].
    """

    tile: Tile
    squares: LeastSquares
    residual_scale: ResidualScale
    cost: float
    values: int
    weights: Tensor


def non_negative(gram: Tensor, moment: Tensor) -> Tensor:
    """The weights [C, K], none below zero, that minimise the cost of all columns.

    Args:
        gram: of the columns [C, K, K].
        moment: of the columns [C, K].
    """
    squares = gram.diagonal(dim1=-2, dim2=-1)
    # A column without light gets no weight.
    scale = torch.where(squares > _DARK * squares.amax(-1, keepdim=True), squares.rsqrt(), 0.0)
    eigenvalues, vectors = torch.linalg.eigh(gram * scale[:, :, None] * scale[:, None, :])
    channels = zip(eigenvalues.numpy(), vectors.numpy(), (moment * scale).numpy(), strict=True)
    return torch.from_numpy(np.stack([_non_negative(*channel) for channel in channels])) * scale


def _non_negative(eigenvalues: np.ndarray, vectors: np.ndarray, moment: np.ndarray) -> np.ndarray:
    """The same for a Gram matrix of diagonal 1 from its eigenvalues and eigenvectors."""
    # Directions of smaller eigenvalues have been made up by the rounding of the matrix.
    real = eigenvalues > _SINGULAR * eigenvalues[-1]
    roots, vectors = np.sqrt(eigenvalues[real]), vectors[:, real]
    try:
        weights, _ = nnls(roots[:, None] * vectors.T, vectors.T @ moment / roots)
    except RuntimeError:
        # It went round in circles: take the best weights of any sign, and leave out those below zero.
        weights = ((vectors / roots**2) @ (vectors.T @ moment)).clip(min=0)
    return weights
