"""Models that separate into columns from the geometry and weights from the parameters: one walk serves every value.

Where every term is Σq weights_q(parameters) · columns_q(directions), radiance is Φ g(u) with columns Φ that no
parameter touches. Their Gram matrix and moments, once added up, give χ² and its derivatives at any u by small matrix
products.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import torch
from torch import Tensor

from matest.brdf import Brdf, Term
from matest.brdf.terms import Product
from matest.directions import Directions
from matest.estimators.images import Images, illuminate
from matest.estimators.levenberg_marquardt import Evaluate
from matest.estimators.linearise import Linearisation, accumulate, collect, derivative, product
from matest.estimators.moments import Compressed, Statistics
from matest.estimators.unknowns import Problem
from matest.samples import Batch
from matest.samples.tiles import Tiles
from matest.shading import check_sky, lit_directions, sky_nodes, sky_terms


@dataclass(frozen=True)
class Coefficients:
    """g(u), the coefficient of every column.

    Attributes:
        total: g [C, K], the columns of all terms one after another.
        slopes: derivatives of g by every free parameter of a channel [Q, C, K].
    """

    total: Tensor
    slopes: Tensor


def separates(problem: Problem) -> bool:
    """Whether no column depends on a parameter that is estimated."""
    terms = problem.brdf.structure.terms
    sources = {problem.ties.get(name, name) for term in terms for name in term.column_parameters}
    # One of a value per channel makes columns of one per channel.
    return all(name in problem.held and problem.held[name].numel() == 1 for name in sources)


def coefficients(problem: Problem, unknowns: Tensor) -> Coefficients:
    """The coefficients and their derivatives at `unknowns` u [P]."""
    values = problem.values(unknowns)
    sizes = problem.brdf.structure.columns
    # Each column has its own copy of the shape parameters: one reverse pass a term yields all derivatives.
    terms, leaves = _probe(problem, unknowns, max(sizes))
    parts = []
    slopes: dict[str, list[Tensor]] = {name: [] for name in problem.free}
    for term, size in zip(terms, sizes, strict=True):
        own = torch.ones(1, 1, dtype=torch.float64) if term.weights is None else term.weights
        own = own[:size].diagonal(dim1=0, dim2=2) if own.ndim == 3 else own
        found: dict[str, Tensor | None] = dict.fromkeys(leaves)
        if own.requires_grad:
            grads = torch.autograd.grad(own.sum(), list(leaves.values()), retain_graph=True, allow_unused=True)
            found = dict(zip(leaves, grads, strict=True))
        own = own.detach().expand(problem.channels, size)
        amplitude = product(values, term.factors).expand(problem.channels)[:, None]
        parts.append(amplitude * own)
        for name in problem.free:
            if name not in leaves:
                by_amplitude = torch.as_tensor(derivative(values, problem.ties, term.factors, name)).to(own)
                slopes[name].append(by_amplitude.expand(problem.channels)[:, None] * own)
            elif (by_shape := found[name]) is None:
                slopes[name].append(torch.zeros_like(own))
            else:
                slopes[name].append(amplitude * by_shape[:size].T)
    stacked = [torch.cat(columns, dim=-1) for columns in slopes.values()]
    total = torch.cat(parts, dim=-1)
    return Coefficients(
        total=total,
        slopes=torch.stack(stacked) if stacked else total.new_zeros(0, *total.shape),
    )


def mixture(problem: Problem, unknowns: Tensor) -> tuple[list[Product], list[Tensor]]:
    """The factors of each term, and the weights of its columns at unit amplitude [C, Q]."""
    terms, _ = _probe(problem, unknowns, 1)
    weights = []
    for term, size in zip(terms, problem.brdf.structure.columns, strict=True):
        own = torch.ones(1, 1, dtype=torch.float64) if term.weights is None else term.weights
        own = own[0] if own.ndim == 3 else own
        weights.append(own.detach().expand(problem.channels, size))
    return [term.factors for term in terms], weights


def _probe(problem: Problem, unknowns: Tensor, copies: int) -> tuple[tuple[Term, ...], dict[str, Tensor]]:
    """The terms at one pair of directions, with `copies` of the estimated shape parameters as leaves."""
    values = problem.values(unknowns)
    width = max((problem.count(name) for name in problem.shapes), default=1)
    leaves = {
        name: values[name].reshape(1, -1).expand(copies, width).clone().requires_grad_() for name in problem.shapes
    }
    values |= leaves
    values |= {name: leaves[source] for name, source in problem.ties.items() if source in leaves}
    normal = torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64)
    with torch.enable_grad():
        return problem.brdf.replace(values).terms(Directions(normal, normal)), leaves


def compress(
    problem: Problem, tiles: Tiles, origin: Tensor | None, reference: Tensor | None, misfit: float = 1.0
) -> Compressed:
    """One walk over the samples of a problem that `separates`; tiles as in `accumulate`.

    Args:
        problem: what is estimated.
        tiles: groups of functions that give a tile each; a group is worked on at once.
        origin: u [P] near the optimum, from which residuals are taken: they keep their digits. Light whose reflectance
            there is below zero gives nothing. None: the measured radiance itself.
        reference: the likelihood is expanded about the model's radiance for these unknowns; None: about the measured.
        misfit: see `Batch.working`.
    """
    images = _Images(problem, None if origin is None else coefficients(problem, origin).total)
    weighing = None if reference is None else coefficients(problem, reference).total

    def expand(batch: Batch) -> tuple[Images, Tensor, Tensor | None]:
        found = images.of(batch)
        radiance = torch.zeros_like(batch.radiance) if images.origin is None else found.radiance(images.origin)
        if weighing is None:
            return found, radiance, None
        same = images.origin is not None and torch.equal(weighing, images.origin)
        return found, radiance, radiance if same else found.radiance(weighing)

    start = images.origin
    if start is None:
        start = torch.zeros_like(coefficients(problem, torch.full((problem.size,), 0.5, dtype=torch.float64)).total)
    return collect(tiles, expand, start, misfit)


def statistics(problem: Problem, compressed: Compressed, unknowns: Tensor) -> Statistics:
    """What a pass over the samples at u [P] would give."""
    at = coefficients(problem, unknowns)
    # Derivatives of the coefficients of each channel by u, [C, K, P].
    return compressed.statistics(at.total, at.slopes.permute(1, 2, 0) @ problem.selectors)


def passes_over(problem: Problem, tiles: Tiles, origin: Tensor, reference: Tensor | None, misfit: float) -> Evaluate:
    """Statistics at any unknowns near `origin`: by a pass each, or from a single one where the model separates.

    Arguments are those of `compress`.
    """
    if separates(problem):
        return partial(statistics, problem, compress(problem, tiles, origin, reference, misfit))
    return partial(accumulate, problem, tiles=tiles, reference=reference, misfit=misfit)


def radiances(problem: Problem, unknowns: Tensor) -> Callable[[Batch], Tensor]:
    """The model's radiance [n, C] of any batch at u [P]."""
    if not separates(problem):
        return Linearisation(problem, unknowns, derivatives=False).radiance
    images = _Images(problem, at := coefficients(problem, unknowns).total)
    return lambda batch: images.of(batch).radiance(at)


