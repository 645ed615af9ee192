"""Terms of a reflectance model: amplitudes times a shape, a function of the directions and the other parameters."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import torch
from torch import Tensor


class Factor(NamedTuple):
    """A parameter that multiplies a shape, or its complement 1 − (the parameter).

    Attributes:
        name: of the parameter (in a sum: its path).
        complement: whether the factor is 1 − (the parameter).
    """

    name: str
    complement: bool = False

    def value(self, values: Mapping[str, Tensor]) -> Tensor:
        return 1 - values[self.name] if self.complement else values[self.name]

    @property
    def slope(self) -> float:
        """Derivative of the factor by its parameter."""
        return -1.0 if self.complement else 1.0


# The factors of one term.
Product = tuple[Factor, ...]


def complement_of(name: str) -> Factor:
    """The factor 1 − (the parameter of that name)."""
    return Factor(name, complement=True)


class Term:
    """One summand of a model: the product of its `factors` times its `shape`.

    A model is a polynomial in its factors. They multiply shapes only, so an estimator can eliminate these amplitudes.

    Where directions and parameters separate, `shape` = Σq weights_q · columns_q (see `mixture`). An estimator then
    reads the samples once, however many parameter values it tries.

    Args:
        factors: parameters by name, and complements.
        shape: [..., 1 or C] in 1/sr, depends on the directions and on the parameters that are no factors.
        columns: [..., Q], depend on the directions alone.
        weights: of the columns, [Q] or [..., 1 or C, Q], depend on the parameters alone.
    """

    def __init__(
        self,
        factors: Iterable[str | Factor],
        shape: Tensor,
        columns: Tensor | None = None,
        weights: Tensor | None = None,
    ) -> None:
        self.factors: Product = tuple(Factor(factor) if isinstance(factor, str) else factor for factor in factors)
        self.shape = shape
        self.columns = columns
        self.weights = weights

    def within(self, component: str) -> Term:
        """The same term in a sum, where parameters are named by path."""
        paths = [factor._replace(name=f"{component}.{factor.name}") for factor in self.factors]
        return Term(paths, self.shape, self.columns, self.weights)


def lambertian(factors: Iterable[str | Factor], like: Tensor) -> Term:
    """The term 1/π of an even reflection, times its factors; its shape has the size of `like`."""
    return Term(factors, torch.full_like(like, 1 / math.pi))


def mixture(factors: Iterable[str | Factor], columns: Tensor, weights: Tensor) -> Term:
    """The term Σq weights_q · columns_q, times its factors; shapes as in `Term`."""
    if weights.ndim == 1:
        shape = columns @ weights[:, None]
    elif weights.ndim == 2:
        shape = columns @ weights.mT
    else:
        shape = (columns.unsqueeze(-2) * weights).sum(-1)
    return Term(factors, shape, columns, weights)
