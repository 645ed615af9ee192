"""The unknowns of the texels of a tile: a global search of shapes, and a descent from the best node of every texel."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from torch import Tensor

from matest.estimators.columns import Columns
from matest.estimators.search import shape_nodes
from matest.estimators.texels.models import ShadedTexels, TexelModel, radiance, texel_model
from matest.estimators.texels.problem import TexelPrior, TexelProblem
from matest.estimators.texels.small_systems import Factored
from matest.estimators.texels.sums import TexelGram, TexelNormal
from matest.estimators.texels.unknowns import Row, TexelUnknowns
from matest.samples.likelihood import LeastSquares
from matest.samples.residual_scale import ResidualScale
from matest.samples.texels import TexelTile

# Nodes of a mapped shape: of one alone, of two, of more.
_NODES = (24, 7, 4)
# Nodes of one that does not vary over decades, at most.
_EVEN_NODES = 7
# Nodes that descents start from, for a texel.
_STARTS = 3
# Gauss-Newton steps where all unknowns are amplitudes: products of two of them need more than one.
_AMPLITUDE_STEPS = 2
# Steps of a descent at most: texels that take more lie in a valley that tells their shape hardly at all.
_STEPS = 10
# Expected fall of the cost of the last step: 0.15 standard errors, of which it leaves a few hundredths.
_END = 0.02
# The same of a descent that another one follows: 0.6 standard errors.
_ROUGH_END = 0.4
# Relative change of an unknown up to which a last step need not be tried.
_SHORT = 0.05
# Damping of the first step, and what it is multiplied by after a failure and after a success.
_DAMPING = 1e-3
_FAILURE = 10.0
_SUCCESS = 0.1
# Added to the diagonal, in units of it, for an unknown that stays where it is.
_STAYS = 1e12


class Trials(NamedTuple):
    """What a search has tried: S nodes of the mapped shapes, the amplitudes being solved for, and ends of descents.

    Attributes:
        theta: θ [S, T, n].
        cost: there [S, n].
    """

    theta: Tensor
    cost: Tensor

    def some(self, places: Tensor) -> Trials:
        """Those of some of the texels."""
        return Trials(self.theta[..., places], self.cost[..., places])


@dataclass(frozen=True, eq=False)
class TileFit:
    """The solution of a tile.

    Attributes:
        problem: whose likelihood is expanded near θ.
        theta: θ [T, n].
        prior: of it.
        trials: that it came out of, their costs being above its own; None: no shape is mapped.
    """

    problem: TexelProblem
    theta: Tensor
    prior: TexelPrior
    trials: Trials | None = None

    @property
    def tile(self) -> TexelTile:
        """Of the n texels."""
        return self.problem.tile

    @property
    def radiance(self) -> Tensor:
        """Of the samples [I·n, C]."""
        return self.problem.radiance(self.theta)

    def some(self, places: Tensor) -> TileFit:
        """That of some of the texels, int64 [m], for `normal`."""
        return TileFit(self.problem.some(places), self.theta[:, places], self.prior.some(places))

    def normal(self, rows: Sequence[Row]) -> TexelNormal:
        """What the samples tell of some unknowns, priors of the first rows, those of θ, included."""
        return self.prior.added(self.problem.normal(self.theta, rows), self.theta)


class TexelFitter:
    """Fits the texels of tiles, the parameters in common being those of u [P].

    Args:
        texels: the unknowns.
        unknowns: u [P].
        residual_scale: by which outliers are judged.
    """

    def __init__(self, texels: TexelUnknowns, unknowns: Tensor, residual_scale: ResidualScale) -> None:
        self.texels, self.unknowns = texels, unknowns
        self._residual_scale = residual_scale
        self._model = texel_model(texels, unknowns)
        self._nodes, self._sizes = _nodes(texels, unknowns)
        self._lower, self._upper = texels.lower.float(), texels.upper.float()

    def fit(self, tile: TexelTile, prior: TexelPrior) -> TileFit:
        """The optimum of every texel, found from nothing but the parameters in common."""
        theta, columns, reference = self._brightened(tile)
        kept = columns if self._keeps_columns else None
        if not self.texels.shapes:
            start = TexelProblem(tile, self._model, tile.about(reference, self._residual_scale), kept)
            problem = TexelProblem.of(start, start.squares, theta)
            fit = TileFit(problem, self._climbed(problem, theta, prior), prior)
            # Outliers were judged by a mean that they are in.
            weight = problem.squares.weight
            has_outliers = int(weight.count_nonzero()) < int(tile.usable.count_nonzero()) * weight.shape[1]
            return self.refined(fit) if has_outliers else fit
        start = TexelProblem(tile, self._model, tile.first_guess(reference), kept)
        problem = TexelProblem.of(start, start.squares, theta)
        nodes = self._tried(problem, theta)
        ends = self._ends(problem, nodes, prior)
        theta, lowest = _best(ends, ends.cost), ends.cost.amin(0)
        trials = Trials(torch.cat([nodes.theta, ends.theta]), torch.cat([nodes.cost, ends.cost]) - lowest)
        return self.refined(TileFit(problem, theta, prior, trials))

    @property
    def _keeps_columns(self) -> bool:
        """Whether the columns over a tile are the same for all θ."""
        return self._model.separates or not self.texels.shapes

    def _brightened(self, tile: TexelTile) -> tuple[Tensor, Columns, Tensor]:
        """θ [T, n] with shapes in common and amplitudes as bright as the samples, columns and radiance there."""
        theta = self.texels.spread(self.unknowns, len(tile)).to(tile.radiance)
        columns = self._model.columns(tile, theta)
        reference = radiance(columns, self._model.coefficients(theta), tile.images)
        ratios = tile.ratios(reference)
        for k, row in enumerate(self.texels.rows):
            if row.name not in self.texels.shapes:
                theta[k] *= ratios.mean(0) if row.channel is None else ratios[row.channel]
        theta = theta.clamp(self._lower, self._upper)
        return theta, columns, reference * ratios.T.repeat(tile.images, 1)

    def _climbed(self, problem: TexelProblem, theta: Tensor, prior: TexelPrior) -> Tensor:
        """The optimum near θ where all unknowns are amplitudes: products of two of them need more than one step."""
        for _ in range(_AMPLITUDE_STEPS):
            normal = prior.added(problem.normal(theta, self.texels.rows), theta)
            change = _step(normal, theta, self._lower, self._upper, torch.zeros_like(theta[0]))
            theta = (theta + change).clamp(self._lower, self._upper)
        return theta

    def cost(self, tile: TexelTile, squares: LeastSquares | None, prior: TexelPrior) -> tuple[float, LeastSquares]:
        """The cost of a tile where texels have the best amplitudes; squares that are not given are a first guess."""
        theta, columns, reference = self._brightened(tile)
        if squares is None:
            squares = tile.first_guess(reference)
        problem = TexelProblem.of(TexelProblem(tile, self._model, squares, columns), squares, theta)
        theta = self._climbed(problem, theta, prior)
        return float(problem.normal(theta, ()).cost.sum()), squares

    def radiance(self, tile: TexelTile, theta: Tensor) -> Tensor:
        """Of the samples of any tile [I·n, C], at θ [T, n]."""
        return radiance(self._model.columns(tile, theta), self._model.coefficients(theta), tile.images)

    def at(self, tile: TexelTile, theta: Tensor, prior: TexelPrior) -> TileFit:
        """A solution that is known, θ [T, n], the likelihood being expanded there."""
        columns = self._model.columns(tile, theta) if self._keeps_columns else None
        near = TexelProblem(tile, self._model, tile.about(tile.radiance), columns)
        squares = tile.about(near.radiance(theta), self._residual_scale)
        return TileFit(TexelProblem.of(near, squares, theta), theta, prior)

    def moved(self, start: TileFit, theta: Tensor) -> TileFit:
        """The optimum near θ [T, n], which is that of other parameters in common."""
        columns = self._model.columns(start.tile, theta) if self._keeps_columns else None
        problem = TexelProblem(start.tile, self._model, start.problem.squares, columns)
        return self.refined(replace(start, problem=problem, theta=theta))

    def refined(self, start: TileFit) -> TileFit:
        """The optimum near another one, the likelihood being expanded there."""
        squares = start.tile.about(start.radiance, self._residual_scale)
        problem = TexelProblem.of(start.problem, squares, start.theta)
        if self.texels.shapes:
            theta, _ = self._descended(problem, start.theta, start.prior)
        else:
            theta = self._climbed(problem, start.theta, start.prior)
        return replace(start, problem=problem, theta=theta)

    def with_prior(self, start: TileFit, prior: TexelPrior, places: Tensor) -> TileFit:
        """The same with another prior, which matters to the texels at some places [m] alone: they start anew."""
        theta, some = start.theta.clone(), prior.some(places)
        first = theta[:, places]
        if start.trials is not None:
            trials = start.trials.some(places)
            first = _best(trials, trials.cost + ((trials.theta - some.mean).square() * some.precision).sum(1))
        theta[:, places], _ = self._descended(start.problem.some(places), first, some)
        return replace(start, theta=theta, prior=prior)

    def _tried(self, problem: TexelProblem, theta: Tensor) -> Trials:
        """θ at every node after a step of the amplitudes, and the cost there."""
        chosen = [k for k, row in enumerate(self.texels.rows) if row.name not in self.texels.shapes]
        rows = [self.texels.rows[k] for k in chosen]
        names, lower, upper = {row.name for row in rows}, self._lower[chosen], self._upper[chosen]
        trials, costs = [], []
        for node, gram in zip(self._nodes, self._node_sums(problem, theta), strict=True):
            amplitudes = theta[chosen]
            normal = gram.normal(node.model.coefficients(amplitudes, names), rows)
            cost = normal.cost
            if rows:
                amplitudes = amplitudes + Factored.of(normal.information).solve(normal.gradient)
                amplitudes = amplitudes.clamp(lower, upper)
                change = amplitudes - theta[chosen]
                cost = cost - 2 * (normal.gradient * change).sum(0) + _quadratic(normal.information, change)
            trial = torch.empty_like(theta)
            trial[chosen] = amplitudes
            for name, value in node.shapes.items():
                trial[self.texels.at(name)] = value
            trials.append(trial)
            costs.append(cost)
        return Trials(torch.stack(trials), torch.stack(costs))

    def _node_sums(self, problem: TexelProblem, theta: Tensor) -> Iterator[TexelGram]:
        """The sums of the columns at every node."""
        if not isinstance(self._model, ShadedTexels):
            assert problem.sums is not None
            yield from itertools.repeat(problem.sums, len(self._nodes))
            return
        reference = self._model.coefficients(theta).total
        for columns in self._model.node_columns(problem.tile, [node.shapes for node in self._nodes]):
            first = reference[:, : columns.values.shape[1]]
            yield TexelGram.of(columns, problem.squares, first, problem.tile.images)

    def _ends(self, problem: TexelProblem, nodes: Trials, prior: TexelPrior) -> Trials:
        """The ends of descents from the lowest nodes among their neighbours; infinite cost where there is none.

        A highlight that lies at the foot of a lobe tells its width so well that no grid is fine enough: which of the
        nodes leads to the optimum shows only at the ends.
        """
        minima = _minima(nodes.cost, self._sizes)
        thetas, costs = [], []
        for starts in minima:
            theta, cost = nodes.theta[0].clone(), torch.full_like(nodes.cost[0], torch.inf)
            if len(places := (starts >= 0).nonzero()[:, 0]):
                first = nodes.theta[starts[places], :, places].T
                theta[:, places], cost[places] = self._descended(
                    problem.some(places), first, prior.some(places), _ROUGH_END
                )
            thetas.append(theta)
            costs.append(cost)
        return Trials(torch.stack(thetas), torch.stack(costs))

    def _descended(
        self, problem: TexelProblem, theta: Tensor, prior: TexelPrior, end: float = _END
    ) -> tuple[Tensor, Tensor]:
        """The end of a descent from θ, by Levenberg-Marquardt steps of every texel, and the cost there [n]."""
        rows, lower, upper = self.texels.rows, self._lower, self._upper
        theta = theta.clamp(lower, upper)
        cost = torch.zeros_like(theta[0])
        going = torch.arange(theta.shape[1])
        here = prior.added(problem.normal(theta, rows), theta)
        now, damping = theta, torch.full_like(cost, _DAMPING)
        is_end = torch.zeros_like(going, dtype=torch.bool)
        for _ in range(_STEPS):
            trial = (now + _step(here, now, lower, upper, damping)).clamp(lower, upper)
            change = trial - now
            fall = 2 * (here.gradient * change).sum(0) - _quadratic(here.information, change)
            is_last = fall <= end
            # A short step that hardly lowers the cost holds what is expected of it.
            is_short = (change.abs() <= _SHORT * now.abs()).all(0)
            left = (~(is_end | (is_last & is_short))).nonzero()[:, 0]
            if len(left) < len(going):
                theta[:, going], cost[going] = torch.where(is_end, now, trial), here.cost - fall * ~is_end
                if not len(left):
                    return theta, cost
                going, now, trial, damping = going[left], now[:, left], trial[:, left], damping[left]
                here, is_last = TexelNormal(*(part[..., left] for part in here)), is_last[left]
                problem, prior = problem.some(left), prior.some(left)
            there = prior.added(problem.normal(trial, rows), trial)
            better = there.cost < here.cost
            now = torch.where(better, trial, now)
            here = TexelNormal(*(torch.where(better, new, old) for new, old in zip(there, here, strict=True)))
            damping, is_end = damping * torch.where(better, _SUCCESS, _FAILURE), is_last
        theta[:, going], cost[going] = now, here.cost
        return theta, cost


def _best(trials: Trials, cost: Tensor) -> Tensor:
    """θ [T, n] of the trial of the least cost [S, n]."""
    best = cost.argmin(0)
    return trials.theta.gather(0, best.expand(1, *trials.theta.shape[1:]))[0]


def _minima(cost: Tensor, sizes: Sequence[int]) -> Tensor:
    """The lowest nodes [_STARTS, n] that no neighbour on the grid is lower than, lowest first; −1: there is none.

    Args:
        cost: of the nodes [S, n].
        sizes: number of nodes along each axis of the grid.
    """
    grid = cost.unflatten(0, tuple(sizes))
    lowest = torch.ones_like(grid, dtype=torch.bool)
    for axis, size in enumerate(sizes):
        rise = grid.narrow(axis, 1, size - 1) - grid.narrow(axis, 0, size - 1)
        lowest.narrow(axis, 1, size - 1).logical_and_(rise < 0)
        lowest.narrow(axis, 0, size - 1).logical_and_(rise >= 0)
    costs = torch.where(lowest.flatten(0, len(sizes) - 1), cost, torch.inf)
    chosen = costs.topk(min(_STARTS, len(cost)), dim=0, largest=False)
    places = torch.where(chosen.values.isfinite(), chosen.indices, -1)
    return torch.cat([places, places.new_full((_STARTS - len(places), cost.shape[1]), -1)])


class _Node(NamedTuple):
    """A node of the search.

    Attributes:
        shapes: values of the mapped shapes, by name.
        model: with these in common.
    """

    shapes: Mapping[str, float]
    model: TexelModel


def _nodes(texels: TexelUnknowns, unknowns: Tensor) -> tuple[list[_Node], list[int]]:
    """Every combination of values of the mapped shapes, and the number of values of each."""
    names = texels.shapes
    if not names:
        return [], []
    most = _NODES[min(len(names), len(_NODES)) - 1]
    problem, without = texels.problem, texels.without_shapes()
    counts = [most if problem.declared(name).log else min(most, _EVEN_NODES) for name in names]
    values = [shape_nodes(problem, count)[name] for name, count in zip(names, counts, strict=True)]
    nodes = []
    for combination in itertools.product(*values):
        shapes, here = dict(zip(names, combination, strict=True)), unknowns.clone()
        for name, value in shapes.items():
            here[problem.where[name]] = value
        nodes.append(_Node(shapes, texel_model(without, here)))
    return nodes, counts


def _step(normal: TexelNormal, theta: Tensor, lower: Tensor, upper: Tensor, damping: Tensor) -> Tensor:
    """The damped step of every texel [T, n]; what a bound stops stays."""
    stays = ((theta <= lower) & (normal.gradient < 0)) | ((theta >= upper) & (normal.gradient > 0))
    information = normal.information.clone()
    diagonal = information.diagonal()
    diagonal *= 1 + damping[:, None] + _STAYS * stays.T
    diagonal += torch.finfo(diagonal.dtype).tiny
    return Factored.of(information).solve(torch.where(stays, 0.0, normal.gradient))


def _quadratic(matrices: Tensor, vectors: Tensor) -> Tensor:
    """vᵀMv of every texel [n]."""
    return ((matrices * vectors).sum(1) * vectors).sum(0)
