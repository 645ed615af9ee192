"""Lobes that are not seen: their strength does not differ from zero, so the samples say nothing of their shape."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from matest.brdf.terms import Factor, Product
from matest.estimators.covariance import fisher
from matest.inference.error_bars import ErrorBars
from matest.inference.expansion import Expansion

# Standard errors by which the amplitude of a visible lobe exceeds zero. Noise alone often reaches two or three, because
# a search chooses the width and there are several channels.
_VISIBLE_AMPLITUDE = 4.0


@dataclass(frozen=True)
class LobesNotSeen:
    """Parameters of lobes that the samples do not show.

    Attributes:
        shapes: parameters that shape such lobes only.
        amplitudes: free amplitudes of such lobes.
    """

    shapes: frozenset[str] = frozenset()
    amplitudes: frozenset[str] = frozenset()


def lobes_not_seen(expansion: Expansion, bars: ErrorBars) -> LobesNotSeen:
    """The lobes that are not seen."""
    problem = expansion.problem
    shapes = frozenset(name for name in problem.shapes if not _any_seen(expansion, bars, name))
    factors = {
        problem.ties.get(factor.name, factor.name)
        for shape in shapes
        for product in problem.brdf.structure.carriers(shape)
        for factor in product
    }
    return LobesNotSeen(shapes, frozenset(factors & {*problem.amplitudes}))


def _any_seen(expansion: Expansion, bars: ErrorBars, shape: str) -> bool:
    """Whether any lobe that a parameter shapes is seen: one all of whose factors differ from zero."""
    return any(
        all(_differs_from_zero(expansion, bars, factor, product) for factor in product)
        for product in expansion.problem.brdf.structure.carriers(shape)
    )


def _differs_from_zero(expansion: Expansion, bars: ErrorBars, factor: Factor, product: Product) -> bool:
    """Whether a factor differs from zero in any channel, at given other factors of its product and given shapes."""
    problem = expansion.problem
    value = factor.value(expansion.values).reshape(-1)
    source = problem.ties.get(factor.name, factor.name)
    if source in problem.gauges or source not in problem.where:
        return source in problem.gauges or bool((value != 0).any())
    others = {problem.ties.get(other.name, other.name) for other in product} - {source}
    free = torch.zeros(problem.size, dtype=torch.bool)
    for name in {*problem.amplitudes} - others:
        free[problem.where[name]] = True
    std = (fisher(expansion.precision, free).std * bars.widening)[problem.where[source]]
    return bool((value > _VISIBLE_AMPLITUDE * std).any())
