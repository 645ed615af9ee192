"""Problems, unknowns and normal equations that the tests of solvers share."""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from torch import Tensor

from matest.estimation.options import Options, Value
from matest.estimation.specification import specify
from matest.estimators import Problem
from matest.estimators.moments import scores
from matest.estimators.statistics import Statistics


def problem(
    expression: str,
    *,
    channels: int = 1,
    relative: bool = False,
    fix: Mapping[str, Value] | None = None,
    free: tuple[str, ...] = (),
    tie: Mapping[str, str] | None = None,
) -> Problem:
    options = Options(fix=fix or {}, free=free, tie=tie or {})
    return specify(expression, options, channels=channels, relative=relative).problem


def ordinary(chosen: Problem, seed: int) -> Tensor:
    """Unknowns of a surface that could be photographed: away from bounds, no facet steeper than 35 degrees or so."""
    generator = torch.Generator().manual_seed(seed)
    parts = []
    for name in chosen.free:
        upper = min(chosen.domain(name).upper, 0.6)
        uniform = torch.rand(chosen.count(name), generator=generator, dtype=torch.float64)
        parts.append((0.2 + 0.75 * uniform) * upper)
    return torch.cat(parts)


def information(size: int, seed: int, condition: float = 100.0) -> Tensor:
    """A random positive definite matrix with badly scaled rows, of the given condition number before scaling."""
    generator = torch.Generator().manual_seed(seed)
    rotation = torch.linalg.qr(torch.randn(size, size, generator=generator, dtype=torch.float64)).Q
    values = torch.logspace(0, math.log10(condition), size, dtype=torch.float64)
    scale = 10 ** (4 * torch.rand(size, generator=generator, dtype=torch.float64) - 1)
    return scale[:, None] * (rotation @ torch.diag(values) @ rotation.T) * scale[None, :]


def quadratic(matrix: Tensor, optimum: Tensor, unknowns: Tensor, floor: float = 1.0) -> Statistics:
    """Statistics of a linear model whose χ² is `floor` at `optimum` and has curvature `matrix`."""
    offset = optimum - unknowns
    gradient = matrix @ offset
    cost = float(offset @ gradient) + floor
    found = scores(cost=cost, chi2=cost, values=100, squared_signal=1.0, samples=100, evaluated=100)
    return Statistics(torch.zeros(1).long(), matrix[None], gradient[None], found)
