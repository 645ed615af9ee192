"""χ² to second order about some values of the unknowns: of samples that were fitted, or of ones that are foreseen."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from matest.estimators import Problem, Solution, Statistics
from matest.estimators.covariance import Covariance, fisher


@dataclass(frozen=True, eq=False)
class Expansion:
    """χ²(u + δ) = χ²(u) − 2 gradient · δ + δᵀ information δ, in units of the residuals that there are.

    Residuals larger than the noise make information and gradient smaller.

    A gauge, which stands for the unknown scale of the light, is a nuisance with a bounded domain: what the samples do
    not say of it, the domain does. Where it has no effect it takes nothing from the other unknowns, and how near it is
    to an end of its domain changes little.

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
        return cls.about(solution.problem, solution.unknowns, solution.statistics, solution.statistics.inflation)

    @classmethod
    def about(cls, problem: Problem, unknowns: Tensor, statistics: Statistics, inflation: float) -> Expansion:
        """χ² about u [P], squared residuals being `inflation` times the noise variance; priors stay as they are."""
        information, gradient = statistics.information / inflation, statistics.gradient / inflation
        if statistics.prior is not None:
            rest = 1 - 1 / inflation
            information = information + rest * torch.diag(statistics.prior.precision)
            gradient = gradient + rest * statistics.prior.pull
        return cls(problem, unknowns, information, gradient)

    @cached_property
    def values(self) -> dict[str, Tensor]:
        """Value of every parameter: a scalar, or [C]."""
        return self.problem.values(self.unknowns)

    @cached_property
    def covariance(self) -> Covariance:
        """Of all unknowns together."""
        return fisher(self.precision, torch.ones(self.problem.size, dtype=torch.bool))

    @cached_property
    def gauges(self) -> Tensor:
        """Which unknowns are gauges [P]."""
        gauges = torch.zeros(self.problem.size, dtype=torch.bool)
        for name in self.problem.gauges:
            gauges[self.problem.where[name]] = True
        return gauges

    @cached_property
    def prior(self) -> Tensor:
        """What the domains of gauges say of them [P]: 1 / mean square distance of the places there from the value."""
        width = self.problem.upper - self.problem.lower
        off_centre = self.unknowns - (self.problem.upper + self.problem.lower) / 2
        told = self.gauges & torch.isfinite(width)
        return torch.where(told, 1 / (width.square() / 12 + off_centre.square()), 0.0)

    @cached_property
    def precision(self) -> Tensor:
        """What samples and domains say together [P, P]: the inverse of the covariance."""
        return self.information + torch.diag(self.prior)
