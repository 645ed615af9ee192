"""Whether an estimate is the global optimum: its cost against a dense grid of the shape parameters."""

from __future__ import annotations

import itertools
import math

import torch
from torch import Tensor

from matest.estimators import Problem
from matest.estimators.basis import product
from matest.estimators.linear import amplitudes
from matest.estimators.search import normal_equations
from matest.photographs.samples import PhotographSamples

# Nodes of the grid in all.
NODES = 64


def excess(problem: Problem, unknowns: Tensor, samples: PhotographSamples, nodes: int = NODES) -> float:
    """χ² at `unknowns` above the lowest on a grid where every node has its best amplitudes; negative below it.

    The likelihood is expanded about the model's radiance for `unknowns`; the problem is one without gauges.
    """
    count = max(round(nodes ** (1 / max(len(problem.shapes), 1))), 2)
    axes = [_axis(problem, name, count) for name in problem.shapes]
    points = [unknowns, *(_moved(problem, unknowns, values) for values in itertools.product(*axes))]
    batches = [samples.at(image, samples.indices(place)) for place, image in enumerate(samples.images)]
    batches = [batch for batch in batches if len(batch)]
    factors, gram, moment = normal_equations(problem, batches, points, unknowns)
    values = problem.values(unknowns)
    estimate = torch.stack([product(values, names).expand(problem.channels) for names in factors], dim=-1)
    cost = float((estimate * ((gram[0] @ estimate[..., None])[..., 0] - 2 * moment[0])).sum())
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
