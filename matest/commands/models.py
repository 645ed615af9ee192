"""The command `matest models`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

from matest.commands import arguments
from matest.commands.console import console, print_json
from matest.errors import InputError, nearest

if TYPE_CHECKING:
    from matest.brdf import Brdf

EXAMPLE = "matest models oren-nayar"


def models(
    name: Annotated[str | None, typer.Argument(metavar="NAME", help="The only model to list.")] = None,
    as_json: arguments.Json = False,
) -> None:
    """List the reflectance models, or one.

    With their parameters, units, options and sources; of all, what auto tries, and the named materials of the papers.
    """
    from matest.brdf import MODELS, PRESETS
    from matest.estimation.options import AUTO
    from matest.estimation.recipes import RECIPES
    from matest.report.tables import models_table, presets_table, recipes_table

    if name is not None and name not in (*MODELS, AUTO):
        raise InputError(f"unknown model '{name}'; {nearest(name, (*MODELS, AUTO))}")
    chosen = {key: model for key, model in MODELS.items() if name in (None, key)}
    if as_json:
        print_json(_catalogue(chosen) | (_automatic() if name in (None, AUTO) else {}))
        return
    terminal = console()
    if chosen:
        terminal.print(models_table(chosen))
    if name in (None, AUTO):
        terminal.print(recipes_table(RECIPES))
    if name is None:
        terminal.print(presets_table(PRESETS))


def _catalogue(models: Mapping[str, type[Brdf]]) -> dict[str, Any]:
    """What there is to know of models, by name."""
    from matest.parameters import options_of, parameters_of

    catalogue: dict[str, Any] = {}
    for name, model in models.items():
        parameters = {
            key: {"unit": p.unit, "lower": p.domain.lower, "upper": _finite(p.domain.upper), "doc": p.doc}
            | ({"when": dict(p.when)} if p.when else {})
            for key, p in parameters_of(model).items()
        }
        catalogue[name] = {"source": model.source, "parameters": parameters, "options": options_of(model)}
    return catalogue


def _automatic() -> dict[str, Any]:
    """What `auto` tries, as if it were one more model."""
    from matest.estimation.options import AUTO
    from matest.estimation.recipes import RECIPES

    candidates = [
        {"model": r.expression, "surface": r.surface, "dielectric": r.dielectric or None, "level": r.level}
        for r in RECIPES
    ]
    return {
        AUTO: {
            "source": "the best of its candidates",
            "parameters": {},
            "options": {"distribution": ("any",)},
            "candidates": candidates,
        }
    }


def _finite(value: float) -> float | None:
    """JSON has no infinity."""
    return value if value < float("inf") else None
