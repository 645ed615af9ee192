"""Error bars of a solution."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import torch
from torch import Tensor

from matest.estimators import Solution, at_bound, bounded_step
from matest.estimators.covariance import Covariance, correlation_of_residuals, fisher, jackknife
from matest.samples import Samples

# Reduced χ² above this says that the model does not hold: stated noise is exact, noise estimated from the pictures
# is known to some per cent.
_HOLDS_STATED, _HOLDS_ESTIMATED = 1.03, 1.10
# Scores of blocks of pixels that scatter this many times as much as independent residuals' do: not independent.
_CORRELATED = 2.0
# With few parameters in few blocks chance does that too: so many times its standard deviation.
_BY_CHANCE = 5.0
# An unknown at an end of its domain is held there by the data if they push by so many standard errors.
_PUSHED = 0.1
# With fewer images, blocks of pixels serve as clusters; with fewer of those, there is nothing to leave out.
_MIN_CLUSTERS = 4


@dataclass(frozen=True)
class ErrorBars:
    """Error bars of a solution.

    Attributes:
        covariance: with parameters at a bound left out.
        open: the same with them let free: how far inside the domain the truth may lie.
        bound: unknowns at a bound [P].
        chi2: per degree of freedom.
        correlation: of residuals over blocks of pixels: 1 if they are independent.
        holds: whether the model describes the images to their noise.
        kind: what the error bars rest on.
        flat: for unknowns at a lower bound where the model is flat in them to first order, about how far inside the
            domain the truth may lie.
        intervals: of 95 %, of the unknowns at or near a bound and along valleys that bend.
        locked: positions of unknowns that move with one that the images say nothing of where it stands.
        bent: positions of unknowns along a valley of the likelihood that bends within their standard errors.
    """

    covariance: Covariance
    open: Covariance
    bound: Tensor
    chi2: float
    correlation: float
    holds: bool
    kind: str
    flat: dict[int, float] = field(default_factory=dict)
    intervals: dict[int, tuple[float, float]] = field(default_factory=dict)
    locked: frozenset[int] = frozenset()
    bent: frozenset[int] = frozenset()

    @property
    def reason(self) -> str:
        """Why the model does not hold."""
        if self.correlation > _CORRELATED and self.chi2 < _HOLDS_ESTIMATED:
            times = math.sqrt(self.correlation)
            return f"residuals lean the same way over whole regions, {times:.3g} times as much as by chance"
        return f"residuals are {math.sqrt(self.chi2):.3g} times as large"


def error_bars(solution: Solution, samples: Samples) -> ErrorBars:
    """Error bars of a solution: Fisher's where the model holds, jackknifed ones where it does not."""
    problem, statistics = solution.problem, solution.statistics
    scale = statistics.inflation
    push = statistics.gradient.abs() / (statistics.information.diagonal() * scale).clamp(min=1e-300).sqrt()
    # A valley that ends at a bound does not push: what lies along it is not determined there either.
    bound = at_bound(problem, solution.unknowns, statistics.gradient) & (push > _PUSHED)
    everything = torch.ones_like(bound)
    chi2 = statistics.total("chi2") / max(statistics.total("values") - int((~bound).sum()), 1)
    closed, opened = (fisher(statistics.information / scale, free) for free in (~bound, everything))
    correlation, by_chance = correlation_of_residuals(statistics, closed)
    allowed = (_HOLDS_STATED if samples.noise_stated else _HOLDS_ESTIMATED) + 5 * math.sqrt(
        2 / max(statistics.total("values"), 1)
    )
    holds = chi2 <= allowed and correlation <= max(_CORRELATED, 1 + _BY_CHANCE * by_chance)
    by_image = statistics.regrouped(samples.groups.image)
    clusters = by_image if len(by_image) >= _MIN_CLUSTERS else statistics
    if holds or len(clusters) < _MIN_CLUSTERS:
        return ErrorBars(closed, opened, bound, chi2, correlation, holds, "fisher")

    def inside(information: Tensor, gradient: Tensor) -> Tensor:
        return bounded_step(problem, solution.unknowns, information, gradient)

    def anywhere(information: Tensor, gradient: Tensor) -> Tensor:
        return fisher(information, everything).matrix @ gradient

    return ErrorBars(
        jackknife(clusters, ~bound, inside),
        jackknife(clusters, everything, anywhere),
        bound,
        chi2,
        correlation,
        holds,
        "jackknife over images" if clusters is by_image else "jackknife over blocks",
    )
