"""The model and its derivatives at a tile of samples, and the additive statistics of a pass over many tiles."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from functools import partial
from typing import Any, TypeVar

import torch
from torch import Tensor

from matest.brdf import Term
from matest.brdf.base import factor_slope, factor_value, named_by
from matest.capture import Batch
from matest.capture.batch import Working
from matest.directions import Directions
from matest.estimators.problem import Problem
from matest.shader import check_sky, gathered_light, interpolate, lit_directions, sky_nodes, sky_terms

Result = TypeVar("Result")


@dataclass(frozen=True)
class Basis:
    """Radiance of each term of a model at unit coefficient, and its derivatives by the shape parameters.

    Attributes:
        factors: names multiplying each of the K terms.
        columns: [K, n, C].
        slopes: by shape parameter, [K, n, C].
    """

    factors: list[tuple[str, ...]]
    columns: Tensor
    slopes: dict[str, Tensor]


class Linearisation:
    """Evaluates a problem's basis at given shape parameters; what does not depend on the tile is computed once."""

    def __init__(self, problem: Problem, unknowns: Tensor, *, derivatives: bool = True) -> None:
        self._problem = problem
        self._values = problem.values(unknowns)
        self._derivatives = derivatives
        # A value per channel of anything but a factor makes every shape per channel.
        self._width = max((self._values[name].numel() for name in problem.shaping), default=1)
        self._sky: tuple[Tensor, dict[str, Tensor]] | None = None

    def basis(self, batch: Batch, *, cut: bool = True) -> Basis:
        """Columns and slopes; with `cut`, light whose reflectance at these parameters is below zero gives nothing."""
        points = batch.points
        gathered = gathered_light(points)
        directions = lit_directions(points)
        terms, slopes = self._terms(directions, gathered.shape[:-1], batch.radiance)
        if cut:
            values = self._values_like(batch.radiance)
            reflectance = sum(product(values, term.factors) * term.shape for term in terms)
            gathered = gathered * (torch.as_tensor(reflectance) >= 0)

        def gather(shapes: list[Tensor]) -> Tensor:
            return torch.stack([(gathered * shape).sum(-2).expand_as(batch.radiance) for shape in shapes])

        columns = gather([term.shape for term in terms])
        gathered_slopes = {name: gather(parts) for name, parts in slopes.items()}
        if points.ambient is not None:
            table, table_slopes = self._ambient(batch.radiance)
            cos_o, ambient = points.wo[..., 2:], points.ambient
            columns = columns + torch.stack([ambient * interpolate(part, cos_o) for part in table])
            for name, parts in table_slopes.items():
                gathered_slopes[name] = gathered_slopes[name] + torch.stack(
                    [ambient * interpolate(part, cos_o) for part in parts]
                )
        return Basis([term.factors for term in terms], columns, gathered_slopes)

    def _terms(
        self, directions: Directions, lead: torch.Size, like: Tensor
    ) -> tuple[tuple[Term, ...], dict[str, list[Tensor]]]:
        """Terms and the derivative of every shape by every shape parameter, sample by sample.

        Each sample gets its own copy of the parameters, so one reverse pass per term yields the whole Jacobian:
        samples do not mix.
        """
        problem = self._problem
        with torch.set_grad_enabled(self._derivatives):
            leaves = {}
            for name in problem.shapes if self._derivatives else ():
                value = self._values[name].to(like.device, like.dtype)
                leaves[name] = value.expand(*lead, self._width).clone().requires_grad_()
            values = self._values_like(like) | leaves
            values |= {name: leaves[source] for name, source in problem.ties.items() if source in leaves}
            terms = problem.brdf.replace(values).terms(directions)
            slopes: dict[str, list[Tensor]] = {name: [] for name in leaves}
            for _, shape, *_ in terms if leaves else ():
                found: tuple[Tensor | None, ...] = (None,) * len(leaves)
                if shape.requires_grad:
                    found = torch.autograd.grad(
                        shape.sum(), list(leaves.values()), retain_graph=True, allow_unused=True
                    )
                for name, slope in zip(leaves, found, strict=True):
                    slopes[name].append(like.new_zeros(1, 1, 1) if slope is None else slope)
        return tuple(Term(term.factors, term.shape.detach()) for term in terms), slopes

    def _ambient(self, like: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        if self._sky is None:
            check_sky(self._problem.brdf)
            nodes = sky_nodes(like.dtype, like.device)
            lead = torch.Size((nodes.directions.cos_o.shape[0], nodes.weight.shape[1]))
            terms, slopes = self._terms(nodes.directions, lead, like)
            width = self._width

            def tabulate(shapes: list[Tensor]) -> Tensor:
                parts = [shape.expand(*lead, width) for shape in shapes]
                return torch.stack([term.shape for term in sky_terms(tuple(Term((), part) for part in parts))])

            self._sky = (
                tabulate([term.shape for term in terms]),
                {name: tabulate(parts) for name, parts in slopes.items()},
            )
        return self._sky

    def radiance(self, batch: Batch) -> Tensor:
        """Model radiance [n, C]."""
        basis = self.basis(batch)
        coefficients = _coefficients(self._values_like(batch.radiance), basis, batch.radiance)
        return torch.einsum("kc,knc->nc", coefficients, basis.columns)

    def _values_like(self, like: Tensor) -> dict[str, Tensor]:
        return {name: value.to(like.device, like.dtype) for name, value in self._values.items()}

    def radiance_and_jacobian(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """Model radiance [n, C], and its derivatives by the free parameters of each channel [Q, n, C]."""
        problem, basis = self._problem, self.basis(batch)
        like = batch.radiance
        values = self._values_like(like)
        coefficients = _coefficients(values, basis, like)
        radiance = torch.einsum("kc,knc->nc", coefficients, basis.columns)
        jacobian = []
        for name in problem.free:
            if name in basis.slopes:
                jacobian.append(torch.einsum("kc,knc->nc", coefficients, basis.slopes[name]))
            else:
                by_factor = [derivative(values, problem.ties, factors, name) for factors in basis.factors]
                weights = torch.stack([torch.as_tensor(d).to(like).expand(like.shape[-1]) for d in by_factor])
                jacobian.append(torch.einsum("kc,knc->nc", weights, basis.columns))
        return radiance, torch.stack(jacobian) if jacobian else like.new_zeros(0, *like.shape)


def _coefficients(values: dict[str, Tensor], basis: Basis, like: Tensor) -> Tensor:
    """Coefficient of every term in every channel, [K, C]."""
    return torch.stack([product(values, factors).expand(like.shape[-1]) for factors in basis.factors])


def product(values: dict[str, Tensor], factors: tuple[str, ...]) -> Tensor:
    """The product of some factors."""
    out = torch.ones_like(next(iter(values.values())))
    for factor in factors:
        out = out * factor_value(factor, values)
    return out


def derivative(
    values: dict[str, Tensor], ties: Mapping[str, str], factors: tuple[str, ...], name: str
) -> Tensor | float:
    """Derivative of a product of factors by a parameter (and by those tied to it)."""
    total: Tensor | float = 0.0
    for position, factor in enumerate(factors):
        if name in (named_by(factor), ties.get(named_by(factor))):
            total = total + factor_slope(factor) * product(values, factors[:position] + factors[position + 1 :])
    return total


@dataclass(frozen=True)
class Sums:
    """Additive statistics of some samples, double precision.

    Attributes:
        information: JᵀWJ [P, P].
        gradient: JᵀWr [P].
        cost: rᵀWr of all values, what a fit minimises.
        chi2: rᵀWr of the plain values: measured well inside the sensor's range, and no outliers.
        values: number of these.
        outliers: number of plain values of weight 0.
        squared_residual: rᵀr of the values of `chi2`.
        squared_signal: yᵀy of them.
        samples: number of samples.
    """

    information: Tensor
    gradient: Tensor
    cost: float
    chi2: float
    values: int
    outliers: int
    squared_residual: float
    squared_signal: float
    samples: int

    @classmethod
    def of(cls, working: Working, radiance: Tensor, jacobian: Tensor, selectors: Tensor) -> Sums:
        """Statistics of a tile: model radiance [n, C], Jacobian [Q, n, C], selectors [C, Q, P]."""
        residual = working.response - radiance
        columns = jacobian.permute(2, 0, 1)
        weighted = columns * working.weight.T[:, None]
        normal = (weighted @ columns.mT).double().cpu()
        slope = (weighted @ residual.T[..., None]).double().cpu()
        return cls(
            information=(selectors.mT @ normal @ selectors).sum(0),
            gradient=(selectors.mT @ slope).sum(0)[:, 0],
            **scores(working, residual),
        )

    def __add__(self, other: Sums) -> Sums:
        return Sums(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))


def scores(working: Working, residual: Tensor) -> dict[str, Any]:
    """The scalars of `Sums` for residuals [n, C]."""
    squared, signal = residual.square(), working.response.square()
    weighted = working.weight * squared
    cost = float(weighted.sum(dtype=torch.float64))
    counted = working.plain & (working.weight > 0)
    values = int(counted.sum())
    if values < counted.numel():
        squared, signal, weighted = squared * counted, signal * counted, weighted * counted
    return {
        "cost": cost,
        "chi2": cost if values == counted.numel() else float(weighted.sum(dtype=torch.float64)),
        "values": values,
        "outliers": int(working.plain.sum()) - values,
        "squared_residual": float(squared.sum()),
        "squared_signal": float(signal.sum()),
        "samples": len(residual),
    }


@dataclass
class Statistics:
    """Statistics of a pass over samples, cluster by cluster."""

    clusters: dict[int, Sums] = field(default_factory=dict)

    def total(self, name: str) -> float:
        return sum(getattr(sums, name) for sums in self.clusters.values())

    def add(self, cluster: int, sums: Sums) -> None:
        known = self.clusters.get(cluster)
        self.clusters[cluster] = sums if known is None else known + sums

    @property
    def reduced_chi2(self) -> float:
        """χ² per value."""
        return self.total("chi2") / max(self.total("values"), 1)

    @property
    def misfit(self) -> float:
        """χ² per value, at least 1: how much larger the residuals are than the noise."""
        return max(self.reduced_chi2, 1.0)

    @property
    def outliers(self) -> float:
        """Share of outliers among the values that a goodness of fit is judged by."""
        rejected = self.total("outliers")
        return rejected / max(rejected + self.total("values"), 1)

    @property
    def relative_rmse(self) -> float:
        """Rms residual over rms signal; 0 without signal."""
        signal = self.total("squared_signal")
        return math.sqrt(self.total("squared_residual") / signal) if signal > 0 else 0.0

    def grouped(self, size: int) -> Statistics:
        """The same statistics with `size` successive cluster labels joined into one."""
        joined = Statistics()
        for cluster, sums in self.clusters.items():
            joined.add(cluster // size, sums)
        return joined

    @property
    def information(self) -> Tensor:
        return torch.stack([sums.information for sums in self.clusters.values()]).sum(0)

    @property
    def gradient(self) -> Tensor:
        return torch.stack([sums.gradient for sums in self.clusters.values()]).sum(0)


def accumulate(
    problem: Problem,
    unknowns: Tensor,
    tiles: Iterable[Sequence[Callable[[], Batch]]],
    reference: Tensor | None,
    misfit: float = 1.0,
) -> Statistics:
    """One pass: the additive statistics at `unknowns`.

    Tiles are fetched and worked on by one thread per processor, and added up in their order: the result does not
    depend on the number of threads.

    Args:
        problem: what is estimated.
        unknowns: u [P], float64.
        tiles: groups of functions that give a tile each; a group is worked on at once.
        reference: the likelihood is expanded about the model's radiance for these unknowns (`Batch.working`); None:
            about the measured radiance, for a first guess.
        misfit: see `Batch.working`.
    """
    linearisation = Linearisation(problem, unknowns)
    same = reference is not None and torch.equal(reference, unknowns)
    weighing = None if reference is None or same else Linearisation(problem, reference, derivatives=False)
    selectors = problem.selectors

    def work(tile: Callable[[], Batch]) -> list[tuple[int, Sums]]:
        with torch.no_grad():
            batch = tile()
            radiance, jacobian = linearisation.radiance_and_jacobian(batch)
            if reference is None:
                working = batch.measured()
            else:
                working = batch.working(weighing.radiance(batch) if weighing else radiance, misfit)
            return [
                (cluster, Sums.of(part_of(working, part), radiance[part], jacobian[:, part], selectors))
                for cluster, part in blocks(batch)
            ]

    statistics = Statistics()
    for cluster, sums in walk(tiles, work):
        statistics.add(cluster, sums)
    return statistics


def walk(
    tiles: Iterable[Sequence[Callable[[], Batch]]], work: Callable[[Callable[[], Batch]], list[Result]]
) -> Iterator[Result]:
    """What `work` gives for each tile, in their order; one thread per processor works on a group of tiles."""
    with single_threaded_torch(), ThreadPoolExecutor(processors()) as pool:
        for group in tiles:
            yield from itertools.chain.from_iterable(pool.map(work, group))


def part_of(working: Working, part: slice) -> Working:
    return Working(*(value[part] for value in working))


def blocks(batch: Batch) -> Iterator[tuple[int, slice]]:
    """Label and place of every block of pixels in a batch."""
    start = 0
    for cluster, length in batch.runs or ((batch.cluster or 0, len(batch)),):
        yield cluster, slice(start, start + length)
        start += length


def in_memory(batches: Iterable[Batch]) -> list[list[Callable[[], Batch]]]:
    """Batches that are already there, as the tiles of `accumulate`."""
    return [[partial(_itself, batch) for batch in batches]]


def _itself(batch: Batch) -> Batch:
    return batch


@contextmanager
def single_threaded_torch() -> Iterator[None]:
    """Let every torch call inside run on the calling thread.

    Tiles are too small to be worth splitting: threads that torch starts for one wait for each other more than they
    compute, and stall altogether beside another busy process.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
