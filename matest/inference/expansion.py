"""χ² to second order about some values of the unknowns: of samples that were fitted, or of ones that are foreseen."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from matest.estimators import Problem, Solution
from matest.estimators.covariance import Covariance, fisher


@dataclass(frozen=True, eq=False)
class Expansion:
    """χ²(u + δ) = χ²(u) − 2 gradient · δ + δᵀ information δ, in units of the residuals that there are.

    Residuals larger than the noise make information and gradient smaller.

    Attributes:
        problem: what the unknowns are.
        unknowns: u [P].
        information: JᵀWJ [P, P].
        gradient: JᵀWr [P].
    """

    problem: Problem
    unknowns: Tensor
    information: Tensor
    gradient: Tensor

    @classmethod
    def of(cls, solution: Solution) -> Expansion:
        """χ² about a solution."""
        statistics = solution.statistics
        unit = statistics.inflation
        return cls(solution.problem, solution.unknowns, statistics.information / unit, statistics.gradient / unit)

    @cached_property
    def values(self) -> dict[str, Tensor]:
        """Value of every parameter: a scalar, or [C]."""
        return self.problem.values(self.unknowns)

    @cached_property
    def covariance(self) -> Covariance:
        """Of all unknowns together, by the information alone."""
        return fisher(self.information, torch.ones(self.problem.size, dtype=torch.bool))
