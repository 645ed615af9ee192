"""The posterior: what samples say of every unknown, built once and only read afterwards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import torch

from matest.estimators import Problem, Solution
from matest.estimators.covariance import quantile95
from matest.inference.budget import Budget
from matest.inference.derived import reported_correlation, reported_labels, reported_name, with_derived
from matest.inference.error_bars import ErrorBars, error_bars, expected_error_bars
from matest.inference.expansion import Expansion
from matest.inference.intervals import Intervals, profile_intervals
from matest.inference.lobes import LobesNotSeen, lobes_not_seen
from matest.inference.profiles import Surroundings, surroundings
from matest.inference.quantities import ParameterEstimate
from matest.inference.statuses import Verdict, combined, verdicts_on
from matest.inference.valleys import Valleys, valleys_about
from matest.parameters import Role
from matest.samples import Samples
from matest.workers import single_threaded_torch


@dataclass(frozen=True, eq=False)
class Posterior:
    """What samples say of every unknown.

    Attributes:
        problem: names what was estimated.
        bars: covariance, χ², whether the model holds, and the kind of error bars.
        lobes: lobes that are not seen.
        valleys: unknowns, by position, for which the covariance is wrong.
        estimates: of every parameter and derived quantity, by name.
        labels: names of the rows of `correlation`.
        correlation: of the estimates, [P][P].
        seen_together: reported names of parameters of which the samples see only combinations.
        nuisance: estimates of the blocks of the calibration, one number an image, light, group or error of a family.
    """

    problem: Problem
    bars: ErrorBars
    lobes: LobesNotSeen
    valleys: Valleys
    estimates: Mapping[str, ParameterEstimate]
    labels: Sequence[str]
    correlation: Sequence[Sequence[float]]
    seen_together: frozenset[str]
    nuisance: Mapping[str, ParameterEstimate]

    @property
    def not_determined(self) -> list[str]:
        """Reported names of the free parameters that are not determined."""
        names = [reported_name(self.problem, name) for name in self.problem.free]
        return [name for name in names if self.estimates[name].status == "not determined"]


@single_threaded_torch()
def judge(solution: Solution, samples: Samples, *, likelihood: bool = True, budget: Budget | None = None) -> Posterior:
    """What samples say of the unknowns of their solution.

    Args:
        solution: of the fit.
        samples: that were fitted.
        likelihood: whether the fit maximised one; after another cost error bars come from leaving out groups.
        budget: how the solution moves with errors of the calibration; None: there are none.

    With errors of the calibration among the unknowns, intervals are to first order.
    """

    @cache
    def around() -> Surroundings:
        return surroundings(solution.problem, solution.unknowns, solution.tiles, solution.residual_scale)

    expansion, bars = Expansion.of(solution), error_bars(solution, samples, likelihood, budget)
    if solution.problem.nuisances:
        # Profiles would refit all errors of the calibration at every value.
        return _to_first_order(expansion, bars)
    lobes = lobes_not_seen(expansion, bars)
    valleys = valleys_about(solution, bars, lobes, around)
    first_order = verdicts_on(expansion, bars, lobes, valleys, Intervals())
    not_determined = {position for position, verdict in enumerate(first_order) if verdict.value is None}
    intervals = profile_intervals(expansion, bars, lobes, valleys, around, not_determined)
    return _posterior(expansion, bars, lobes, valleys, intervals)


@single_threaded_torch()
def judge_to_first_order(solution: Solution, samples: Samples, *, budget: Budget | None = None) -> Posterior:
    """The same by the covariance at the optimum alone: symmetric intervals, no valleys."""
    return _to_first_order(Expansion.of(solution), error_bars(solution, samples, budget=budget))


def foresee(expansion: Expansion, budget: Budget | None = None) -> Posterior:
    """What future samples will say, to first order; `budget` as in `judge`."""
    return _to_first_order(expansion, expected_error_bars(expansion, budget))


def _to_first_order(expansion: Expansion, bars: ErrorBars) -> Posterior:
    return _posterior(expansion, bars, lobes_not_seen(expansion, bars), Valleys(), Intervals())


def _posterior(
    expansion: Expansion, bars: ErrorBars, lobes: LobesNotSeen, valleys: Valleys, intervals: Intervals
) -> Posterior:
    verdicts = verdicts_on(expansion, bars, lobes, valleys, intervals)
    return Posterior(
        problem=expansion.problem,
        bars=bars,
        lobes=lobes,
        valleys=valleys,
        estimates=with_derived(expansion, bars, _estimates(expansion, verdicts)),
        labels=reported_labels(expansion.problem),
        correlation=reported_correlation(expansion, bars),
        seen_together=_seen_together(expansion, bars, valleys, intervals),
        nuisance=_nuisance(expansion, bars, verdicts),
    )


def _estimates(expansion: Expansion, verdicts: Sequence[Verdict]) -> dict[str, ParameterEstimate]:
    """Every parameter of the model: estimated, tied or fixed."""
    problem, out = expansion.problem, {}
    for name, declared in problem.brdf.declared.items():
        source = problem.ties.get(name, name)
        value = expansion.values[name]
        if source in problem.where:
            estimate = combined(verdicts[problem.where[source]], declared.unit, declared.doc)
            out[name] = replace(estimate, status="tied") if source != name else estimate
        elif declared.role is not Role.GAUGE or float(value) != 1:
            out[name] = ParameterEstimate(value.tolist(), None, None, declared.unit, "fixed", declared.doc)
    return out


def _nuisance(expansion: Expansion, bars: ErrorBars, verdicts: Sequence[Verdict]) -> dict[str, ParameterEstimate]:
    """Every block that is no parameter of the model."""
    problem = expansion.problem
    multipliers = {block.name: problem.declared(block.name) for block in problem.multipliers}
    estimates = {name: combined(verdicts[problem.where[name]], d.unit, d.doc) for name, d in multipliers.items()}
    reach = quantile95(bars.covariance.degrees)
    for block in problem.nuisances:
        place, family = problem.where[block.name], problem.family(block.name)
        values = expansion.unknowns[place]
        # A jackknife leaves out an image together with what is unknown of it alone.
        stds = torch.maximum(bars.open.std, expansion.covariance.std)[place]
        estimates[block.name] = ParameterEstimate(
            values.tolist(),
            stds.tolist(),
            torch.stack([values - reach * stds, values + reach * stds], dim=1).tolist(),
            family.unit,
            "determined",
            family.doc,
        )
    return estimates


def _seen_together(expansion: Expansion, bars: ErrorBars, valleys: Valleys, intervals: Intervals) -> frozenset[str]:
    """Reported names of the parameters of which the samples see only combinations."""
    problem = expansion.problem
    together = bars.covariance.undetermined & (expansion.information.diagonal() > 0)
    together[[*intervals.bent, *valleys.bent, *valleys.locked]] = True
    return frozenset(reported_name(problem, name) for name, place in problem.where.items() if together[place].any())
