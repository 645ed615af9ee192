"""What to estimate: from a model expression and options to a problem."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Protocol

import torch
from torch import Tensor

from matest.brdf import Brdf, Sum, model
from matest.brdf.base import absent
from matest.errors import InputError, nearest
from matest.estimation.options import Options, Value
from matest.estimators import Problem
from matest.parameters import OPTICS, Derived, Role


class Optics(Protocol):
    """What knows of the light and the camera: a scene, or samples."""

    def optics(self, quantity: Role) -> Tensor | None:
        """See `Scene.optics`."""


@dataclass(frozen=True)
class Specification:
    """A problem, and which of its held parameters are held only by default.

    Attributes:
        problem: ready to be solved.
        default_held: parameters that would be estimated if the capture determined them.
        assumed: parameters that lights or camera should give and do not.
    """

    problem: Problem
    default_held: tuple[str, ...]
    assumed: tuple[str, ...] = ()


def check_options(options: Options) -> None:
    """Refuse, before anything is read, what no capture can make right.

    Raises:
        InputError: see `specify`; a device that is not there.
    """
    if options.model is not None and not options.automatic:
        # As many channels as the values have: there is no image yet to count them of.
        channels = max((len(value) for value in options.fix.values() if isinstance(value, Sequence)), default=1)
        specify(options.model, options, channels=channels, relative=False)
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
    """The problem that an expression and what options fix, free and tie describe, for images of `channels` channels.

    `scene` gives what models take from lights and camera.

    Raises:
        InputError: an unknown model or parameter, a value outside its domain, a tie that makes no sense.
    """
    brdf, bracketed = model(expression)
    freed = {resolve(brdf, name) for name in options.free}
    told = by_path(brdf, {**bracketed, **options.fix}, freed)
    fixed = {name: _value(brdf, name, value, channels) for name, value in told.items()}
    ties = {resolve(brdf, name): resolve(brdf, source) for name, source in options.tie.items()}
    for name, source in ties.items():
        if _kind(brdf, name) != _kind(brdf, source):
            raise InputError(
                f"--tie {name}={source}: these two are of different kinds (one scales a lobe or has a value per "
                "channel, the other does not); only like parameters can be tied."
            )
        if name == source or source in ties or name in fixed or name in freed:
            raise InputError(
                f"--tie {name}={source}: a tied parameter takes another's value; free or fix only that one."
            )
    if clash := freed & set(fixed):
        raise InputError(f"{', '.join(sorted(clash))} cannot be both fixed and free; give one of --fix and --free.")

    held: dict[str, Tensor] = dict(fixed)
    seen = optics(brdf, scene, without={*fixed, *freed, *ties}) if scene else {}
    held |= {name: _value(brdf, name, value, channels) for name, value in seen.items()}
    default_held: list[str] = []
    assumed: list[str] = []
    arbitrary: list[str] = []
    for name, declared in brdf.declared.items():
        if name in held or name in freed or name in ties:
            continue
        if declared.role is Role.GAUGE and not relative:
            held[name] = torch.tensor(1.0, dtype=torch.float64)
        elif beside_body(brdf, name):
            held[name] = torch.tensor(0.0, dtype=torch.float64)
        elif declared.held is not None:
            held[name] = torch.tensor(declared.held, dtype=torch.float64)
            if declared.role is Role.YARDSTICK:
                arbitrary.append(name)
            elif declared.role in OPTICS:
                assumed.append(name)
            else:
                default_held.append(name)
    free = tuple(name for name in brdf.declared if name not in held and name not in ties)
    if relative:
        _check_scale(brdf, free, held, ties)
    problem = Problem.of(brdf, channels, free, held, ties, relative=relative, arbitrary=tuple(arbitrary))
    return Specification(problem, tuple(default_held), tuple(assumed))


def freed(specification: Specification, names: Sequence[str]) -> Specification:
    """The same specification with some held parameters estimated."""
    problem = specification.problem
    left = tuple(name for name in specification.default_held if name not in names)
    return replace(specification, problem=problem.freed(names), default_held=left)


def optics(brdf: Brdf, scene: Optics, without: Collection[str] = ()) -> dict[str, list[float]]:
    """What a model takes from the lights and the camera of a scene, by name (in a sum: by path).

    Raises:
        InputError: see `Scene.optics`.
    """
    wanted = {name: declared.role for name, declared in brdf.declared.items() if name not in without}
    values = {name: scene.optics(role) for name, role in wanted.items() if role in OPTICS}
    return {name: value.tolist() for name, value in values.items() if value is not None}


def resolve(brdf: Brdf, name: str, others: Collection[str] = ()) -> str:
    """The path of a parameter (or one of `others`) given by path, or by bare name where only one component has it.

    Raises:
        InputError: no such parameter, or several.
    """
    known = [*brdf.declared, *others]
    if name in known:
        return name
    paths = [path for path in known if path.rpartition(".")[2] == name]
    if len(paths) == 1:
        return paths[0]
    if paths:
        raise InputError(f"'{name}' is ambiguous in the model '{brdf.expression}': write one of {', '.join(paths)}.")
    raise InputError(
        absent(brdf, name) or f"the model '{brdf.expression}' has no parameter '{name}'; {nearest(name, known)}"
    )


def by_path(
    brdf: Brdf,
    given: Mapping[str, Value],
    free: Collection[str] = (),
    held: Mapping[str, Tensor] = MappingProxyType({}),
) -> dict[str, Value]:
    """Values by path. A derived quantity (`slope_ratio`) gives the parameter that it sets, beside others given or held.

    Args:
        brdf: whose parameters they are.
        given: by name or path.
        free: paths of parameters that are not held.
        held: values of parameters that are, by path.

    Raises:
        InputError: no such parameter, or several; a quantity that the domain of the parameter it sets does not hold.
    """
    paths = {name: resolve(brdf, name, brdf.derived) for name in given}
    out = {path: given[name] for name, path in paths.items() if path not in brdf.derived}
    defaults = {name: declared.held for name, declared in brdf.declared.items()}
    defaults |= {name: float(value) for name, value in held.items() if value.numel() == 1}
    beside = {name: value for name, value in defaults.items() if name not in free} | out
    for name, path in paths.items():
        if path in brdf.derived:
            quantity = brdf.derived[path]
            if quantity.sets in out:
                raise InputError(f"{name} and {quantity.sets} say the same; give one of them.")
            out[quantity.sets] = _left_by(brdf, quantity, name, given[name], beside)
    return out


def _left_by(brdf: Brdf, quantity: Derived, name: str, value: Value, beside: Mapping[str, Value | None]) -> float:
    """What a value of a quantity leaves for the parameter that it sets, beside values of the others."""
    numbers: dict[str, float] = {}
    for other in brdf.structure.derived[quantity.name]:
        if other != quantity.sets:
            number = beside.get(other)
            if not isinstance(value, int | float) or not isinstance(number, int | float):
                raise InputError(f"{name} takes one number, and {other} has to be fixed beside it.")
            numbers[other] = number
    others = {other: torch.tensor(number, dtype=torch.float64) for other, number in numbers.items()}
    domain = brdf.declared[quantity.sets].domain
    found = quantity.inverse(torch.tensor(value, dtype=torch.float64), others)
    if not domain.contains(found):
        ends = [torch.tensor(end, dtype=torch.float64) for end in (domain.lower, domain.upper)]
        least, most = sorted(float(quantity.value({**others, quantity.sets: end})) for end in ends)
        told = ", ".join(f"{other} is {number:g} {brdf.declared[other].unit}" for other, number in numbers.items())
        raise InputError(f"{name} must lie between {least:g} and {most:g} ({told}); got {value:g}.")
    return float(found)


def beside_body(brdf: Brdf, name: str) -> bool:
    """Whether a parameter is the albedo of a diffuse part beside a diffuse model: the two could not be told apart."""
    others = brdf.components if isinstance(brdf, Sum) else ()
    return brdf.declared[name].role is Role.BODY and any(component.body for component in others)


def _kind(brdf: Brdf, name: str) -> tuple[bool, str, bool]:
    """What parameters must have in common to be tied."""
    declared = brdf.declared[name]
    return name in brdf.structure.amplitudes, declared.unit, declared.per_channel


def _check_scale(brdf: Brdf, free: Sequence[str], held: Mapping[str, Tensor], ties: Mapping[str, str]) -> None:
    """Under lights of unknown strength every term needs an amplitude that can take up their scale."""
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


def _value(brdf: Brdf, name: str, value: Value, channels: int) -> Tensor:
    tensor = torch.as_tensor(value, dtype=torch.float64)
    if tensor.ndim > 1 or (tensor.ndim == 1 and len(tensor) != channels):
        raise InputError(f"{name} takes one value or {channels} (one per channel of the images); got {value}.")
    brdf.replace({name: tensor.tolist()})  # checks the domain
    return tensor
