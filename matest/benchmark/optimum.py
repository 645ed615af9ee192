"""Whether an estimate is the global optimum: its cost against a dense grid of the shape parameters."""

from __future__ import annotations

import itertools
import math

import torch
from torch import Tensor

from matest.capture import Batch, Samples
from matest.estimators import Linearisation, Problem
from matest.estimators.linear import amplitudes
from matest.estimators.linearise import in_memory, product
from matest.estimators.separable import coefficients, compress, separates

NODES = 64


def excess(problem: Problem, unknowns: Tensor, samples: Samples, nodes: int = NODES) -> float:
    """χ² at `unknowns` above the lowest on a grid where every node has its best amplitudes; negative below it.

    Weights follow from the noise at the model's radiance for `unknowns`.

    Args:
        problem: what was estimated, without gauges.
        unknowns: the estimate u [P].
        samples: that it was made from.
        nodes: of the grid in all.
    """
    count = max(round(nodes ** (1 / max(len(problem.shapes), 1))), 2)
    axes = [_axis(problem, name, count) for name in problem.shapes]
    points = [unknowns, *(_moved(problem, unknowns, values) for values in itertools.product(*axes))]
    batches = [samples.at(image, samples.indices(place)) for place, image in enumerate(samples.images)]
    batches = [batch for batch in batches if len(batch)]
    factors, gram, moment = (_separated if separates(problem) else _evaluated)(problem, batches, unknowns, points)
    values = problem.values(unknowns)
    own = torch.stack([product(values, names).expand(problem.channels) for names in factors], dim=-1)
    cost = float((own * ((gram[0] @ own[..., None])[..., 0] - 2 * moment[0])).sum())
    _, costs = amplitudes(problem, factors, gram[1:], moment[1:], {})
    return cost - float(costs.min())


def _axis(problem: Problem, name: str, count: int) -> list[float]:
    """Nodes over the whole domain, even or, for parameters that vary over decades, even in the logarithm."""
    domain = problem.domain(name)
    if problem.declared(name).log:
        low = max(domain.lower, 1e-3 * domain.upper)
        return torch.logspace(math.log10(low), math.log10(domain.upper), count).tolist()
    return torch.linspace(domain.lower, domain.upper, count).tolist()


def _moved(problem: Problem, unknowns: Tensor, shapes: tuple[float, ...]) -> Tensor:
    moved = unknowns.clone()
    for name, value in zip(problem.shapes, shapes, strict=True):
        moved[problem.where[name]] = value
    return moved


Normal = tuple[list[tuple[str, ...]], Tensor, Tensor]


def _evaluated(problem: Problem, batches: list[Batch], reference: Tensor, points: list[Tensor]) -> Normal:
    """Factors of the T terms, their Gram matrices [G, C, T, T] and moments [G, C, T] at every point."""
    with torch.no_grad():
        weighing = Linearisation(problem, reference, derivatives=False)
        weights = [batch.weight(weighing.radiance(batch)).T.double() for batch in batches]
        grams, moments = [], []
        for point in points:
            linearisation = Linearisation(problem, point, derivatives=False)
            gram, moment = torch.zeros(()), torch.zeros(())
            for batch, weight in zip(batches, weights, strict=True):
                basis = linearisation.basis(batch, cut=False)
                columns = basis.columns.permute(2, 0, 1).double()
                weighted = columns * weight[:, None]
                gram = gram + weighted @ columns.mT
                moment = moment + (weighted @ batch.radiance.T[..., None].double())[..., 0]
            grams.append(gram)
            moments.append(moment)
    return basis.factors, torch.stack(grams), torch.stack(moments)


def _separated(problem: Problem, batches: list[Batch], reference: Tensor, points: list[Tensor]) -> Normal:
    """The same from one evaluation of images that do not depend on the shape parameters."""
    total = compress(problem, in_memory(batches), None, reference).total
    grams, moments = [], []
    for point in points:
        at = coefficients(problem, point)
        # Images to terms, [C, K, T].
        weights = torch.stack([torch.block_diag(*rows).T for rows in zip(*at.weights, strict=True)])
        grams.append(weights.mT @ total.gram @ weights)
        moments.append((weights.mT @ total.moment[..., None])[..., 0])
    return at.factors, torch.stack(grams), torch.stack(moments)
