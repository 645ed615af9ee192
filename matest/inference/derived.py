"""Derived quantities: functions of several parameters, some of which have no effect but through them."""

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
from matest.inference.statuses import Verdict

# Relative standard error above which a derived quantity is not determined: the same as for parameters over decades.
_LARGEST_RELATIVE_ERROR = 0.5


def with_derived(
    expansion: Expansion, bars: ErrorBars, estimates: Mapping[str, ParameterEstimate]
) -> dict[str, ParameterEstimate]:
    """The estimates and the derived quantities of the model; parameters that only show in these are not determined."""
    problem, out = expansion.problem, dict(estimates)
    for names in problem.brdf.structure.derived.values():
        if {*names} & {*problem.arbitrary} and {*names} & {*problem.where}:
            for name in names:
                out[name] = replace(out[name], value=None, std=None, interval95=None, status="not determined")
    for label, quantity in problem.brdf.derived.items():
        verdict = _verdict(expansion, bars, label, estimates)
        out[label] = ParameterEstimate(
            verdict.value, verdict.std, verdict.interval, quantity.unit, verdict.status, quantity.doc
        )
    return out


def _verdict(expansion: Expansion, bars: ErrorBars, label: str, estimates: Mapping[str, ParameterEstimate]) -> Verdict:
    """The value of a derived quantity; `estimates` are those of the parameters."""
    problem = expansion.problem
    quantity, names = problem.brdf.derived[label], problem.brdf.structure.derived[label]
    values = {name: expansion.values[name] for name in names}
    value, slopes = float(quantity.value(values)), quantity.slopes(values)
    sources = {name: source for name in names if (source := problem.ties.get(name, name)) in problem.where}
    if not sources:
        return Verdict(value, None, None, "fixed")
    if len({*sources.values()}) == 1:
        # The quantity maps the ends of the unknown's interval.
        estimate = estimates[next(iter(sources))]
        if estimate.value is None:
            return Verdict(None, None, None, estimate.status)
        slope = abs(sum(slopes[name] for name in sources))
        std = slope * estimate.std if isinstance(estimate.std, float) else None
        ends = [torch.tensor(end, dtype=torch.float64) for end in estimate.interval95]
        interval = sorted(float(quantity.value(values | dict.fromkeys(sources, end))) for end in ends)
        return Verdict(value, std, interval, estimate.status)
    relative_slopes = torch.zeros(problem.size, dtype=torch.float64)
    for name, source in sources.items():
        relative_slopes[problem.where[source].start] += slopes[name] / value
    return _by_delta_method(expansion, bars, value, relative_slopes)


def _by_delta_method(expansion: Expansion, bars: ErrorBars, value: float, relative_slopes: Tensor) -> Verdict:
    """The verdict on a derived quantity, by its relative derivatives by the unknowns [P]."""
    error = error_of(expansion.precision, relative_slopes)
    if error is None or error > _LARGEST_RELATIVE_ERROR:
        return Verdict(None, None, None, "not determined")
    std = abs(value) * error * bars.largest_widening
    reach = quantile95(bars.covariance.degrees) * std
    return Verdict(value, std, [max(value - reach, 0.0), value + reach], "determined")


def reported_labels(problem: Problem) -> list[str]:
    """A name for every row of `reported_correlation`."""
    return [reported_name(problem, label) for label in _labels(problem)]


def _labels(problem: Problem) -> list[str]:
    """Names of the unknowns that are no errors of the calibration."""
    errors = sum(problem.family(block.name).count for block in problem.nuisances)
    return problem.labels[: len(problem.labels) - errors]


def reported_correlation(expansion: Expansion, bars: ErrorBars) -> list[list[float]]:
    """Correlation of the estimates; a derived quantity takes the row of the parameter that only shows in it."""
    sign = torch.tensor(
        [_direction(expansion.problem, label, expansion.values) for label in _labels(expansion.problem)]
    )
    correlation = bars.covariance.correlation[: len(sign), : len(sign)]
    return (correlation * sign[:, None] * sign[None, :]).tolist()


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


def shows_only_in_derived(problem: Problem, name: str) -> bool:
    """Whether a parameter has an effect only through a quantity derived from it and others."""
    return name in problem.arbitrary or problem.quantity(name) is not None
