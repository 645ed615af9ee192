"""The dependence of the terms of a model on its parameters, read from the graph of autograd.

Values do not matter: a lobe that is 0 at the directions of the probe still depends on its parameters in the graph, and
so does a lobe whose parameter is clamped there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from matest.brdf.terms import Factor, Product, Term, complement_of
from matest.directions import Directions

if TYPE_CHECKING:
    from matest.brdf.base import Brdf

# Directions of the probe. No value is read, so any pair will do that differs from the normal and from each other.
_LIGHT = (0.48, 0.36, 0.8)
_VIEWER = (-0.48, 0.6, 0.64)


@dataclass(frozen=True)
class TermStructure:
    """The dependence of one term on the parameters.

    Attributes:
        factors: parameters, and complements of parameters, that multiply its shape.
        shape_parameters: parameters that its shape depends on.
        column_parameters: shape parameters that its columns depend on, and not only the weights of the columns.
        columns: number of columns; 1 where the term is no mixture and its shape is the column.
        anisotropic: whether its shape changes when light and viewer turn together about the normal.
    """

    factors: Product
    shape_parameters: frozenset[str]
    column_parameters: frozenset[str]
    columns: int
    anisotropic: bool

    def within(self, component: str) -> TermStructure:
        """The same in a sum, where parameters are named by path."""

        def paths(names: frozenset[str]) -> frozenset[str]:
            return frozenset(f"{component}.{name}" for name in names)

        return replace(
            self,
            factors=tuple(factor._replace(name=f"{component}.{factor.name}") for factor in self.factors),
            shape_parameters=paths(self.shape_parameters),
            column_parameters=paths(self.column_parameters),
        )


@dataclass(frozen=True)
class Structure:
    """The dependence of all terms of a model on its parameters, whatever their values.

    Attributes:
        terms: of the model, in its order.
        coloured: parameters that an estimate gives one value per channel.
        derived: the parameters that each derived quantity depends on, in order of declaration.
    """

    terms: tuple[TermStructure, ...]
    coloured: frozenset[str]
    derived: Mapping[str, tuple[str, ...]]

    @property
    def products(self) -> list[Product]:
        """The factors of each term."""
        return [term.factors for term in self.terms]

    @property
    def columns(self) -> list[int]:
        """The number of columns of each term."""
        return [term.columns for term in self.terms]

    @cached_property
    def amplitudes(self) -> frozenset[str]:
        """Parameters that only multiply shapes."""
        return frozenset(factor.name for product in self.products for factor in product)

    @cached_property
    def scales(self) -> frozenset[str]:
        """Amplitudes that can carry an unknown scale of the light: no term uses their complement."""
        factors = {factor for product in self.products for factor in product}
        return frozenset(
            name for name in self.coloured if Factor(name) in factors and complement_of(name) not in factors
        )

    @property
    def anisotropic(self) -> bool:
        """Whether reflection changes when light and viewer turn together about the normal."""
        return any(term.anisotropic for term in self.terms)

    def carriers(self, name: str) -> list[Product]:
        """The factors of each of the terms whose shape depends on the parameter `name`."""
        return [term.factors for term in self.terms if name in term.shape_parameters]


def structure_of(brdf: Brdf) -> Structure:
    """The structure of one model under its options; its values do not matter."""
    with torch.inference_mode(False), torch.enable_grad():
        leaves = {name: value.detach().clone().requires_grad_() for name, value in brdf.parameters.items()}
        angle = torch.zeros((), dtype=torch.float64, requires_grad=True)
        terms = brdf.replace(leaves).terms(_Turned(angle))
        sources = {name: connected(quantity.value(leaves), leaves) for name, quantity in brdf.derived.items()}
        return Structure(
            terms=tuple(_term_structure(term, leaves, angle) for term in terms),
            coloured=frozenset(name for name, declared in brdf.declared.items() if declared.per_channel),
            derived={name: tuple(key for key in leaves if key in names) for name, names in sources.items()},
        )


def structure_of_sum(components: Mapping[str, Structure]) -> Structure:
    """The structure of a sum of models."""
    return Structure(
        terms=tuple(term.within(name) for name, part in components.items() for term in part.terms),
        coloured=frozenset(f"{name}.{key}" for name, part in components.items() for key in part.coloured),
        derived={
            f"{name}.{quantity}": tuple(f"{name}.{key}" for key in keys)
            for name, part in components.items()
            for quantity, keys in part.derived.items()
        },
    )


def connected(value: Tensor, leaves: Mapping[str, Tensor]) -> frozenset[str]:
    """Names of the leaves that a value depends on in the graph of autograd."""
    if not (leaves and value.requires_grad):
        return frozenset()
    slopes = torch.autograd.grad(value.sum(), [*leaves.values()], retain_graph=True, allow_unused=True)
    return frozenset(name for name, slope in zip(leaves, slopes, strict=True) if slope is not None)


def _term_structure(term: Term, leaves: Mapping[str, Tensor], angle: Tensor) -> TermStructure:
    shape_parameters = connected(term.shape, leaves)
    return TermStructure(
        factors=term.factors,
        shape_parameters=shape_parameters,
        column_parameters=shape_parameters if term.columns is None else connected(term.columns, leaves),
        columns=1 if term.columns is None else term.columns.shape[-1],
        anisotropic=bool(connected(term.shape, {"angle": angle})),
    )


class _Turned(Directions):
    """Directions turned about the normal by an angle.

    In autograd only the quantities that a turn changes depend on the angle.
    """

    def __init__(self, angle: Tensor) -> None:
        wi, wo = (torch.tensor([vector], dtype=torch.float64) for vector in (_LIGHT, _VIEWER))
        super().__init__(wi, wo)
        cos, sin, zero, one = angle.cos(), angle.sin(), torch.zeros_like(angle), torch.ones_like(angle)
        turn = torch.stack([cos, -sin, zero, sin, cos, zero, zero, zero, one]).reshape(3, 3)
        self._before = Directions(wi, wo)
        self._after = Directions(wi @ turn.T, wo @ turn.T)

    @cached_property
    def along_tangent(self) -> tuple[Tensor, Tensor]:
        return self._after.along_tangent

    def along(self, azimuth: Tensor) -> tuple[Tensor, Tensor]:
        return self._after.along(azimuth)

    @cached_property
    def half_slopes(self) -> tuple[Tensor, Tensor]:
        return self._after.half_slopes

    @cached_property
    def tan2_half(self) -> Tensor:
        # A turn does not change it, although it changes both slopes.
        return self._before.tan2_half