class _Kept(NamedTuple):
    """Shapes, and the model and its held values that they belong to."""

    brdf: Brdf
    held: Mapping[str, Tensor]
    shapes: list[Tensor]


class _Images:
    """Evaluates the images Φ of a problem; what does not depend on the tile is computed once."""

    def __init__(self, problem: Problem, origin: Tensor | None) -> None:
        self.origin = origin
        self._problem = problem
        # The images do not depend on these values.
        self._anywhere = problem.values(torch.full((problem.size,), 0.5, dtype=torch.float64))
        self._sky: list[Tensor] = []

    def of(self, batch: Batch) -> Images:
        """Φ: radiance at unit coefficients."""
        points, like = batch.points, batch.radiance
        if points.ambient is not None and not self._sky:
            check_sky(self._problem.brdf)
            nodes = sky_nodes(like.dtype, like.device)
            over_sky = tuple(Term((), shape) for shape in self._shapes(nodes.directions, like))
            self._sky = [term.shape for term in sky_terms(over_sky)]
        return illuminate(points, self._lit_shapes(batch), self._sky, self.origin, like.shape[-1])

    def _lit_shapes(self, batch: Batch) -> list[Tensor]:
        """All images of every light, kept for the next pass where the samples are."""
        kept = (batch.kept or {}).get("shapes")
        if kept is not None and kept.brdf is self._problem.brdf and kept.held is self._problem.held:
            return kept.shapes
        shapes = self._shapes(lit_directions(batch.points), batch.radiance)
        if batch.kept is not None:
            batch.kept["shapes"] = _Kept(self._problem.brdf, self._problem.held, shapes)
        return shapes

    def _shapes(self, directions: Directions, like: Tensor) -> list[Tensor]:
        """All images [n, L, 1 or C]."""
        values = {name: value.to(like.device, like.dtype) for name, value in self._anywhere.items()}
        shapes: list[Tensor] = []
        for term in self._problem.brdf.replace(values).terms(directions):
            shapes += [term.shape] if term.columns is None else term.columns.split(1, dim=-1)
        return shapes
