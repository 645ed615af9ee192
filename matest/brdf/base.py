"""The base of every reflectance model: named parameters, and terms that are products of parameters and shapes."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from functools import cache, cached_property
from typing import Any, ClassVar

import torch
from torch import Tensor

from matest.brdf.structure import Structure, structure_of, structure_of_sum
from matest.brdf.terms import Term
from matest.directions import Directions, above_horizon
from matest.errors import InputError, nearest
from matest.parameters import Derived, Parameter, Role, fulfil, options_of, parameters_of

Options = tuple[tuple[str, str], ...]


class Brdf:
    """A bidirectional reflectance distribution function with declared parameters.

    Calling it with local-frame unit directions `wi`, `wo` of shape [..., 3] returns values in 1/sr of shape [..., C],
    without the cosine, zero below the horizon and never negative. C is 1 if every parameter is a scalar. Parameters
    given as numbers or sequences are checked against their domain; tensors are taken as they are, so that they may
    come from an optimiser. A parameter that differs per pixel carries the pixel's dimensions before the channel:
    shape [..., 1 or C].

    Raises:
        InputError: a parameter outside its domain, an unknown option.
    """

    name: ClassVar[str]
    source: ClassVar[str]
    # Options that exclude each other, and why.
    excluded: ClassVar[tuple[tuple[dict[str, str], str], ...]] = ()
    # Functions of the parameters that an estimate reports.
    quantities: ClassVar[tuple[Derived, ...]] = ()
    # Whether this is a diffuse model: beside it no capture determines a `diffuse` part.
    body: ClassVar[bool] = False

    def __post_init__(self) -> None:
        for name, choices in options_of(type(self)).items():
            value = _as_choice(getattr(self, name))
            object.__setattr__(self, name, value)
            if value not in choices:
                raise InputError(f"{self.name}: {name} must be one of {', '.join(choices)}; got '{value}'.")
        for combination, reason in self.excluded:
            if all(getattr(self, name) == value for name, value in combination.items()):
                raise InputError(f"{self.name}: {reason}")
        existing = self.declared
        for name, declared in parameters_of(type(self)).items():
            value = getattr(self, name)
            if name in existing:
                object.__setattr__(self, name, _as_tensor(value, declared, f"{self.name}: {name}"))
            elif not _equal(value, type(self).__dataclass_fields__[name].default):  # type: ignore[attr-defined]
                raise InputError(absent(self, name) or "")

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        """The model's terms at directions above the horizon."""
        raise NotImplementedError

    @property
    def declared(self) -> dict[str, Parameter]:
        """Declarations by name (in a sum: by path, `lambert.albedo`) of the parameters that exist under the options."""
        kind: type = type(self)
        return _declared(kind, _options(self))

    @property
    def derived(self) -> dict[str, Derived]:
        """Functions of the parameters under the options, by name (in a sum: by path)."""
        options = dict(_options(self))
        return {quantity.name: quantity for quantity in self.quantities if fulfil(options, quantity.when)}

    @property
    def parameters(self) -> dict[str, Tensor]:
        """Values by name (in a sum: by path)."""
        return {name: getattr(self, name) for name in self.declared}

    @property
    def ordered(self) -> Brdf:
        """The same reflectance with interchangeable lobes in a fixed order."""
        return self

    @property
    def structure(self) -> Structure:
        """The factors of every term, and the parameters that its shape depends on."""
        kind: type = type(self)
        return _structure(kind, _options(self))

    @property
    def expression(self) -> str:
        """The string that names this model and its options, as `--model` takes it."""
        words = [
            f"{f.name}={getattr(self, f.name)}"
            for f in dataclasses.fields(self)  # type: ignore[arg-type]
            if f.name in options_of(type(self)) and getattr(self, f.name) != f.default
        ]
        # A gauge of 0 drops a term, which makes another model.
        for name, declared in self.declared.items():
            value = self.parameters[name]
            if declared.role is Role.GAUGE and value.ndim == 0 and not value.requires_grad and float(value) == 0:
                words.append(f"{name}=false")
        return f"{self.name}({','.join(words)})" if words else self.name

    def replace(self, values: Mapping[str, Any]) -> Brdf:
        """The same model with other parameter values, by name or path.

        Raises:
            InputError: an unknown name, a number outside its domain.
        """
        for name in values:
            if name not in self.declared:
                raise InputError(
                    absent(self, name) or f"{self.name} has no parameter '{name}'; {nearest(name, self.declared)}"
                )
        return dataclasses.replace(self, **values)  # type: ignore[type-var]

    def evaluate(self, directions: Directions) -> Tensor:
        """Values [..., C] at directions above the horizon."""
        values = self.parameters
        total: Tensor | float = 0.0
        for term in self.terms(directions):
            # Multiply the factors first, so that each term takes one pass over the directions.
            scale = math.prod((factor.value(values) for factor in term.factors), start=1.0)
            total = total + term.shape * scale
        # The polynomials of some models are negative near double grazing; a reflectance is not.
        return torch.as_tensor(total).clamp(min=0)

    def __call__(self, wi: Tensor, wo: Tensor) -> Tensor:
        directions, above = above_horizon(wi, wo)
        values = self.to(wi.dtype, wi.device).evaluate(directions)
        return torch.where(above, values, torch.zeros((), dtype=values.dtype, device=values.device))

    def to(self, dtype: torch.dtype, device: torch.device | str) -> Brdf:
        return self.replace({name: value.to(device, dtype) for name, value in self.parameters.items()})

    def __add__(self, other: Brdf) -> Brdf:
        return Sum(_components(self) + _components(other))


