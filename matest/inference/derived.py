"""Derived quantities: functions of several parameters, which stand for parameters that only show in them."""

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

# Relative standard error above which a derived quantity is not determined: the same as for parameters over decades.
_LARGEST_RELATIVE_ERROR = 0.5


def with_derived(
    expansion: Expansion, bars: ErrorBars, estimates: Mapping[str, ParameterEstimate]
) -> dict[str, ParameterEstimate]:
    """The estimates and the derived quantities of the model; parameters that only show in these are not determined."""
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
    """The estimate of a derived quantity."""
    problem = expansion.problem
    names = problem.brdf.structure.derived[label]
    free = {source for name in names if (source := problem.ties.get(name, name)) in problem.where}
    if not free:
        quantity = problem.brdf.derived[label]
        value = float(quantity.value({name: expansion.values[name] for name in names}))
        return ParameterEstimate(value, None, None, quantity.unit, "fixed", quantity.doc)
    if len(free) == 1:
        return _of_one_unknown(expansion, label, estimates, *free)
    return _of_several_unknowns(expansion, bars, label)


def _of_one_unknown(
    expansion: Expansion, label: str, estimates: Mapping[str, ParameterEstimate], unknown: str
) -> ParameterEstimate:
    """A derived quantity that depends on one unknown: it maps the ends of that one's interval."""
    problem = expansion.problem
    quantity, names = problem.brdf.derived[label], problem.brdf.structure.derived[label]
    values = {name: expansion.values[name] for name in names}
    moving = [name for name in names if problem.ties.get(name, name) == unknown]
    estimate = estimates[moving[0]]
    if estimate.value is None:
        return ParameterEstimate(None, None, None, quantity.unit, estimate.status, quantity.doc)
    slopes = quantity.slopes(values)
    slope = abs(sum(slopes[name] for name in moving))
    std = None if estimate.std is None else slope * float(estimate.std)  # type: ignore[arg-type]
    at_ends = [
        values | {name: torch.tensor(end, dtype=torch.float64) for name in moving} for end in estimate.interval95
    ]
    interval = sorted(float(quantity.value(at_end)) for at_end in at_ends)
    value = float(quantity.value(values))
    return ParameterEstimate(value, std, interval, quantity.unit, estimate.status, quantity.doc)


def _of_several_unknowns(expansion: Expansion, bars: ErrorBars, label: str) -> ParameterEstimate:
    """A derived quantity that depends on several unknowns, with its error bar by the delta method."""
    problem = expansion.problem
    quantity, names = problem.brdf.derived[label], problem.brdf.structure.derived[label]
    values = {name: expansion.values[name] for name in names}
    value, slopes = float(quantity.value(values)), quantity.slopes(values)
    relative_slopes = torch.zeros(problem.size, dtype=torch.float64)
    for name in names:
        source = problem.ties.get(name, name)
        if source in problem.where:
            relative_slopes[problem.where[source].start] += slopes[name] / value
    error = error_of(expansion.precision, relative_slopes)
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
    """Correlation of the estimates; a derived quantity takes the row of the parameter that only shows in it."""
    signs = [_direction(expansion.problem, label, expansion.values) for label in expansion.problem.labels]
    sign = torch.tensor(signs)
    return (bars.covariance.correlation * sign[:, None] * sign[None, :]).tolist()


def _direction(problem: Problem, name: str, values: Mapping[str, Tensor]) -> float:
    """Whether the reported quantity grows (1) or falls (−1) with its parameter."""
    quantity = problem.quantity(name)
    if quantity is None:
        return 1.0
    names = problem.brdf.structure.derived[quantity.name]
    return math.copysign(1.0, quantity.slopes({key: values[key] for key in names})[name])


def reported_name(problem: Problem, name: str) -> str:
    """The name under which a parameter is reported: its own, or that of the derived quantity that stands for it."""
    quantity = problem.quantity(name)
    return name if quantity is None else quantity.name


def known_by_derived(problem: Problem, name: str) -> bool:
    """Whether a parameter only has an effect through a quantity derived from it and others."""
    return name in problem.arbitrary or problem.quantity(name) is not None
