"""Statistics at any unknowns from one pass, where the columns of a model depend on no unknown."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from matest.estimators.moments import Moments, with_added_cost
from matest.estimators.statistics import Statistics
from matest.estimators.unknowns import Problem


@dataclass(frozen=True, eq=False)
class ColumnStatistics:
    """Moments of the columns, group by group, from which the statistics at any coefficients follow.

    Attributes:
        origin: coefficients [C, K] that the residuals belong to.
        exposure: of every image there [I]; None: 1 throughout.
        moments: of every group.
    """

    origin: Tensor
    exposure: Tensor | None
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
        images = problem.groups.image[moments.labels] if problem.exposures else None
        exposure = _group_exposure(problem.exposure(unknowns), images)
        change = exposure * coefficients - _group_exposure(self.exposure, images) * self.origin
        rise = (moments.gram @ change[..., None])[..., 0]
        # Derivatives of the coefficients by the unknowns that a group touches, [1 or B, C, K, Q].
        slopes = exposure[..., None] * (slopes @ problem.selectors)
        if images is not None:
            by_exposure = coefficients[..., None].expand(len(images), -1, -1, len(problem.exposures))
            slopes = torch.cat([slopes.expand(len(images), -1, -1, -1), by_exposure], dim=-1)
        return Statistics(
            labels=moments.labels,
            informations=(slopes.mT @ moments.gram @ slopes).sum(1),
            gradients=(slopes.mT @ (moments.moment - rise)[..., None]).sum(1)[..., 0],
            scores=with_added_cost(moments.scores, (change * (rise - 2 * moments.moment)).sum((1, 2))),
            places=None if images is None else problem.places(images),
            prior=problem.prior_terms(unknowns),
            unknowns=problem.size,
        )


def _group_exposure(exposure: Tensor | None, images: Tensor | None) -> Tensor:
    """Factor on the radiance of every group [1 or B, 1, 1]."""
    if exposure is None or images is None:
        return torch.ones(1, 1, 1, dtype=torch.float64)
    return exposure[images][:, None, None]