@dataclasses.dataclass(frozen=True, eq=False)
class Sum(Brdf):
    """The sum of several models. Its parameters are named by path: `oren-nayar.sigma`, `lambert.albedo`."""

    components: tuple[Brdf, ...]
    name: ClassVar[str] = "sum"
    source: ClassVar[str] = ""

    def __post_init__(self) -> None:
        names = [component.name for component in self.components]
        repeated = {name for name in names if names.count(name) > 1}
        if repeated:
            raise InputError(
                f"a sum takes each model once; '{'+'.join(names)}' repeats {', '.join(sorted(repeated))}: leave it out."
            )

    @property
    def _by_name(self) -> dict[str, Brdf]:
        return {component.name: component for component in self.components}

    @cached_property
    def declared(self) -> dict[str, Parameter]:
        return {f"{name}.{key}": value for name, part in self._by_name.items() for key, value in part.declared.items()}

    @cached_property
    def derived(self) -> dict[str, Derived]:
        parts = [value.within(name) for name, part in self._by_name.items() for value in part.derived.values()]
        return {quantity.name: quantity for quantity in parts}

    @cached_property
    def structure(self) -> Structure:
        return structure_of_sum({name: part.structure for name, part in self._by_name.items()})

    @property
    def parameters(self) -> dict[str, Tensor]:
        return {
            f"{name}.{key}": value for name, part in self._by_name.items() for key, value in part.parameters.items()
        }

    @property
    def expression(self) -> str:
        return "+".join(component.expression for component in self.components)

    def replace(self, values: Mapping[str, Any]) -> Brdf:
        parts: dict[str, dict[str, Any]] = {name: {} for name in self._by_name}
        for path, value in values.items():
            name, _, key = path.partition(".")
            if name not in parts:
                raise InputError(f"no component '{name}' in the model '{self.expression}'; {nearest(name, parts)}")
            parts[name][key] = value
        return Sum(tuple(part.replace(parts[name]) for name, part in self._by_name.items()))

    @property
    def ordered(self) -> Brdf:
        return Sum(tuple(part.ordered for part in self.components))

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        return tuple(term.within(name) for name, part in self._by_name.items() for term in part.terms(directions))


def absent(brdf: Brdf, name: str) -> str | None:
    """A sentence on the options that a missing parameter needs; None if no options give it to the model."""
    for part in _components(brdf):
        declared = parameters_of(type(part)).get(name.rpartition(".")[2])
        if declared is not None and declared.when:
            needed = " and ".join(f"{option}={' or '.join(values)}" for option, values in declared.when.items())
            return f"{part.name} has no parameter {name.rpartition('.')[2]} with these options; it needs {needed}."
    return None


@cache
def _declared(kind: type, options: Options) -> dict[str, Parameter]:
    declarations = {name: declared.under(dict(options)) for name, declared in parameters_of(kind).items()}
    return {name: declared for name, declared in declarations.items() if declared is not None}


@cache
def _structure(kind: type[Brdf], options: Options) -> Structure:
    return structure_of(kind(**dict(options)))


def _options(brdf: Brdf) -> Options:
    return tuple((name, getattr(brdf, name)) for name in options_of(type(brdf)))


def _as_choice(value: Any) -> Any:
    """The word for a number or a truth value: options are words."""
    if isinstance(value, bool):
        return str(value).lower()
    return str(value) if isinstance(value, int) else value


def _equal(value: Any, default: float) -> bool:
    return not (isinstance(value, (list, tuple)) or (isinstance(value, Tensor) and value.ndim)) and value == default


def _components(brdf: Brdf) -> tuple[Brdf, ...]:
    return brdf.components if isinstance(brdf, Sum) else (brdf,)


def _as_tensor(value: Any, declared: Parameter, label: str) -> Tensor:
    if isinstance(value, Tensor):
        return value
    try:
        tensor = torch.as_tensor(value, dtype=torch.float64)
        if tensor.ndim > 1 or not tensor.numel():
            raise ValueError
    except (TypeError, ValueError, RuntimeError, OverflowError):
        raise InputError(f"{label} must be a number, a list of one number per channel, or a tensor; got {value!r}.")
    if not declared.domain.contains(tensor):
        hint = " Angles are in radians." if declared.unit == "rad" else ""
        unit = "" if declared.unit == "1" else f" {declared.unit}"
        raise InputError(f"{label} must lie in {declared.domain}{unit}; got {tensor.tolist()}.{hint}")
    return tensor
