"""Models that separate into images of the geometry and weights from the parameters: one walk serves every value.

Where every term is Σq weights_q(parameters) · images_q(directions), radiance is Φ g(u) with columns Φ that no parameter
touches. Their Gram matrix and moments, once added up, give χ² and its derivatives at any u by small matrix products.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields

import torch
from torch import Tensor

from matest.brdf import Term
from matest.capture import Batch
from matest.capture.batch import Working
from matest.directions import Directions
from matest.estimators.linearise import (
    Statistics,
    Sums,
    blocks,
    derivative,
    part_of,
    product,
    scores,
    walk,
)
from matest.estimators.problem import Problem
from matest.shader import check_sky, gathered_light, interpolate, lit_directions, sky_nodes, sky_terms


@dataclass(frozen=True)
class Coefficients:
    """g(u), the coefficient of every image.

    Attributes:
        factors: names multiplying each of the terms.
        weights: of the images of each term at unit amplitude, [C, Q].
        total: g [C, K], the images of all terms one after another.
        slopes: derivatives of g by every free parameter of a channel [Q, C, K].
    """

    factors: list[tuple[str, ...]]
    weights: list[Tensor]
    total: Tensor
    slopes: Tensor


def separates(problem: Problem) -> bool:
    """Whether no image depends on a parameter that is estimated."""
    terms, _ = _probe(problem, torch.full((problem.size,), 0.5, dtype=torch.float64), 1)
    return all(
        term.images is not None or (term.shape.shape[-1] == 1 and not term.shape.requires_grad) for term in terms
    )


def coefficients(problem: Problem, unknowns: Tensor) -> Coefficients:
    """The coefficients and their derivatives at `unknowns` u [P]."""
    values = problem.values(unknowns)
    terms, _ = _probe(problem, unknowns, 1)
    sizes = [1 if term.images is None else term.images.shape[-1] for term in terms]
    # Each image has its own copy of the shape parameters: one reverse pass a term yields all derivatives.
    terms, leaves = _probe(problem, unknowns, max(sizes))
    weights, parts = [], []
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
        weights.append(own)
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
        factors=[term.factors for term in terms],
        weights=weights,
        total=total,
        slopes=torch.stack(stacked) if stacked else total.new_zeros(0, *total.shape),
    )


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


@dataclass(frozen=True)
class Moments:
    """Additive statistics of the images Φ [n, C, K] of some samples, double precision; r is a residual.

    Attributes:
        gram: ΦᵀWΦ [C, K, K].
        moment: ΦᵀWr [C, K].
        cost, chi2, values, outliers, squared_residual, squared_signal, samples: as in `Sums`.
    """

    gram: Tensor
    moment: Tensor
    cost: float
    chi2: float
    values: int
    outliers: int
    squared_residual: float
    squared_signal: float
    samples: int

    @classmethod
    def of(cls, images: Tensor, working: Working, residual: Tensor) -> Moments:
        """Of images [C, n, K] and residuals [n, C]."""
        weighted = images * working.weight.T[..., None]
        columns = residual.T[..., None]
        return cls(
            gram=(weighted.mT @ images).double().cpu(),
            moment=(weighted.mT @ columns)[..., 0].double().cpu(),
            **scores(working, residual),
        )

    def __add__(self, other: Moments) -> Moments:
        return Moments(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))


@dataclass(frozen=True)
class Compressed:
    """All that a separable problem needs of its samples.

    Attributes:
        problem: what is estimated.
        origin: coefficients g [C, K] that residuals were taken from.
        clusters: moments of every block of pixels.
    """

    problem: Problem
    origin: Tensor
    clusters: dict[int, Moments]

    @property
    def total(self) -> Moments:
        return sum(list(self.clusters.values())[1:], start=next(iter(self.clusters.values())))

    def statistics(self, unknowns: Tensor) -> Statistics:
        """What a pass over the samples at u [P] would give; the squared residual stays that at the origin."""
        at = coefficients(self.problem, unknowns)
        change = at.total - self.origin
        # Derivatives of the coefficients of each channel by u, [C, K, P].
        slopes = at.slopes.permute(1, 2, 0) @ self.problem.selectors
        out = Statistics()
        for label, own in self.clusters.items():
            moved = (own.gram @ change[..., None])[..., 0]
            rise = float((change * (moved - 2 * own.moment)).sum())
            sums = Sums(
                information=(slopes.mT @ own.gram @ slopes).sum(0),
                gradient=(slopes.mT @ (own.moment - moved)[..., None]).sum(0)[:, 0],
                cost=own.cost + rise,
                chi2=own.chi2 + rise,
                values=own.values,
                outliers=own.outliers,
                squared_residual=own.squared_residual,
                squared_signal=own.squared_signal,
                samples=own.samples,
            )
            out.add(label, sums)
        return out


def compress(
    problem: Problem,
    tiles: Iterable[Sequence[Callable[[], Batch]]],
    origin: Tensor | None,
    reference: Tensor | None,
    misfit: float = 1.0,
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
    images = _Images(problem, coefficients(problem, origin).total if origin is not None else None)
    weighing = coefficients(problem, reference).total if reference is not None else None

    def work(tile: Callable[[], Batch]) -> list[tuple[int, Moments]]:
        with torch.no_grad():
            batch = tile()
            columns = images.of(batch)

            def radiance(total: Tensor) -> Tensor:
                return (columns @ total.to(columns)[..., None])[..., 0].T

            working = batch.measured() if weighing is None else batch.working(radiance(weighing), misfit)
            residual = working.response if images.origin is None else working.response - radiance(images.origin)
            return [
                (cluster, Moments.of(columns[:, part], part_of(working, part), residual[part]))
                for cluster, part in blocks(batch)
            ]

    clusters: dict[int, Moments] = {}
    for cluster, moments in walk(tiles, work):
        clusters[cluster] = clusters[cluster] + moments if cluster in clusters else moments
    zero = torch.zeros_like(next(iter(clusters.values())).moment)
    return Compressed(problem, zero if images.origin is None else images.origin, clusters)


class _Images:
    """Evaluates the images Φ of a problem; what does not depend on the tile is computed once."""

    def __init__(self, problem: Problem, origin: Tensor | None) -> None:
        self.origin = origin
        self._problem = problem
        # The images do not depend on these values.
        self._anywhere = problem.values(torch.full((problem.size,), 0.5, dtype=torch.float64))
        self._sky: Tensor | None = None

    def of(self, batch: Batch) -> Tensor:
        """Φ [C, n, K]: radiance at unit coefficients."""
        points = batch.points
        gathered = gathered_light(points)
        shapes = self._shapes(lit_directions(points), batch.radiance)
        if self.origin is not None:
            gathered = gathered * (shapes @ self.origin.T.to(shapes) >= 0)
        gathered = gathered.expand(*gathered.shape[:-1], batch.radiance.shape[-1])
        columns = torch.einsum("nlc,nlk->cnk", gathered, shapes)
        if points.ambient is not None:
            if self._sky is None:
                check_sky(self._problem.brdf)
                nodes = sky_nodes(columns.dtype, columns.device)
                table = Term((), self._shapes(nodes.directions, batch.radiance))
                self._sky = sky_terms((table,))[0].shape
            ambient = points.ambient.expand(columns.shape[1], -1)
            columns = columns + ambient.T[..., None] * interpolate(self._sky, points.wo[..., 2:])
        return columns

    def _shapes(self, directions: Directions, like: Tensor) -> Tensor:
        """All images side by side [..., K]."""
        values = {name: value.to(like.device, like.dtype) for name, value in self._anywhere.items()}
        terms = self._problem.brdf.replace(values).terms(directions)
        parts = [term.shape if term.images is None else term.images for term in terms]
        lead = torch.broadcast_shapes(*(part.shape[:-1] for part in parts))
        return torch.cat([part.expand(*lead, -1) for part in parts], dim=-1)
