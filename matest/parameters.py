"""Parameters of reflectance models, declared once.

A declaration gives the domain, unit and meaning of a parameter, and whether every colour channel has its own value.
Bounds, the unconstrained transform, labels, tables and file formats all follow from it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from enum import Enum
from functools import cache
from typing import Any

import torch
from torch import Tensor

# Key of a declaration in the metadata of its dataclass field: it names this package.
_KEY = "matest"


@dataclasses.dataclass(frozen=True)
class Domain:
    """A closed interval [lower, upper]; `upper` may be infinite."""

    lower: float
    upper: float

    @property
    def width(self) -> float:
        return self.upper - self.lower

    def contains(self, value: Tensor) -> bool:
        # In single precision: there π/2 rounds to a little more than π/2, which must pass.
        lower, upper = torch.tensor([self.lower, self.upper], dtype=torch.float32)
        return bool(((value.float() >= lower) & (value.float() <= upper)).all())

    def lifted(self) -> Domain:
        """The same domain without an upper end."""
        return Domain(self.lower, math.inf)

    def physical(self, unconstrained: Tensor) -> Tensor:
        """Map real numbers into the interior of the domain: by the logistic function, or by softplus on a half-line."""
        if math.isinf(self.upper):
            return self.lower + torch.nn.functional.softplus(unconstrained)
        return self.lower + self.width * torch.sigmoid(unconstrained)

    def unconstrained(self, physical: Tensor) -> Tensor:
        """The inverse of `physical`; values at an end are taken 1e-6 inside it, where the inverse is finite."""
        if math.isinf(self.upper):
            inside = (physical - self.lower).clamp(min=1e-6)
            return inside + torch.log(-torch.expm1(-inside))
        return torch.logit((physical - self.lower) / self.width, eps=1e-6)

    def __str__(self) -> str:
        end = ")" if math.isinf(self.upper) else "]"
        return f"[{self.lower:.3g}, {self.upper:.3g}{end}"


def interval(lower: float, upper: float) -> Domain:
    return Domain(float(lower), float(upper))


unit_interval = interval(0, 1)
non_negative = interval(0, math.inf)


class Role(Enum):
    """What a parameter means to an estimate, as far as neither its domain nor the terms of its model say it."""

    NONE = "nothing beside that"
    BODY = "albedo of a diffuse part, held at 0 beside a diffuse model"
    FRESNEL = "reflectance at normal incidence, seen as a product with the strength of the highlight"
    SLOPE = "rms slope of facets about the surface, whose own slope varies within a pixel"
    GAUGE = "tied to the unknown common light scale: 1 when radiometry is absolute, unknown when it is relative"
    WAVELENGTH = "wavelength of each channel in µm, which the camera gives"
    SOLID_ANGLE = "solid angle of the lights in sr, which they give"
    YARDSTICK = "held at a value that nothing depends on: only ratios to it have an effect"


# Roles of parameters that a capture states, and the part of the capture that does.
OPTICS = {Role.WAVELENGTH: "[camera]", Role.SOLID_ANGLE: "the lights"}


@dataclasses.dataclass(frozen=True)
class Parameter:
    """The declaration of a parameter.

    Attributes:
        domain: closed interval of the physical values.
        unit: "1", "rad", "µm".
        doc: what it is, in the field's words.
        per_channel: whether an estimate gives every colour channel its own value, as for an albedo.
        held: value at which an estimate holds it unless the capture determines it (None: always estimated).
        role: a further meaning that estimates must know.
        log: whether it varies over decades, so that the search has a logarithmic grid.
        when: options of the model, with the values under which the parameter exists.
        variants: options of the model with values, and attributes that are different under them.
        periodic: whether the two ends of the domain are the same value.
    """

    domain: Domain
    unit: str
    doc: str
    per_channel: bool = False
    held: float | None = None
    role: Role = Role.NONE
    log: bool = False
    when: Mapping[str, tuple[str, ...]] = dataclasses.field(default_factory=dict)
    variants: tuple[tuple[Mapping[str, tuple[str, ...]], Mapping[str, Any]], ...] = ()
    periodic: bool = False

    def under(self, options: Mapping[str, str]) -> Parameter | None:
        """The declaration under a model's options; None where the parameter does not exist."""
        if not fulfil(options, self.when):
            return None
        changes = [change for conditions, change in self.variants if fulfil(options, conditions)]
        return dataclasses.replace(self, **{name: value for change in changes for name, value in change.items()})


@dataclasses.dataclass(frozen=True)
class Derived:
    """A function of parameters that have one value each: an estimate reports it, `--fix` holds it.

    `Structure.derived` says on which parameters it depends.

    Attributes:
        name: of the quantity (in a sum: its path).
        unit: "1", "rad", "µm".
        doc: what it is.
        value: computes it from the values of the parameters by name.
        sets: the parameter that a value of the quantity sets, given the other parameters.
        inverse: computes that parameter from the quantity and the other parameters.
        when: options of the model with the values under which it exists.
    """

    name: str
    unit: str
    doc: str
    value: Callable[[Mapping[str, Tensor]], Tensor]
    sets: str
    inverse: Callable[[Tensor, Mapping[str, Tensor]], Tensor]
    when: Mapping[str, tuple[str, ...]] = dataclasses.field(default_factory=dict)

    def within(self, component: str) -> Derived:
        """The same quantity in a sum, where parameters are named by path."""
        path = f"{component}."

        def inside(values: Mapping[str, Tensor]) -> dict[str, Tensor]:
            return {name.removeprefix(path): value for name, value in values.items() if name.startswith(path)}

        return dataclasses.replace(
            self,
            name=path + self.name,
            value=lambda values: self.value(inside(values)),
            sets=path + self.sets,
            inverse=lambda value, others: self.inverse(value, inside(others)),
        )

    def slopes(self, values: Mapping[str, Tensor]) -> dict[str, float]:
        """Derivatives by the parameters that it depends on."""
        with torch.enable_grad():
            leaves = {name: value.detach().clone().requires_grad_() for name, value in values.items()}
            slopes = torch.autograd.grad(self.value(leaves), [*leaves.values()], allow_unused=True)
        return {name: float(slope) for name, slope in zip(leaves, slopes, strict=True) if slope is not None}


def fulfil(options: Mapping[str, str], conditions: Mapping[str, tuple[str, ...]]) -> bool:
    """Whether the options of a model have the values that the conditions ask for."""
    return all(options[name] in values for name, values in conditions.items())


def parameter(domain: Domain, *, unit: str, doc: str, default: float, **kind: Any) -> Any:
    """A dataclass field that is a model parameter. `kind`: the remaining attributes of `Parameter`."""
    return dataclasses.field(default=default, metadata={_KEY: Parameter(domain, unit, doc, **kind)})


def option(default: str, *, choices: tuple[str, ...], doc: str) -> Any:
    """A dataclass field that selects a variant of a model; it is never estimated."""
    return dataclasses.field(default=default, metadata={_KEY: choices, "doc": doc})


def parameters_of(model: type) -> dict[str, Parameter]:
    """Declared parameters of a model class, in order of declaration."""
    return _declarations(model, Parameter)


def options_of(model: type) -> dict[str, tuple[str, ...]]:
    """Options of a model class and their choices."""
    return _declarations(model, tuple)


@cache
def _declarations(model: type, kind: type) -> dict[str, Any]:
    return {f.name: f.metadata[_KEY] for f in dataclasses.fields(model) if isinstance(f.metadata.get(_KEY), kind)}
