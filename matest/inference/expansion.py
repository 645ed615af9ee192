"""χ² to second order about some values of the unknowns, for fitted samples or for future ones."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from matest.estimators import Problem, Solution, Statistics
from matest.estimators.covariance import Covariance, fisher


@dataclass(frozen=True, eq=False)
class Expansion:
    """χ²(u + δ) = χ²(u) − 2 gradient · δ + δᵀ information δ, in units of the variance of the residuals.

    Residuals larger than the noise make information and gradient smaller.

    A gauge stands for the unknown scale of the light. Its bounded domain serves as its prior, so that a gauge without
    effect does not widen the error bars of the other unknowns.

    Attributes:
        problem: names the unknowns.
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
        """χ² about u [P], where squared residuals are `inflation` times the noise variance; priors are not scaled."""
        information, gradient = statistics.information / inflation, statistics.gradient / inflation
        if statistics.prior is not None:
            rest = 1 / problem.inflation - 1 / inflation
            information = information + rest * statistics.prior.precision
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
        """Precision of the gauges by their domains alone [P]: 1 / mean square distance of the domain from the value."""
        width = self.problem.upper - self.problem.lower
        off_centre = self.unknowns - (self.problem.upper + self.problem.lower) / 2
        informative = self.gauges & torch.isfinite(width)
        return torch.where(informative, 1 / (width.square() / 12 + off_centre.square()), 0.0)

    @cached_property
    def precision(self) -> Tensor:
        """Inverse of the covariance, from samples and domains [P, P]."""
        return self.information + torch.diag(self.prior)
