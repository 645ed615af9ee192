"""Reflectance models. `MODELS` is the catalogue: one file and one line here per published model."""

from __future__ import annotations

from matest.brdf.base import Brdf, Sum, Term
from matest.brdf.cook_torrance import CookTorrance
from matest.brdf.expression import parse
from matest.brdf.lambert import Lambert
from matest.brdf.oren_nayar import OrenNayar
from matest.brdf.oren_nayar_qualitative import OrenNayarQualitative
from matest.brdf.torrance_sparrow import TorranceSparrow

MODELS: dict[str, type[Brdf]] = {
    model.name: model for model in (Lambert, OrenNayar, OrenNayarQualitative, TorranceSparrow, CookTorrance)
}


def model(expression: str) -> tuple[Brdf, dict[str, float]]:
    """The model named by an expression such as `oren-nayar+torrance-sparrow`, and the parameter values it fixes.

    Raises:
        InputError: see `matest.brdf.expression.parse`.
    """
    return parse(expression, MODELS)


__all__ = [
    "MODELS",
    "Brdf",
    "CookTorrance",
    "Lambert",
    "OrenNayar",
    "OrenNayarQualitative",
    "Sum",
    "Term",
    "TorranceSparrow",
    "model",
]
