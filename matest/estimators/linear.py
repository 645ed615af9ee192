"""Amplitudes in closed form: bounded least squares from normal equations, many small problems at once."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from matest.brdf.terms import Product
from matest.estimators.unknowns import Problem

# Projected Newton steps; a linear model needs one, products of amplitudes settle to rounding well before this.
_NEWTON_STEPS = 20
# Change of every amplitude below which the steps have settled; amplitudes are of the order of 1.
_SETTLED = 1e-12
# Amplitude that the steps start from: the middle of an albedo's domain.
_FIRST_AMPLITUDE = 0.5
# Added to the scaled Hessian, whose diagonal is 1: keeps it regular, and is far above rounding.
_REGULARISATION = 1e-12


def amplitudes(
    problem: Problem, products: list[Product], gram: Tensor, moment: Tensor, gauges: dict[str, Tensor]
) -> tuple[Tensor, Tensor]:
    """Best amplitudes for fixed shapes, and the drop in cost that they bring.

    The model is Σk gk(a) φk with gk products of amplitudes, so cost = gᵀMg − 2gᵀb + const. Linear models are solved
    by projected Newton steps in one go, products (Oren-Nayar's ρ and ρ²) in a few.

    Args:
        problem: gives the bounds of the amplitudes.
        products: the factors of each of the K coefficients.
        gram: M = φᵀWφ of every problem and channel [G, C, K, K].
        moment: b = φᵀWy [G, C, K].
        gauges: values [G, 1] of factors that are shared by the channels and so not solved for.

    Returns:
        Amplitudes [G, C, A] in the order of `problem.amplitudes` without gauges, and the cost up to a constant [G].
    """
    names = [name for name in problem.amplitudes if name not in gauges]
    constants = {**problem.held, **gauges}
    lower = torch.tensor([problem.domain(name).lower for name in names], dtype=torch.float64)
    upper = torch.tensor([problem.domain(name).upper for name in names], dtype=torch.float64)
    lead = gram.shape[:2]
    a = torch.full((*lead, len(names)), _FIRST_AMPLITUDE, dtype=torch.float64).clamp(lower, upper)
    for _ in range(_NEWTON_STEPS if names else 0):
        g, dg = _coefficients(problem, products, names, constants, a)
        gradient = (dg.mT @ (moment - (gram @ g[..., None])[..., 0])[..., None])[..., 0]
        hessian = dg.mT @ gram @ dg
        active = ((a <= lower) & (gradient < 0)) | ((a >= upper) & (gradient > 0))
        before, a = a, (a + _newton_step(hessian, gradient, active)).clamp(lower, upper)
        if float((a - before).abs().amax()) < _SETTLED:
            break
    g, _ = _coefficients(problem, products, names, constants, a)
    cost = (g * ((gram @ g[..., None])[..., 0] - 2 * moment)).sum((-1, -2))
    return a, cost


def _coefficients(
    problem: Problem, products: list[Product], names: list[str], constants: Mapping[str, Tensor], a: Tensor
) -> tuple[Tensor, Tensor]:
    """The products g [G, C, K], and their derivatives by the amplitudes [G, C, K, A].

    Args:
        problem: gives the ties.
        products: the factors of each of the K coefficients.
        names: of the A amplitudes.
        constants: values of the other parameters, each broadcast to [G, C].
        a: the amplitudes [G, C, A].
    """
    lead = a.shape[:-1]
    g, dg = [], []
    for product in products:
        value = torch.ones(lead, dtype=torch.float64)
        slope = torch.zeros(*lead, len(names), dtype=torch.float64)
        for factor in product:
            name = problem.ties.get(factor.name, factor.name)
            column = names.index(name) if name in names else None
            parameter = constants[name].expand(lead) if column is None else a[..., column]
            multiplier = factor.value({factor.name: parameter})
            slope = slope * multiplier[..., None]
            if column is not None:
                slope[..., column] += factor.slope * value
            value = value * multiplier
        g.append(value)
        dg.append(slope)
    return torch.stack(g, -1), torch.stack(dg, -2)


def _newton_step(hessian: Tensor, gradient: Tensor, active: Tensor) -> Tensor:
    """Solve H δ = g, scaled and slightly regularised, for the amplitudes at no active bound; δ of the others is 0."""
    free = (~active).double()
    scale = hessian.diagonal(dim1=-2, dim2=-1).clamp(min=1e-300).rsqrt() * free
    scaled = hessian * scale[..., :, None] * scale[..., None, :]
    eye = torch.eye(hessian.shape[-1], dtype=torch.float64)
    step = torch.linalg.solve_ex(
        scaled + eye * (active.double()[..., None] + _REGULARISATION), (gradient * scale)[..., None]
    )[0]
    return torch.nan_to_num(step[..., 0] * scale)
