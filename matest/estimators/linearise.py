"""The model and its derivatives at a tile of samples, and the additive statistics of a pass over many tiles."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import torch
from torch import Tensor

from matest.brdf import Term
from matest.brdf.base import factor_slope, factor_value, named_by
from matest.directions import Directions
from matest.estimators.images import Images, illuminate
from matest.estimators.moments import Compressed, Moments, Statistics, joined, moments, nothing
from matest.estimators.unknowns import Problem
from matest.samples import Batch
from matest.samples.tiles import Tiles
from matest.shading import check_sky, lit_directions, sky_nodes, sky_terms
from matest.workers import in_groups


class Linearisation:
    """A problem near some unknowns u [P]: radiance and its derivatives as weighted sums of images.

    Images are, of each term, its shape at unit amplitude, and where asked for its derivatives by the shape parameters
    that it depends on. What does not depend on the tile is computed once.

    Attributes:
        factors: names multiplying each term.
        coefficients: of the K images in the radiance [C, K]; those of derivatives are 0.
        slopes: of the K images in the derivatives by each of the Q free parameters of a channel [C, K, Q].
    """

    def __init__(self, problem: Problem, unknowns: Tensor, *, derivatives: bool = True) -> None:
        self._problem = problem
        self._values = problem.values(unknowns)
        self._leaves = problem.shapes if derivatives else ()
        # A value per channel of anything but a factor makes every shape per channel.
        self._width = max((self._values[name].numel() for name in problem.shaping), default=1)
        self._sky: list[Tensor] = []
        normal = torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64)
        terms, found = self._terms(Directions(normal, normal), torch.Size([1]), normal)
        self.factors = [term.factors for term in terms]
        # Derivatives that are not zero: parameter and term.
        self._steep = [(name, k) for name, parts in found.items() for k, part in enumerate(parts) if part is not None]
        amplitudes = torch.stack([product(self._values, factors).expand(problem.channels) for factors in self.factors])
        still = amplitudes.new_zeros(len(self._steep), problem.channels)
        self.coefficients = torch.cat([amplitudes, still]).T
        self.slopes = self.coefficients.new_zeros(*self.coefficients.shape, 0)
        if derivatives and problem.free:
            self.slopes = torch.stack([self._slope(name, amplitudes) for name in problem.free], dim=-1)

    def _slope(self, name: str, amplitudes: Tensor) -> Tensor:
        """Coefficients [C, K] of the derivative by a parameter."""
        problem = self._problem
        if name in problem.shapes:
            own = [amplitudes[k] * (shape == name) for shape, k in self._steep]
            return torch.stack([*torch.zeros_like(amplitudes), *own], dim=-1)
        by_factor = [derivative(self._values, problem.ties, factors, name) for factors in self.factors]
        rows = [torch.as_tensor(d).to(amplitudes).expand(problem.channels) for d in by_factor]
        return torch.stack([*rows, *amplitudes.new_zeros(len(self._steep), problem.channels)], dim=-1)

    def images(self, batch: Batch, *, cut: bool = True) -> Images:
        """The K images; with `cut`, light whose reflectance at these parameters is below zero gives nothing."""
        points, like = batch.points, batch.radiance
        # Not by torch, which would import sympy for it.
        lead = torch.Size(
            np.broadcast_shapes(points.wi.shape[:-1], (*points.wo.shape[:-1], 1), points.irradiance.shape[:-1])
        )
        shapes = self._shapes(lit_directions(points), lead, like)
        if points.ambient is not None and not self._sky:
            check_sky(self._problem.brdf)
            nodes = sky_nodes(like.dtype, like.device)
            lead = torch.Size((nodes.directions.cos_o.shape[0], nodes.weight.shape[1]))
            over_sky = [shape.expand(*lead, self._width) for shape in self._shapes(nodes.directions, lead, like)]
            self._sky = [term.shape for term in sky_terms(tuple(Term((), shape) for shape in over_sky))]
        return illuminate(points, shapes, self._sky, self.coefficients if cut else None, like.shape[-1])

    def _shapes(self, directions: Directions, lead: torch.Size, like: Tensor) -> list[Tensor]:
        terms, slopes = self._terms(directions, lead, like)
        steep = [slopes[name][k] for name, k in self._steep]
        return [*(term.shape for term in terms), *(slope for slope in steep if slope is not None)]

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
            for _, shape, *_ in terms if leaves else ():
                found: tuple[Tensor | None, ...] = (None,) * len(leaves)
                if shape.requires_grad:
                    found = torch.autograd.grad(
                        shape.sum(), list(leaves.values()), retain_graph=True, allow_unused=True
                    )
                for name, slope in zip(leaves, found, strict=True):
                    slopes[name].append(slope)
        return tuple(Term(term.factors, term.shape.detach()) for term in terms), slopes

    def radiance(self, batch: Batch) -> Tensor:
        """Model radiance [n, C]."""
        return self.images(batch).radiance(self.coefficients)

    def radiance_and_jacobian(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """Model radiance [n, C], and its derivatives by the free parameters of each channel [Q, n, C]."""
        images = self.images(batch)
        return images.radiance(self.coefficients), images.mixed(self.slopes.mT)


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


def accumulate(
    problem: Problem, unknowns: Tensor, tiles: Tiles, reference: Tensor | None, misfit: float = 1.0
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
    here = Linearisation(problem, unknowns)
    same = reference is not None and torch.equal(reference, unknowns)
    there = None if reference is None or same else Linearisation(problem, reference, derivatives=False)

    def expand(batch: Batch) -> tuple[Images, Tensor, Tensor | None]:
        images = here.images(batch)
        radiance = images.radiance(here.coefficients)
        if reference is None or batch.settled is not None:
            return images, radiance, None
        return images, radiance, there.radiance(batch) if there else radiance

    compressed = collect(tiles, expand, here.coefficients, misfit)
    return compressed.statistics(here.coefficients, here.slopes @ problem.selectors)


def collect(
    tiles: Tiles, expand: Callable[[Batch], tuple[Images, Tensor, Tensor | None]], origin: Tensor, misfit: float
) -> Compressed:
    """One walk over the samples.

    Args:
        tiles: as in `accumulate`.
        expand: gives the images of a batch, the radiance [n, C] that residuals are taken from, and the radiance that
            the likelihood is expanded about (None: the measured).
        origin: coefficients of the images in the former [C, K].
        misfit: see `Batch.working`.
    """

    def work(tile: Callable[[], Batch]) -> list[Moments]:
        with torch.no_grad():
            found, batch = [], tile()
            images, radiance, reference = expand(batch)
            if batch.merged is not None and reference is not None:
                batch, finer = batch.merged.judge(batch, reference, misfit)
                if finer is not None:
                    found = work(lambda: finer)
            working = batch.settled
            if working is None:
                working = batch.measured() if reference is None else batch.working(reference, misfit)
            return [*found, moments(images, working, working.response - radiance, batch)]

    return Compressed(origin, joined([nothing(*origin.shape), *in_groups(work, tiles)]))
