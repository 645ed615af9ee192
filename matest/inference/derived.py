"""Derived quantities: functions of several parameters, and what stands for a parameter of which only these are seen."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import torch
from torch import Tensor

from matest.estimators import Problem
from matest.estimators.covariance import error_of, quantile95
from matest.inference.error_bars import ErrorBars
from matest.inference.expansion import Expansion
from matest.inference.quantities import ParameterEstimate

# A derived quantity with a larger relative standard error is not determined.
_LARGEST_RELATIVE_ERROR = 0.5


def with_derived(
    expansion: Expansion, bars: ErrorBars, estimates: Mapping[str, ParameterEstimate]
) -> dict[str, ParameterEstimate]:
    """The estimates, with the derived quantities of the model; parameters that only these show are lost."""
    problem, out = expansion.problem, dict(estimates)
    derived = {label: _derived(expansion, bars, label, estimates) for label in problem.brdf.derived}
    for names in problem.brdf.structure.derived.values():
        if {*names} & {*problem.arbitrary} and {*names} & {*problem.where}:
            for name in names:
                out[name] = replace(out[name], value=None, std=None, interval95=None, status="not determined")
    return out | derived


def _derived(
    expansion: Expansion, bars: ErrorBars, label: str, estimates: Mapping[str, ParameterEstimate]
) -> ParameterEstimate:
    """A derived quantity, with its error bar to first order in the unknowns that it depends on."""
    problem = expansion.problem
    quantity, names = problem.brdf.derived[label], problem.brdf.structure.derived[label]
    values = {name: expansion.values[name] for name in names}
    value, slopes = float(quantity.value(values)), quantity.slopes(values)
    sources = {name: problem.ties.get(name, name) for name in names}
    free = {source for source in sources.values() if source in problem.where}
    if not free:
        return ParameterEstimate(value, None, None, quantity.unit, "fixed", quantity.doc)
    if len(free) == 1:
        moving = [name for name in names if sources[name] in free]
        estimate = estimates[moving[0]]
        if estimate.value is None:
            return ParameterEstimate(None, None, None, quantity.unit, estimate.status, quantity.doc)
        slope = abs(sum(slopes[name] for name in moving))
        std = None if estimate.std is None else slope * float(estimate.std)  # type: ignore[arg-type]
        # A function of one unknown takes the ends of its interval along.
        at_ends = [
            values | {name: torch.tensor(end, dtype=torch.float64) for name in moving} for end in estimate.interval95
        ]
        ends = sorted(float(quantity.value(there)) for there in at_ends)
        return ParameterEstimate(value, std, ends, quantity.unit, estimate.status, quantity.doc)
    relative = torch.zeros(problem.size, dtype=torch.float64)
    for name, source in sources.items():
        if source in problem.where:
            relative[problem.where[source].start] += slopes[name] / value
    error = error_of(expansion.precision, relative)
    if error is None or error > _LARGEST_RELATIVE_ERROR:
        return ParameterEstimate(None, None, None, quantity.unit, "not determined", quantity.doc)
    std = abs(value) * error * bars.largest_widening
    reach = quantile95(bars.covariance.degrees) * std
    interval = [max(value - reach, 0.0), value + reach]
    return ParameterEstimate(value, std, interval, quantity.unit, "determined", quantity.doc)


def reported_labels(problem: Problem) -> list[str]:
    """A name for every row of `reported_correlation`."""
    return [reported_name(problem, label) for label in problem.labels]


def reported_correlation(expansion: Expansion, bars: ErrorBars) -> list[list[float]]:
    """Correlation of the estimates; a parameter of which only a derived quantity is known stands for that."""
    signs = [_direction(expansion.problem, label, expansion.values) for label in expansion.problem.labels]
    sign = torch.tensor(signs)
    return (bars.covariance.correlation * sign[:, None] * sign[None, :]).tolist()


def _direction(problem: Problem, name: str, values: Mapping[str, Tensor]) -> float:
    """Whether what is reported of a parameter grows (1) or falls (−1) with it."""
    quantity = problem.quantity(name)
    if quantity is None:
        return 1.0
    names = problem.brdf.structure.derived[quantity.name]
    return math.copysign(1.0, quantity.slopes({key: values[key] for key in names})[name])


def reported_name(problem: Problem, name: str) -> str:
    """The name under which what is known of a parameter is reported: its own, or that of a derived quantity."""
    quantity = problem.quantity(name)
    return name if quantity is None else quantity.name


def known_by_derived(problem: Problem, name: str) -> bool:
    """Whether only a quantity derived from a parameter and others has an effect."""
    return name in problem.arbitrary or problem.quantity(name) is not None
