"""The command `matest models`."""

from __future__ import annotations

from typing import Any

from matest.commands import arguments
from matest.commands.console import console, print_json

EXAMPLE = "matest models"


def models(as_json: arguments.Json = False) -> None:
    """List the reflectance models.

    With their parameters, units, options and sources, what auto tries, and the named materials of the papers.
    """
    from matest.brdf import MODELS, PRESETS
    from matest.estimation.options import AUTO
    from matest.estimation.recipes import RECIPES
    from matest.parameters import options_of, parameters_of

    if as_json:
        catalogue: dict[str, Any] = {}
        for name, model in MODELS.items():
            parameters = {
                key: {"unit": p.unit, "lower": p.domain.lower, "upper": _finite(p.domain.upper), "doc": p.doc}
                | ({"when": dict(p.when)} if p.when else {})
                for key, p in parameters_of(model).items()
            }
            catalogue[name] = {"source": model.source, "parameters": parameters, "options": options_of(model)}
        candidates = [
            {"model": r.expression, "surface": r.surface, "dielectric": r.dielectric or None, "level": r.level}
            for r in RECIPES
        ]
        catalogue[AUTO] = {
            "source": "the best of its candidates",
            "parameters": {},
            "options": {"distribution": ("any",)},
            "candidates": candidates,
        }
        print_json(catalogue)
        return
    from matest.report.tables import models_table, presets_table, recipes_table

    console().print(models_table(MODELS), recipes_table(RECIPES), presets_table(PRESETS))


def _finite(value: float) -> float | None:
    """JSON has no infinity."""
    return value if value < float("inf") else None
