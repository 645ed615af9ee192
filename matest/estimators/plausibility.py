"""Which of several solutions is the best, and how far two solutions are apart."""

from __future__ import annotations

import torch
from torch import Tensor

from matest.estimators.levenberg_marquardt import Solution

# χ². Solutions along a valley of the likelihood differ by less: the samples cannot tell them apart.
EQUAL_CHI2 = 0.1
# Share of a domain. An unknown this near an end counts as at it: Fresnel's reflectance is the same for all f0 that near
# to 1.
_END_MARGIN = 1e-4


def distance(solution: Solution, other: Solution) -> float:
    """The distance between two solutions of a problem, in standard errors of the first."""
    return length_of(other.unknowns - solution.unknowns, solution)


def length_of(change: Tensor, solution: Solution) -> float:
    """The length of a change of u [P] in standard errors of a solution, jointly."""
    statistics = solution.statistics
    return float((change @ statistics.information @ change / statistics.inflation).clamp(min=0)) ** 0.5


def separation(one: Solution, other: Solution) -> float:
    """The larger of the distances by the standard errors of either: one may lie where the model is flat."""
    return max(distance(one, other), distance(other, one))


def implausibility(solution: Solution) -> float:
    """The cost that solutions with different outliers are compared by: an outlier counts as one just rejected."""
    return solution.statistics.cost + solution.statistics.total("rejected")


def most_plausible(solutions: list[Solution]) -> Solution:
    """The best of several solutions; of those that the data cannot tell apart the one with the fewest at an end."""
    best = min(solutions, key=implausibility)
    margin = EQUAL_CHI2 * best.residual_scale.typical**2
    rivals = [solution for solution in solutions if implausibility(solution) - implausibility(best) < margin]
    return min(rivals, key=count_at_ends)


def count_at_ends(solution: Solution) -> int:
    """How many unknowns lie at an end of their domain, or so near that a model may no longer depend on them."""
    problem, unknowns = solution.problem, solution.unknowns
    width = problem.upper - problem.lower
    margin = _END_MARGIN * torch.where(torch.isfinite(width), width, 0.0)
    return int(((unknowns <= problem.lower + margin) | (unknowns >= problem.upper - margin)).sum())
