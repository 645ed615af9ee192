"""What stated errors of the calibration, which the fit did not refine, add to the error bars."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from matest.estimators import Problem, Solution, accumulate
from matest.estimators.covariance import fisher
from matest.estimators.statistics import Statistics
from matest.samples import Samples
from matest.samples.tiles import in_memory

# Samples that are enough to say to some per cent how far an estimate moves.
_SAMPLES = 60_000


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
    def of(cls, statistics: Statistics, problem: Problem, spreads: Mapping[str, float], factor: float) -> Budget:
        """From a pass over a part of the samples of a problem with further families at the end.

        Args:
            statistics: of the pass.
            problem: with the families.
            spreads: standard deviation of the errors of these families as a whole.
            factor: by which there are more samples than those.
        """
        information, size = (
            factor * replace(statistics, prior=None).information,
            problem.where[next(iter(spreads))].start,
        )
        own = information[:size, :size]
        if statistics.prior is not None:
            own = own + statistics.prior.precision[:size, :size]
        return cls(
            information=own,
            cross={name: information[:size, problem.where[name]] for name in spreads},
            spreads={name: spread * problem.family(name).spread for name, spread in spreads.items()},
        )

    def covariances(self, free: Tensor) -> dict[str, Tensor]:
        """The covariance [P, P] that each family adds, where some unknowns [P] are free to move."""
        inverse = fisher(self.information, free).matrix
        moves = {name: self.spreads[name] * inverse @ cross for name, cross in self.cross.items()}
        return {name: move @ move.T for name, move in moves.items()}


def budget(solution: Solution, problem: Problem, spreads: Mapping[str, float], samples: Samples, seed: int) -> Budget:
    """How a solution moves with errors of the calibration, from a random part of its samples.

    Args:
        solution: of the fit.
        problem: the solution's, with further families at the end.
        spreads: standard deviation of the errors of these families as a whole.
        samples: that were fitted.
        seed: of the random draw.
    """
    unknowns = torch.cat([solution.unknowns, problem.anywhere[solution.problem.size :]])
    batch = next(iter(samples.batches(_SAMPLES, shuffle=True, seed=seed)))
    statistics = accumulate(problem, unknowns, in_memory([batch]), unknowns, solution.residual_scale)
    return Budget.of(statistics, problem, spreads, len(samples) / len(batch))
