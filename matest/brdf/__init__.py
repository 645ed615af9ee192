"""Reflectance models. `MODELS` is the catalogue: one file and one line here per published model."""

from __future__ import annotations

from matest.brdf.base import Brdf, Sum, Term
from matest.brdf.cook_torrance import CookTorrance
from matest.brdf.eon import Eon
from matest.brdf.expression import parse
from matest.brdf.fujii import Fujii
from matest.brdf.lambert import Lambert
from matest.brdf.oren_nayar import OrenNayar
from matest.brdf.oren_nayar_exact import OrenNayarExact
from matest.brdf.oren_nayar_qualitative import OrenNayarQualitative
from matest.brdf.oren_nayar_single_slope import OrenNayarSingleSlope
from matest.brdf.presets import PRESETS, preset
from matest.brdf.torrance_sparrow import TorranceSparrow
from matest.parameters import options_of

MODELS: dict[str, type[Brdf]] = {
    model.name: model
    for model in (
        Lambert,
        OrenNayar,
        OrenNayarQualitative,
        OrenNayarExact,
        OrenNayarSingleSlope,
        Fujii,
        Eon,
        TorranceSparrow,
        CookTorrance,
    )
}


def model(expression: str) -> tuple[Brdf, dict[str, float]]:
    """The model named by an expression such as `oren-nayar+torrance-sparrow`, and the parameter values it fixes.

    Raises:
        InputError: see `matest.brdf.expression.parse`.
    """
    return parse(expression, MODELS)


def variants() -> list[str]:
    """Expressions of every model of the catalogue, and of every choice of each of its options."""
    chosen = [
        kind(**{key: choice}).expression
        for kind in MODELS.values()
        for key, choices in options_of(kind).items()
        for choice in choices
    ]
    return list(dict.fromkeys([*MODELS, *chosen]))


__all__ = [
    "MODELS",
    "PRESETS",
    "Brdf",
    "CookTorrance",
    "Eon",
    "Fujii",
    "Lambert",
    "OrenNayar",
    "OrenNayarExact",
    "OrenNayarQualitative",
    "OrenNayarSingleSlope",
    "Sum",
    "Term",
    "TorranceSparrow",
    "model",
    "preset",
    "variants",
]
