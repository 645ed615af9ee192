"""Covariance of a solution: by the Fisher information where the model holds, by the jackknife where it does not."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import torch
from torch import Tensor

from matest.estimators import Solution, Statistics, at_bound, bounded_step
from matest.estimators.covariance import Covariance, correlation_of_residuals, fisher, jackknife
from matest.inference.expansion import Expansion
from matest.samples import Samples

# χ² per degree of freedom above which the model does not hold, where the noise is stated: that is exact.
_HOLDS_STATED = 1.03
# The same where noise was estimated from the samples: it is known to some per cent.
_HOLDS_ESTIMATED = 1.10
# Both are passed by chance: allow so many standard deviations of χ² per value.
_CHI2_BY_CHANCE = 5.0
# Scores of groups that scatter this many times as much as independent residuals' do are not independent.
_CORRELATED = 2.0
# With few unknowns in few groups chance does that too: allow so many of its standard deviations.
_CORRELATION_BY_CHANCE = 5.0
# The data hold an unknown at an end of its domain if they push by so many standard errors.
_PUSHED = 0.1
# With fewer images, their blocks serve as clusters of the jackknife; with fewer blocks, there is nothing to leave out.
_MIN_CLUSTERS = 4


@dataclass(frozen=True, eq=False)
class ErrorBars:
    """Covariance of a solution, and what it rests on.

    Attributes:
        covariance: with unknowns at a bound left out.
        open: the same with them let free: how far inside the domain the truth may lie.
        bound: unknowns that the data hold at a bound [P].
        widening: how many times as wide as by the information alone error bars are [P].
        chi2: per degree of freedom.
        correlation: of residuals over groups of samples: 1 if they are independent.
        holds: whether the model describes the samples to their noise.
        kind: "fisher", "jackknife over images" or "jackknife over blocks".
    """

    covariance: Covariance
    open: Covariance
    bound: Tensor
    widening: Tensor
    chi2: float
    correlation: float
    holds: bool
    kind: str

    @property
    def largest_widening(self) -> float:
        return float(self.widening.clamp(min=1.0).max())

    @property
    def reason(self) -> str:
        """Why the model does not hold."""
        if self.correlation > _CORRELATED and self.chi2 < _HOLDS_ESTIMATED:
            times = math.sqrt(self.correlation)
            return f"residuals lean the same way over whole regions, {times:.3g} times as much as by chance"
        return f"residuals are {math.sqrt(self.chi2):.3g} times as large"


def error_bars(solution: Solution, samples: Samples) -> ErrorBars:
    """The error bars of a solution."""
    problem, statistics, expansion = solution.problem, solution.statistics, Expansion.of(solution)
    push = expansion.gradient.abs() / expansion.information.diagonal().clamp(min=1e-300).sqrt()
    # A valley that ends at a bound does not push: what lies along it is not determined there either.
    bound = at_bound(problem, solution.unknowns, statistics.gradient) & (push > _PUSHED)
    free = ~bound | expansion.gauges
    closed, opened = fisher(expansion.precision, free), expansion.covariance
    values = max(statistics.total("values"), 1)
    chi2 = statistics.total("chi2") / max(statistics.total("values") - int((~bound).sum()), 1)
    correlation, by_chance = correlation_of_residuals(statistics, fisher(expansion.information, ~bound))
    allowed = (_HOLDS_STATED if samples.noise_stated else _HOLDS_ESTIMATED) + _CHI2_BY_CHANCE * math.sqrt(2 / values)
    holds = chi2 <= allowed and correlation <= max(_CORRELATED, 1 + _CORRELATION_BY_CHANCE * by_chance)
    by_image = statistics.regrouped(samples.groups.image)
    clusters = by_image if len(by_image) >= _MIN_CLUSTERS else statistics
    kind = "fisher"
    if not holds and len(clusters) >= _MIN_CLUSTERS:
        kind = "jackknife over images" if clusters is by_image else "jackknife over blocks"
        closed = _jackknife(expansion, clusters, free, inside=True)
        opened = _jackknife(expansion, clusters, torch.ones_like(bound), inside=False)
    widening = (opened.std / expansion.covariance.std).nan_to_num(1.0, posinf=1.0)
    return ErrorBars(closed, opened, bound, widening, chi2, correlation, holds, kind)


def _jackknife(expansion: Expansion, clusters: Statistics, free: Tensor, *, inside: bool) -> Covariance:
    """Covariance from leaving out clusters.

    That of the others at given gauges is as they scatter; what is not known of the gauges adds to it in proportion to
    how the others move with them.

    Args:
        expansion: of χ².
        clusters: what is left out in turn.
        free: unknowns that are not at a bound [P].
        inside: whether the others stay inside their domains.
    """
    problem, gauges = expansion.problem, expansion.gauges & free
    pinned = {position: float(expansion.unknowns[position]) for position in gauges.nonzero()[:, 0].tolist()}
    given = replace(problem, pinned={**problem.pinned, **pinned})

    def step(information: Tensor, gradient: Tensor) -> Tensor:
        return bounded_step(given, expansion.unknowns, information, gradient)

    def anywhere(information: Tensor, gradient: Tensor, among: Tensor) -> Tensor:
        return fisher(information, among).matrix @ gradient

    others = free & ~gauges
    scatter = jackknife(clusters, others, step if inside else partial(anywhere, among=others))
    if not pinned:
        return scatter
    known = jackknife(clusters, free, partial(anywhere, among=free)).matrix[gauges][:, gauges]
    everything = torch.ones(len(pinned), dtype=torch.bool)
    told = fisher(known, everything).matrix + torch.diag(expansion.prior[gauges])
    unsure = fisher(told, everything)
    moves = -fisher(expansion.information, others).matrix @ expansion.information[:, gauges]
    moves[gauges] = torch.eye(len(pinned), dtype=torch.float64)
    undetermined = scatter.undetermined.clone()
    undetermined[gauges] = unsure.undetermined
    return Covariance(scatter.matrix + moves @ unsure.matrix @ moves.T, undetermined, scatter.degrees)


def expected_error_bars(expansion: Expansion) -> ErrorBars:
    """The error bars of samples that have not been taken: the model will hold, and nothing will lie at a bound."""
    none = torch.zeros(expansion.problem.size, dtype=torch.bool)
    covariance = expansion.covariance
    return ErrorBars(covariance, covariance, none, torch.ones(len(none)).double(), 1.0, 1.0, True, "fisher")
