"""Derived quantities: ratios of parameters, and what stands for a parameter of which only a ratio has an effect."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import torch

from matest.estimators import Problem
from matest.estimators.covariance import error_of, quantile95
from matest.inference.error_bars import ErrorBars
from matest.inference.expansion import Expansion
from matest.inference.quantities import ParameterEstimate

# A ratio with a larger relative standard error is not determined.
_LARGEST_RELATIVE_ERROR = 0.5


def with_ratios(
    expansion: Expansion, bars: ErrorBars, estimates: Mapping[str, ParameterEstimate]
) -> dict[str, ParameterEstimate]:
    """The estimates, with ratios that the model declares; lengths of which only the ratio is seen are lost."""
    problem, out = expansion.problem, dict(estimates)
    for name in problem.brdf.declared:
        if problem.declared(name).ratio is None:
            continue
        label, numerator = _ratio_names(problem, name)
        out[label] = _ratio(expansion, bars, name, out[name])
        if numerator in problem.arbitrary and name in problem.where:
            for length in (numerator, name):
                out[length] = replace(out[length], value=None, std=None, interval95=None, status="not determined")
    return out


def _ratio(expansion: Expansion, bars: ErrorBars, name: str, denominator: ParameterEstimate) -> ParameterEstimate:
    """The ratio of a parameter `Parameter.ratio` names to this one, with its error bar to first order."""
    problem, numerator = expansion.problem, numerator_of(expansion.problem, name)
    top, bottom = float(expansion.values[numerator]), float(expansion.values[name])
    ratio = top / bottom
    doc = f"{numerator} / {name}"
    source = problem.ties.get(name, name)
    if source not in problem.where:
        return ParameterEstimate(ratio, None, None, "1", denominator.status, doc)
    if numerator in problem.where:
        relative = torch.zeros(problem.size, dtype=torch.float64)
        relative[problem.where[numerator].start], relative[problem.where[source].start] = 1 / top, -1 / bottom
        error = error_of(expansion.precision, relative)
        if error is None or error > _LARGEST_RELATIVE_ERROR:
            return ParameterEstimate(None, None, None, "1", "not determined", doc)
        std = ratio * error * bars.largest_widening
        reach = quantile95(bars.covariance.degrees) * std
        return ParameterEstimate(ratio, std, [max(ratio - reach, 0.0), ratio + reach], "1", "determined", doc)
    if denominator.value is None:
        return ParameterEstimate(None, None, None, "1", denominator.status, doc)
    std_bottom = denominator.std
    spread = None if std_bottom is None else ratio * float(std_bottom) / bottom  # type: ignore[arg-type]
    ends = [top / end for end in reversed(denominator.interval95)]
    return ParameterEstimate(ratio, spread, ends, "1", denominator.status, doc)


def _ratio_names(problem: Problem, name: str) -> tuple[str, str]:
    """Under which name the ratio to a parameter is reported, and its numerator (in a sum: paths)."""
    ratio = problem.declared(name).ratio
    assert ratio is not None
    component = name.removesuffix(name.rpartition(".")[2])
    return component + ratio[0], component + ratio[1]


def reported_labels(problem: Problem) -> list[str]:
    """A name for every row of `reported_correlation`."""
    return [reported_name(problem, label) for label in problem.labels]


def reported_correlation(problem: Problem, bars: ErrorBars) -> list[list[float]]:
    """Correlation of the estimates; a length of which only the ratio to another is known stands for that ratio."""
    sign = torch.tensor([-1.0 if known_by_ratio(problem, label) else 1.0 for label in problem.labels])
    return (bars.covariance.correlation * sign[:, None] * sign[None, :]).tolist()


def reported_name(problem: Problem, name: str) -> str:
    """The name under which what is known of a parameter is reported: its own, or that of its ratio to another."""
    ratio = name in problem.brdf.declared and problem.declared(name).ratio is not None
    return _ratio_names(problem, name)[0] if ratio and known_by_ratio(problem, name) else name


def known_by_ratio(problem: Problem, name: str) -> bool:
    """Whether only the ratio of a parameter to another has an effect."""
    declared = problem.brdf.declared.get(name)
    if declared is None or declared.ratio is None:
        return name in problem.arbitrary
    return numerator_of(problem, name) in problem.arbitrary


def numerator_of(problem: Problem, name: str) -> str:
    """The parameter whose ratio to this one is reported."""
    return _ratio_names(problem, name)[1]
