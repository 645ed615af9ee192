"""Parameters that are held by default, and estimated where the images determine them."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from matest.estimation.specification import Specification, freed
from matest.estimators import Problem, Solution, accumulate
from matest.estimators.covariance import fisher

# A parameter held by default is freed when its predicted relative error is below this.
_WORTH_FREEING = 0.25


def determined_by_images(specification: Specification, solution: Solution, count: int) -> list[str]:
    """Parameters held by default that the images determine.

    Args:
        specification: what was estimated.
        solution: of it, from all samples or from a subsample.
        count: number of all samples; a subsample speaks for them.
    """
    names = specification.default_held
    if not names:
        return []
    wider = freed(specification, names).problem
    unknowns = widened(wider, solution)
    statistics = accumulate(wider, unknowns, solution.tiles, unknowns, solution.residual_scale)
    share = min(statistics.total("samples") / count, 1.0)
    return worth_freeing(wider, names, unknowns, statistics.information / (share * statistics.inflation))


def worth_freeing(wider: Problem, names: Sequence[str], unknowns: Tensor, information: Tensor) -> list[str]:
    """Those of `names` that get a small error bar when all of them are estimated.

    Args:
        wider: the problem in which all of them are free.
        names: parameters held by default.
        unknowns: of `wider` [P].
        information: JᵀWJ there [P, P].
    """
    covariance = fisher(information, torch.ones(wider.size, dtype=torch.bool))
    chosen = []
    for name in names:
        place = wider.where[name]
        std = covariance.std[place] / unknowns[place]
        if bool((std < _WORTH_FREEING).all()) and not bool(covariance.undetermined[place].any()):
            chosen.append(name)
    return chosen


def widened(wider: Problem, solution: Solution) -> Tensor:
    """The unknowns of a problem with more free parameters at the values of a solution."""
    values = solution.problem.values(solution.unknowns)
    return torch.cat([torch.atleast_1d(values[name]).expand(wider.count(name)) for name in wider.free])
