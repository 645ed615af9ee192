"""From a model expression and options to a problem: which parameters are estimated, held or tied."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from types import MappingProxyType
from typing import NamedTuple, Protocol

import torch
from torch import Tensor

from matest.brdf import Brdf, Sum, model
from matest.brdf.base import absent
from matest.errors import InputError, nearest
from matest.estimation.options import Options, Value
from matest.estimators import Problem
from matest.parameters import OPTICS, Derived, Role


class Optics(Protocol):
    """An object that knows the lights and the camera: a scene, or samples."""

    def optics(self, quantity: Role) -> Tensor | None:
        """See `Scene.optics`."""


@dataclass(frozen=True)
class Specification:
    """A problem, and which of its parameters are held although the user did not ask for it.

    Attributes:
        problem: ready to be solved.
        default_held: held parameters that are estimated if the capture determines them.
        assumed: held parameters that lights or camera should give and do not.
    """

    problem: Problem
    default_held: tuple[str, ...]
    assumed: tuple[str, ...] = ()


def check_options(options: Options) -> None:
    """Refuse, before any file is read, options that are wrong for every capture.

    Raises:
        InputError: see `specify`; a device that this machine lacks.
    """
    if options.model is not None and not options.automatic:
        # No image has been read yet: count the channels of the values.
        channels = max((len(value) for value in options.fix.values() if isinstance(value, Sequence)), default=1)
        specify_unknowns(options.model, options, channels=channels, relative=False)
    try:
        torch.zeros(1, device=options.device)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).splitlines()[0][:120]
        raise InputError(
            f"--device {options.device} is not available here ({reason}); use cpu, or cuda where there is a GPU."
        )


def specify(
    expression: str, options: Options, *, channels: int, relative: bool, scene: Optics | None = None
) -> Specification:
    """The problem that a model expression and the user's options describe.

    Args:
        expression: of the model; its brackets fix values too.
        options: what the user fixes, frees and ties.
        channels: number of channels of the images.
        relative: whether the common scale of the lights is unknown.
        scene: gives what models take from lights and camera; None: nothing does.

    Raises:
        InputError: an unknown model or parameter, a value outside its domain, a tie that makes no sense.
    """
    brdf, bracketed = model(expression)
    free = {resolve(brdf, name) for name in options.free}
    fixed = _values(brdf, by_path(brdf, {**bracketed, **options.fix}, free), channels)
    ties = {resolve(brdf, name): resolve(brdf, source) for name, source in options.tie.items()}
    _check_requests(brdf, fixed, free, ties)

    requests = {*fixed, *free, *ties}
    measured = {} if scene is None else _values(brdf, optics(brdf, scene, without=requests), channels)
    holds = {
        name: hold
        for name in brdf.declared
        if name not in requests and name not in measured and (hold := _hold(brdf, name, relative))
    }
    defaults = {name: torch.tensor(hold.value, dtype=torch.float64) for name, hold in holds.items()}
    held = {**fixed, **measured, **defaults}
    estimated = tuple(name for name in brdf.declared if name not in held and name not in ties)
    if relative:
        _check_scale(brdf, estimated, held, ties)

    def held_as(reason: Reason) -> tuple[str, ...]:
        return tuple(name for name, hold in holds.items() if hold.reason is reason)

    problem = Problem.of(
        brdf, channels, estimated, held, ties, relative=relative, arbitrary=held_as(Reason.ARBITRARY_UNIT)
    )
    return Specification(problem, held_as(Reason.NOT_DETERMINED), held_as(Reason.OPTICS_NOT_STATED))


def specify_unknowns(
    expression: str, options: Options, *, channels: int, relative: bool, scene: Optics | None = None
) -> Specification:
    """The same for an estimate, which needs something to estimate.

    Raises:
        InputError: see `specify`; every parameter has its value.
    """
    specification = specify(expression, options, channels=channels, relative=relative, scene=scene)
    if not specification.problem.free:
        raise InputError(
            f"every parameter of {expression} has its value, and none is left to estimate: leave out a --fix or --tie."
        )
    return specification


class Reason(Enum):
    """Why an estimate holds a parameter of which the user said nothing."""

    LIGHT_SCALE_KNOWN = "a gauge, and the common scale of the lights is known"
    SECOND_BODY = "the albedo of a diffuse part beside a diffuse model"
    ARBITRARY_UNIT = "only ratios to it have an effect"
    OPTICS_NOT_STATED = "lights or camera should give it, and do not"
    NOT_DETERMINED = "few captures determine it; this one may"


class Hold(NamedTuple):
    """The value that a parameter is held at, and why."""

    value: float
    reason: Reason


def _hold(brdf: Brdf, name: str, relative: bool) -> Hold | None:
    """How an estimate holds a parameter of which the user said nothing; None: it is estimated."""
    declared = brdf.declared[name]
    if declared.role is Role.GAUGE and not relative:
        return Hold(1.0, Reason.LIGHT_SCALE_KNOWN)
    if beside_body(brdf, name):
        return Hold(0.0, Reason.SECOND_BODY)
    if declared.held is None:
        return None
    if declared.role is Role.YARDSTICK:
        return Hold(declared.held, Reason.ARBITRARY_UNIT)
    if declared.role in OPTICS:
        return Hold(declared.held, Reason.OPTICS_NOT_STATED)
    return Hold(declared.held, Reason.NOT_DETERMINED)


def _check_requests(brdf: Brdf, fixed: Collection[str], free: Collection[str], ties: Mapping[str, str]) -> None:
    """Refuse what the user fixes, frees and ties where these contradict each other."""
    for name, source in ties.items():
        if _kind(brdf, name) != _kind(brdf, source):
            raise InputError(
                f"--tie {name}={source}: these two are of different kinds (one scales a lobe or has a value per "
                "channel, the other does not); only like parameters can be tied."
            )
        if name == source or source in ties or name in fixed or name in free:
            raise InputError(
                f"--tie {name}={source}: a tied parameter takes another's value; free or fix only that one."
            )
    if clash := {*free} & {*fixed}:
        raise InputError(f"{', '.join(sorted(clash))} cannot be both fixed and free; give one of --fix and --free.")


def expression_of(material: Brdf, expression: str) -> str:
    """The expression of a material, with the values that the brackets of the one asked for hold."""
    _, held = model(expression)
    words = []
    for component in material.components if isinstance(material, Sum) else (material,):
        prefix = f"{component.name}." if isinstance(material, Sum) else ""
        name, _, options = component.expression.removesuffix(")").partition("(")
        values = [
            f"{path.removeprefix(prefix)}={value:g}"
            for path, value in held.items()
            if path.startswith(prefix) and f"{path.removeprefix(prefix)}=" not in options
        ]
        brackets = ",".join([*([options] if options else []), *values])
        words.append(f"{name}({brackets})" if brackets else name)
    return "+".join(words)


def freed(specification: Specification, names: Sequence[str]) -> Specification:
    """The same specification with some held parameters estimated."""
    default_held = tuple(name for name in specification.default_held if name not in names)
    return replace(specification, problem=specification.problem.freed(names), default_held=default_held)


def optics(brdf: Brdf, scene: Optics, without: Collection[str] = ()) -> dict[str, list[float]]:
    """What a model takes from the lights and the camera of a scene, by name (in a sum: by path).

    Raises:
        InputError: see `Scene.optics`.
    """
    roles = {name: declared.role for name, declared in brdf.declared.items() if name not in without}
    values = {name: scene.optics(role) for name, role in roles.items() if role in OPTICS}
    return {name: value.tolist() for name, value in values.items() if value is not None}


def resolve(brdf: Brdf, name: str, others: Collection[str] = ()) -> str:
    """The path of a parameter (or one of `others`) given by path, or by bare name where only one component has it.

    Raises:
        InputError: no such parameter, or several.
    """
    choices = [*brdf.declared, *others]
    if name in choices:
        return name
    paths = [path for path in choices if path.rpartition(".")[2] == name]
    if len(paths) == 1:
        return paths[0]
    if paths:
        raise InputError(f"'{name}' is ambiguous in the model '{brdf.expression}': write one of {', '.join(paths)}.")
    raise InputError(
        absent(brdf, name) or f"the model '{brdf.expression}' has no parameter '{name}'; {nearest(name, choices)}"
    )


def by_path(
    brdf: Brdf,
    given: Mapping[str, Value],
    free: Collection[str] = (),
    held: Mapping[str, Tensor] = MappingProxyType({}),
) -> dict[str, Value]:
    """Values by path; a derived quantity (`slope_ratio`) is replaced by the parameter that it sets.

    That parameter follows from the quantity and from the values given for the other parameters, or held.

    Args:
        brdf: whose parameters they are.
        given: by name or path.
        free: paths of parameters that are not held.
        held: values of the parameters that are held, by path.

    Raises:
        InputError: no such parameter, or several; a quantity that puts the parameter it sets outside its domain.
    """
    paths = {name: resolve(brdf, name, brdf.derived) for name in given}
    values = {path: given[name] for name, path in paths.items() if path not in brdf.derived}
    defaults = {name: declared.held for name, declared in brdf.declared.items()}
    defaults |= {name: float(value) for name, value in held.items() if value.numel() == 1}
    others = {name: value for name, value in defaults.items() if name not in free} | values
    for name, path in paths.items():
        if path in brdf.derived:
            quantity = brdf.derived[path]
            if quantity.sets in values:
                raise InputError(f"{name} and {quantity.sets} say the same; give one of them.")
            values[quantity.sets] = _solved(brdf, quantity, name, given[name], others)
    return values


def _solved(brdf: Brdf, quantity: Derived, name: str, value: Value, others: Mapping[str, Value | None]) -> float:
    """The parameter that a derived quantity sets, from a value of the quantity and the other parameters.

    `name` is the quantity's as the user wrote it.
    """
    numbers: dict[str, float] = {}
    for other in brdf.structure.derived[quantity.name]:
        if other != quantity.sets:
            number = others.get(other)
            if not isinstance(value, int | float) or not isinstance(number, int | float):
                raise InputError(f"{name} takes one number, and {other} has to be fixed beside it.")
            numbers[other] = number
    tensors = {other: torch.tensor(number, dtype=torch.float64) for other, number in numbers.items()}
    domain = brdf.declared[quantity.sets].domain
    parameter = quantity.inverse(torch.tensor(value, dtype=torch.float64), tensors)
    if not domain.contains(parameter):
        ends = [torch.tensor(end, dtype=torch.float64) for end in (domain.lower, domain.upper)]
        least, most = sorted(float(quantity.value({**tensors, quantity.sets: end})) for end in ends)
        conditions = ", ".join(
            f"{other} is {number:g} {brdf.declared[other].unit}" for other, number in numbers.items()
        )
        raise InputError(f"{name} must lie between {least:g} and {most:g} ({conditions}); got {value:g}.")
    return float(parameter)


def beside_body(brdf: Brdf, name: str) -> bool:
    """Whether a parameter is the albedo of a diffuse part beside a diffuse model: no capture can separate the two."""
    others = brdf.components if isinstance(brdf, Sum) else ()
    return brdf.declared[name].role is Role.BODY and any(component.body for component in others)


def _kind(brdf: Brdf, name: str) -> tuple[bool, str, bool]:
    """What parameters must have in common to be tied."""
    declared = brdf.declared[name]
    return name in brdf.structure.amplitudes, declared.unit, declared.per_channel


def _check_scale(brdf: Brdf, free: Sequence[str], held: Mapping[str, Tensor], ties: Mapping[str, str]) -> None:
    """Refuse a model with a term whose amplitudes cannot take up the unknown scale of the lights."""
    scales = brdf.structure.scales & {*free}
    for product in brdf.structure.products:
        sources = {ties.get(factor.name, factor.name) for factor in product if not factor.complement}
        dark = any(factor.name in held and not bool(factor.value(held).any()) for factor in product)
        if not dark and not sources & scales:
            raise InputError(
                f"{brdf.expression}: the strength of the lights is unknown (relative radiometry), and nothing in this "
                "model may take up its scale; give the lights' irradiance, or free an albedo or specular (with "
                "fresnel=schlick: --free specular --fix f0=R,G,B)."
            )


def _values(brdf: Brdf, values: Mapping[str, Value], channels: int) -> dict[str, Tensor]:
    return {name: _value(brdf, name, value, channels) for name, value in values.items()}


def _value(brdf: Brdf, name: str, value: Value, channels: int) -> Tensor:
    """A value as a scalar or [C].

    Raises:
        InputError: a value outside the domain, or of another number of channels.
    """
    tensor = torch.as_tensor(value, dtype=torch.float64)
    if tensor.ndim > 1 or (tensor.ndim == 1 and len(tensor) != channels):
        raise InputError(f"{name} takes one value or {channels} (one per channel of the images); got {value}.")
    brdf.replace({name: tensor.tolist()})  # checks the domain
    return tensor
