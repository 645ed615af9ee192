"""Statistics at any unknowns from one pass, where the columns of a model depend on no unknown."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from matest.estimators.blocks import Multiplier
from matest.estimators.moments import Moments, with_added_cost
from matest.estimators.statistics import Statistics
from matest.estimators.unknowns import Problem


@dataclass(frozen=True, eq=False)
class ColumnStatistics:
    """Moments of the columns, group by group, from which the statistics at any coefficients follow.

    Attributes:
        origin: coefficients [C, K] that the residuals belong to.
        multiplier: of the radiance of each group there; None: 1 throughout.
        moments: of every group.
    """

    origin: Tensor
    multiplier: Multiplier | None
    moments: Moments

    def statistics(self, problem: Problem, unknowns: Tensor, coefficients: Tensor, slopes: Tensor) -> Statistics:
        """The statistics that a pass at u [P] would give; only the squared residual stays that at the origin.

        Args:
            problem: what is estimated.
            unknowns: u [P].
            coefficients: of the columns in the radiance [C, K] there.
            slopes: their derivatives by every free parameter of a channel [C, K, Q].
        """
        moments = self.moments
        multiplier = problem.multiplied(unknowns)
        factor = _factor(multiplier, moments.labels)
        change = factor * coefficients - _factor(self.multiplier, moments.labels) * self.origin
        rise = (moments.gram @ change[..., None])[..., 0]
        # Derivatives of the coefficients by the unknowns that a group touches, [1 or B, C, K, Q].
        slopes = factor[..., None] * (slopes @ problem.selectors)
        if multiplier is not None:
            by_multiplier = coefficients[..., None] * multiplier.slopes[moments.labels][:, None, None]
            slopes = torch.cat([slopes, by_multiplier], dim=-1)
        return Statistics(
            labels=moments.labels,
            informations=(slopes.mT @ moments.gram @ slopes).sum(1),
            gradients=(slopes.mT @ (moments.moment - rise)[..., None]).sum(1)[..., 0],
            scores=with_added_cost(moments.scores, (change * (rise - 2 * moments.moment)).sum((1, 2))),
            places=None if multiplier is None else problem.places[moments.labels],
            prior=problem.prior_terms(unknowns),
            unknowns=problem.size,
        )


def _factor(multiplier: Multiplier | None, groups: Tensor) -> Tensor:
    """What multiplies the radiance of the groups of these labels [B], for [B, C, K]; [1, 1, 1] where nothing does."""
    if multiplier is None:
        return torch.ones(1, 1, 1, dtype=torch.float64)
    return multiplier.value[groups][:, None, None]
