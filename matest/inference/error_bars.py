"""Covariance of a solution: by the Fisher information where the model holds, by the jackknife where it does not."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import torch
from torch import Tensor

from matest.estimators import Problem, Solution, Statistics, at_bound, bounded_step
from matest.estimators.covariance import Covariance, correlation_of_residuals, fisher, jackknife
from matest.inference.budget import Budget
from matest.inference.expansion import Expansion
from matest.samples import Samples

# χ² per degree of freedom above which the model does not hold, where the noise is stated and so exact.
_MAX_CHI2_STATED_NOISE = 1.03
# The same where the noise is estimated from the samples, which is right to some per cent.
_MAX_CHI2_ESTIMATED_NOISE = 1.10
# Standard deviations of χ² per value by which chance may raise it above these limits.
_CHI2_BY_CHANCE = 5.0
# Residuals are correlated if the scores of groups scatter this many times as much as those of independent residuals.
_MAX_CORRELATION = 2.0
# Standard deviations of that ratio by which chance may raise it: with few unknowns in few groups it varies much.
_CORRELATION_BY_CHANCE = 5.0
# Standard errors by which the data push an unknown outward. Those that push less do not hold it at its bound.
_MIN_PUSH = 0.1
# Standard errors between a value and a bound that no one can tell apart: two digits of the error, which a value is
# printed to, leave up to as much.
_AT_END = 0.05
# Ratio of the scatter of blocks to that of independent residuals of their images that chance may bring: that of 16
# blocks has a standard deviation of √(2/16), two of which are 0.7.
_BLOCKS_BY_CHANCE = 1.7
# Images that a jackknife needs, no two of them repeats of each other; with fewer it leaves out blocks of pixels, of
# which it needs as many.
_MIN_CLUSTERS = 4


@dataclass(frozen=True, eq=False)
class ErrorBars:
    """Covariance of a solution, and how it was made.

    Attributes:
        covariance: of the unknowns that are not at a bound.
        open: of all unknowns, also those at a bound: the truth of these may lie so far inside the domain.
        bound: whether the data hold an unknown at a bound [P].
        ends: the bound that a value lies on, held there or by chance, to within its standard error's digits; NaN where
            it lies on none [P].
        widening: width of the error bars relative to those by the Fisher information [P].
        chi2: per degree of freedom.
        correlation: of residuals over groups of samples; 1: they are independent.
        holds: whether the model describes the samples to their noise.
        kind: "fisher", "jackknife over images" ("lights" where images repeat each other) or "jackknife over blocks".
        shares: standard errors [P] that the stated errors of each family of the calibration are part of, by name.
    """

    covariance: Covariance
    open: Covariance
    bound: Tensor
    ends: Tensor
    widening: Tensor
    chi2: float
    correlation: float
    holds: bool
    kind: str
    shares: Mapping[str, Tensor] = field(default_factory=dict)

    @property
    def largest_widening(self) -> float:
        return float(self.widening.clamp(min=1.0).max())

    @property
    def reason(self) -> str:
        """Why the model does not hold."""
        if self.correlation > _MAX_CORRELATION and self.chi2 < _MAX_CHI2_ESTIMATED_NOISE:
            times = math.sqrt(self.correlation)
            return f"residuals lean the same way over whole regions, {times:.3g} times as much as by chance"
        return f"residuals are {math.sqrt(self.chi2):.3g} times as large"


def error_bars(
    solution: Solution, samples: Samples, likelihood: bool = True, budget: Budget | None = None
) -> ErrorBars:
    """The error bars of a solution; `likelihood` and `budget` as in `judge`."""
    problem, statistics, expansion = solution.problem, solution.statistics, Expansion.of(solution)
    push = expansion.gradient.abs() / expansion.information.diagonal().clamp(min=1e-300).sqrt()
    # Along a valley that ends at a bound the samples determine nothing: they do not push outward there.
    bound = at_bound(problem, solution.unknowns, statistics.gradient) & (push > _MIN_PUSH)
    free = ~bound | expansion.gauges
    chi2 = statistics.total("chi2") / max(statistics.total("values") - int((~bound).sum()), 1)
    correlation, by_chance = correlation_of_residuals(statistics, fisher(expansion.information, ~bound))
    max_correlation = max(_MAX_CORRELATION, 1 + _CORRELATION_BY_CHANCE * by_chance)
    holds = likelihood and chi2 <= _max_chi2(statistics, samples) and correlation <= max_correlation
    by_setting = statistics.regrouped(samples.groups.setting)
    whole = len(by_setting) >= _MIN_CLUSTERS
    clusters = by_setting if whole else statistics.regrouped(samples.groups.place)
    widening = torch.ones_like(expansion.unknowns)
    if holds or len(clusters) < _MIN_CLUSTERS:
        kind = "fisher"
        covariance, unbounded = fisher(expansion.precision, free), expansion.covariance
    else:
        unit = "lights" if len(by_setting) < len(statistics.regrouped(samples.groups.image)) else "images"
        kind = f"jackknife over {unit if whole else 'blocks'}"
        covariance = _jackknife(expansion, clusters, free, inside=True)
        unbounded = _jackknife(expansion, clusters, torch.ones_like(bound), inside=False)
        if whole:
            blocks, places = (statistics.regrouped(labels) for labels in (samples.groups.block, samples.groups.place))
            if len(blocks) >= _MIN_CLUSTERS:
                # Scores of an unknown at a bound differ from block to block without its being wrong in any.
                scatter = _scatter_of_blocks(expansion, blocks, places, free)
                covariance, unbounded = _plus(covariance, [scatter]), _plus(unbounded, [scatter])
        if problem.nuisances:
            covariance = _within_priors(covariance, fisher(expansion.precision, free), problem)
            unbounded = _within_priors(unbounded, expansion.covariance, problem)
        widening = _widening(expansion, clusters, unbounded)
    nowhere = torch.full_like(expansion.unknowns, math.nan)
    bars = ErrorBars(covariance, unbounded, bound, nowhere, widening, chi2, correlation, holds, kind)
    bars = bars if budget is None else _with_calibration(bars, budget, free)
    return replace(bars, ends=_ends(solution, torch.where(bound, bars.open.std, bars.covariance.std)))


def _ends(solution: Solution, std: Tensor) -> Tensor:
    """The bound that each unknown lies on, given standard errors [P]; NaN where it lies on none [P]."""
    problem, unknowns = solution.problem, solution.unknowns
    ends = torch.full_like(unknowns, math.nan)
    for name, place in problem.where.items():
        if problem.declared(name).periodic:
            # Its search has ends, its values have none.
            continue
        for end in (problem.lower, problem.upper):
            near = (unknowns[place] - end[place]).abs() <= _AT_END * std[place].nan_to_num(0.0, posinf=0.0)
            ends[place] = torch.where(near, end[place], ends[place])
    return ends


def _with_calibration(bars: ErrorBars, budget: Budget, free: Tensor) -> ErrorBars:
    """Error bars with what errors of the calibration add, where some unknowns [P] are not held at a bound."""
    parts, of_all = budget.covariances(free), budget.covariances(torch.ones_like(free))
    covariance, unbounded = bars.covariance, bars.open
    if bars.kind == "fisher":
        covariance, unbounded = _plus(covariance, parts.values()), _plus(unbounded, of_all.values())
    else:
        # The scatter of images holds errors that differ between them already.
        covariance = _plus(covariance, [_beyond(sum(parts.values()), covariance.matrix)])
        unbounded = _plus(unbounded, [_beyond(sum(of_all.values()), unbounded.matrix)])
    growth = (unbounded.std / bars.open.std).nan_to_num(1.0, posinf=1.0)
    return replace(
        bars,
        covariance=covariance,
        open=unbounded,
        widening=bars.widening * growth,
        shares={name: part.diagonal().clamp(min=0).sqrt() for name, part in parts.items()},
    )


def _plus(covariance: Covariance, parts: Iterable[Tensor]) -> Covariance:
    """A covariance with further ones [P, P] of the unknowns that have an error bar."""
    determined = (covariance.matrix.diagonal() > 0).to(covariance.matrix)
    matrix = covariance.matrix
    for part in parts:
        matrix = matrix + part * determined[:, None] * determined
    return replace(covariance, matrix=matrix)


def _scatter_of_blocks(expansion: Expansion, blocks: Statistics, places: Statistics, free: Tensor) -> Tensor:
    """What scores that parts of the object have in common in all images add to the covariance [P, P].

    Leaving out images does not show it: an albedo that varies is in every image. Clusters of two ways add up, less what
    both hold (Cameron, Gelbach & Miller 2011, Journal of Business & Economic Statistics 29, 238, eq. 2.9).

    Args:
        expansion: of χ².
        blocks: clusters by part of the object.
        places: clusters by part of the object and image.
        free: unknowns that are not at a bound [P].
    """
    inverse = fisher(expansion.precision, free).matrix
    moves = [inverse @ clusters.gradient_by_group.T / blocks.inflation for clusters in (blocks, places)]
    of_blocks, of_places = (len(move.T) / (len(move.T) - 1) * move @ move.T for move in moves)
    return _beyond(of_blocks, _BLOCKS_BY_CHANCE * of_places)


def _within_priors(scatter: Covariance, by_information: Covariance, problem: Problem) -> Covariance:
    """A scatter of clusters with what it cannot tell of errors of the calibration.

    Errors that only one cluster has do not scatter: theirs is the error bar by the information. And none are known less
    well than their prior knows them.
    """
    matrix = scatter.matrix + _beyond(by_information.matrix, scatter.matrix)
    for name, spread in problem.spreads.items():
        place = torch.arange(len(matrix))[problem.where[name]]
        loose = place[matrix.diagonal()[place] > spread**2]
        if len(loose):
            own = matrix[loose][:, loose] + spread**2 * torch.eye(len(loose), dtype=matrix.dtype)
            matrix = matrix - matrix[:, loose] @ torch.linalg.solve(own, matrix[loose])
    return replace(scatter, matrix=matrix)


def _beyond(covariance: Tensor | float, other: Tensor) -> Tensor:
    """The part of a covariance [P, P] by which it is larger than another one, none below zero."""
    scale = (covariance + other).diagonal().clamp(min=torch.finfo(other.dtype).tiny).sqrt()
    values, vectors = torch.linalg.eigh((covariance - other) / scale / scale[:, None])
    root = vectors * values.clamp(min=0).sqrt() * scale[:, None]
    return root @ root.T


def _max_chi2(statistics: Statistics, samples: Samples) -> float:
    """χ² per degree of freedom up to which the model holds."""
    limit = _MAX_CHI2_STATED_NOISE if samples.noise_stated else _MAX_CHI2_ESTIMATED_NOISE
    return limit + _CHI2_BY_CHANCE * math.sqrt(2 / max(statistics.total("values"), 1))


def _jackknife(expansion: Expansion, clusters: Statistics, free: Tensor, *, inside: bool) -> Covariance:
    """Covariance from leaving out one cluster at a time.

    It is the scatter of the other unknowns at given gauges, and the uncertainty of the gauges times how far the others
    move with them.

    Args:
        expansion: of χ².
        clusters: are left out in turn.
        free: unknowns that are not at a bound [P].
        inside: whether the other unknowns stay inside their domains.
    """
    gauges = expansion.gauges & free
    others = free & ~gauges
    scatter = jackknife(clusters, others, _step_inside(expansion, gauges) if inside else partial(_step, free=others))
    if not bool(gauges.any()):
        return scatter
    uncertainty = _uncertainty_of_gauges(expansion, clusters, free, gauges)
    moves = -fisher(expansion.information, others).matrix @ expansion.information[:, gauges]
    moves[gauges] = torch.eye(len(uncertainty.matrix), dtype=torch.float64)
    undetermined = scatter.undetermined.clone()
    undetermined[gauges] = uncertainty.undetermined
    return Covariance(scatter.matrix + moves @ uncertainty.matrix @ moves.T, undetermined, scatter.degrees)


def _step_inside(expansion: Expansion, gauges: Tensor) -> Callable[[Tensor, Tensor], Tensor]:
    """Steps of the other unknowns that stay inside their domains, at given gauges."""
    problem = expansion.problem
    pinned = {position: float(expansion.unknowns[position]) for position in gauges.nonzero()[:, 0].tolist()}
    at_gauges = replace(problem, pinned={**problem.pinned, **pinned})
    return partial(bounded_step, at_gauges, expansion.unknowns)


def _step(information: Tensor, gradient: Tensor, free: Tensor) -> Tensor:
    """The step of free unknowns to the minimum of χ², in their domains or not."""
    return fisher(information, free).matrix @ gradient


def _uncertainty_of_gauges(expansion: Expansion, clusters: Statistics, free: Tensor, gauges: Tensor) -> Covariance:
    """Covariance of the gauges, from the scatter of the clusters and from the domains."""
    scatter = jackknife(clusters, free, partial(_step, free=free)).matrix[gauges][:, gauges]
    everything = torch.ones(len(scatter), dtype=torch.bool)
    precision = fisher(scatter, everything).matrix + torch.diag(expansion.prior[gauges])
    return fisher(precision, everything)


def _widening(expansion: Expansion, clusters: Statistics, unbounded: Covariance) -> Tensor:
    """How many times as wide as by the information alone error bars are [P].

    Both are taken by the samples alone, as profiles of χ² are: the domain of a gauge in both would hide a misfit.
    Where the samples alone do not determine an unknown, its domain is included.
    """
    everything = torch.ones(expansion.problem.size, dtype=torch.bool)
    scatter = jackknife(clusters, everything, partial(_step, free=everything))
    by_samples = (scatter.std / fisher(expansion.information, everything).std).nan_to_num(1.0, posinf=1.0)
    return torch.maximum(by_samples, (unbounded.std / expansion.covariance.std).nan_to_num(1.0, posinf=1.0))


def expected_error_bars(expansion: Expansion, budget: Budget | None = None) -> ErrorBars:
    """The error bars of future samples, if the model holds and no unknown lies at a bound; `budget` as in `judge`."""
    size, covariance = expansion.problem.size, expansion.covariance
    nowhere, widening = torch.zeros(size, dtype=torch.bool), torch.ones(size, dtype=torch.float64)
    ends = torch.full((size,), math.nan, dtype=torch.float64)
    bars = ErrorBars(
        covariance, covariance, nowhere, ends, widening, chi2=1.0, correlation=1.0, holds=True, kind="fisher"
    )
    return bars if budget is None else _with_calibration(bars, budget, ~nowhere)
