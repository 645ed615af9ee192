"""The values of a model's parameters for which error bars are predicted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from matest.brdf import Brdf
from matest.errors import InputError
from matest.estimation.options import Value
from matest.estimation.specification import Specification, by_path
from matest.estimators import Problem

# Multiples of their default at which shape parameters that nobody gave are tried too: half and double.
_LEVELS = (0.5, 2.0)


@dataclass(frozen=True)
class Nominal:
    """A model at the values for which its error bars are predicted.

    Attributes:
        specification: what is estimated; parameters held by default are held at their values here.
        values: of every parameter, by path: a scalar, or [C].
        levels: the same with all shape parameters that nobody gave scaled together; empty where all were given.
    """

    specification: Specification
    values: Mapping[str, Tensor]
    levels: Sequence[Mapping[str, Tensor]]

    @classmethod
    def of(cls, specification: Specification, scene: Mapping[str, Tensor], at: Mapping[str, Value]) -> Nominal:
        """Values as the user gives them, else those of the scene's material, else the model's defaults.

        Args:
            specification: what is estimated and what is held.
            scene: values of the scene's material, by path.
            at: values that the user assumes, by name or path.

        Raises:
            InputError: an unknown parameter, a value outside its domain, or a value of a parameter not estimated.
        """
        overrides = {**scene, **_yardstick_lengths(specification.problem, scene), **_assumed_values(specification, at)}
        held_values = {name: overrides[name] for name in specification.default_held if name in overrides}
        problem = replace(specification.problem, held={**specification.problem.held, **held_values})
        values = {name: torch.as_tensor(value).double() for name, value in problem.brdf.parameters.items()}
        values = _with_ties(problem, {**values, **overrides, **problem.held})
        return cls(replace(specification, problem=problem), values, _levels(problem, values, overrides))

    @property
    def problem(self) -> Problem:
        """What is estimated unless the photographs determine more."""
        return self.specification.problem

    @property
    def unknowns(self) -> Tensor:
        """The values as unknowns u [P] of the problem."""
        return self.problem.unknowns_at(self.values)

    @property
    def material(self) -> Brdf:
        """The model with these values."""
        return self.problem.brdf.replace(self.values)

    @property
    def tried(self) -> dict[str, list[float]]:
        """The values, ascending, of the shape parameters that differ between the levels, by path."""
        return {
            name: sorted({float(level[name]) for level in (self.values, *self.levels)})
            for name in self.problem.shapes
            if not all(level[name].equal(self.values[name]) for level in self.levels)
        }


def _yardstick_lengths(problem: Problem, scene: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The lengths of a scene's material in units of a length that is held: only their ratio has an effect."""
    return {
        name: quantity.inverse(quantity.value(scene), problem.held)
        for name in scene
        if name in problem.where and (quantity := problem.quantity(name)) is not None
    }


def _assumed_values(specification: Specification, at: Mapping[str, Value]) -> dict[str, Tensor]:
    """The values that the user assumes, by path."""
    problem, tensors = specification.problem, {}
    for path, value in by_path(problem.brdf, at, held=problem.held).items():
        if path in problem.ties or (path in problem.held and path not in specification.default_held):
            raise InputError(f"{path} is fixed or tied and not estimated; leave out its assumed value.")
        tensor = torch.as_tensor(value, dtype=torch.float64)
        if tensor.ndim > 1 or (tensor.ndim == 1 and len(tensor) != problem.count(path)):
            raise InputError(f"{path} takes {problem.count(path)} value(s); got {value}.")
        problem.brdf.replace({path: tensor.tolist()})  # checks the domain
        tensors[path] = tensor
    return tensors


def _levels(problem: Problem, values: Mapping[str, Tensor], overrides: Mapping[str, Tensor]) -> list[dict[str, Tensor]]:
    """The values with all shape parameters that nobody gave scaled together, inside their domains."""
    names = [name for name in problem.shapes if name not in {*overrides, *problem.gauges}]
    levels = []
    for level in _LEVELS if names else ():
        domains = {name: problem.declared(name).domain for name in names}
        scaled = {name: (level * values[name]).clamp(domain.lower, domain.upper) for name, domain in domains.items()}
        levels.append(_with_ties(problem, {**values, **scaled}))
    return levels


def _with_ties(problem: Problem, values: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The values, those of dependent parameters taken from their sources."""
    return {**values, **{name: values[source] for name, source in problem.ties.items()}}
