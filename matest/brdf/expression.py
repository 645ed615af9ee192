"""The strings that name models: `oren-nayar`, `lambert+cook-torrance(masking=smith)`."""

from __future__ import annotations

import re
from typing import Any

from matest.brdf.base import Brdf
from matest.errors import InputError, nearest
from matest.parameters import options_of, parameters_of

# A plus sign outside brackets; inside, it belongs to a number such as 1e+0.
_PLUS = re.compile(r"\+(?![^(]*\))")
_COMPONENT = re.compile(r"\s*([\w-]+)\s*(?:\(([^()]*)\))?\s*")


def parse(expression: str, models: dict[str, type[Brdf]]) -> tuple[Brdf, dict[str, float]]:
    """The model that `expression` names, at default parameter values, and the values its brackets fix, by path.

    Raises:
        InputError: an unknown model, option or parameter, or a value that does not fit.
    """
    parts = _PLUS.split(expression)
    brdf: Brdf | None = None
    values: dict[str, dict[str, float]] = {}
    for part in parts:
        match = _COMPONENT.fullmatch(part)
        if not match:
            raise InputError(
                f"the model '{expression}' cannot be read at '{part}': write names joined by +, options in brackets, "
                "as in lambert+cook-torrance(masking=smith)."
            )
        name, brackets = match.groups()
        if name not in models:
            raise InputError(f"unknown model '{name}'; {nearest(name, models)}")
        options, fixed = _brackets(models[name], brackets or "")
        component = models[name](**options)
        component.replace(fixed)  # checks the domain
        values[name] = fixed
        brdf = component if brdf is None else brdf + component
    assert brdf is not None
    if len(parts) == 1:
        return brdf, values[brdf.name]
    return brdf, {f"{name}.{key}": value for name, fixed in values.items() for key, value in fixed.items()}


def _brackets(model: type[Brdf], text: str) -> tuple[dict[str, Any], dict[str, float]]:
    options: dict[str, Any] = {}
    fixed: dict[str, float] = {}
    for item in filter(None, (piece.strip() for piece in text.split(","))):
        key, equals, value = (piece.strip() for piece in item.partition("="))
        if not equals:
            raise InputError(f"{model.name}: '{item}' in the brackets must read name=value.")
        if key in options_of(model):
            options[key] = value
        elif key in parameters_of(model):
            fixed[key] = number(value, f"{model.name}: {key}")
        else:
            names = [*options_of(model), *parameters_of(model)]
            raise InputError(f"{model.name} has no option or parameter '{key}'; {nearest(key, names)}")
    return options, fixed


def number(text: str, label: str) -> float:
    """A number, `true` (1) or `false` (0)."""
    words = {"true": 1.0, "false": 0.0}
    try:
        return words[text.lower()] if text.lower() in words else float(text)
    except ValueError:
        raise InputError(f"{label} must be a number; got '{text}'.") from None
