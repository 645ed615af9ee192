"""What stated errors of the calibration, which the fit did not refine, add to the error bars."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from matest.estimators import Problem, Solution, accumulate
from matest.estimators.covariance import fisher
from matest.estimators.statistics import Statistics


@dataclass(frozen=True, eq=False)
class Budget:
    """The estimate moves with errors of the calibration, to first order.

    A fit of weight W to samples that err by N ν moves by A⁻¹ JᵀW N ν, where A = JᵀWJ.

    Attributes:
        information: A, with the precision of priors [P, P].
        cross: JᵀWN for the unknowns of each family, by name [P, k].
        spreads: standard deviation of each unknown of each family, by name.
    """

    information: Tensor
    cross: Mapping[str, Tensor]
    spreads: Mapping[str, float]

    @classmethod
    def of(cls, statistics: Statistics, problem: Problem, names: Mapping[str, float]) -> Budget:
        """From a pass over the samples of a problem with further families at the end.

        Args:
            statistics: of the pass.
            problem: with the families.
            names: the families that were not refined, with the standard deviation of their errors as a whole.
        """
        information, size = statistics.information, problem.where[next(iter(names))].start
        return cls(
            information=information[:size, :size],
            cross={name: information[:size, problem.where[name]] for name in names},
            spreads={name: spread * problem.family(name).spread for name, spread in names.items()},
        )

    def covariances(self, free: Tensor) -> dict[str, Tensor]:
        """The covariance [P, P] that each family adds, where some unknowns [P] are free to move."""
        inverse = fisher(self.information, free).matrix
        moves = {name: self.spreads[name] * inverse @ cross for name, cross in self.cross.items()}
        return {name: move @ move.T for name, move in moves.items()}


def budget(solution: Solution, problem: Problem, names: Mapping[str, float]) -> Budget:
    """How a solution moves with errors of the calibration: one pass over its samples.

    Args:
        solution: of the fit.
        problem: the solution's, with further families at the end.
        names: these families, with the standard deviation of their errors as a whole.
    """
    unknowns = torch.cat([solution.unknowns, problem.anywhere[solution.problem.size :]])
    statistics = accumulate(problem, unknowns, solution.tiles, unknowns, solution.residual_scale)
    return Budget.of(statistics, problem, names)
