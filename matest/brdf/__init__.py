"""Reflectance models. `MODELS` is the catalogue: one file and one line here per published model."""

from __future__ import annotations

from matest.brdf.base import Brdf, Sum
from matest.brdf.blinn_phong import BlinnPhong
from matest.brdf.cook_torrance import CookTorrance
from matest.brdf.eon import Eon
from matest.brdf.expression import parse
from matest.brdf.fujii import Fujii
from matest.brdf.guidelines import Assembly, assemble
from matest.brdf.he_torrance import HeTorrance
from matest.brdf.lafortune import Lafortune
from matest.brdf.lambert import Lambert
from matest.brdf.li_torrance import (
    Coherent,
    DirectionalDiffuse,
    FirstSurfaceDiffuse,
    ForwardScattering,
    LiTorrance,
    SubsurfaceDiffuse,
)
from matest.brdf.neumann_neumann import NeumannNeumann
from matest.brdf.oren_nayar import OrenNayar
from matest.brdf.oren_nayar_exact import OrenNayarExact
from matest.brdf.oren_nayar_qualitative import OrenNayarQualitative
from matest.brdf.oren_nayar_single_slope import OrenNayarSingleSlope
from matest.brdf.presets import PRESETS, preset
from matest.brdf.rough_surface import unmasked_angle
from matest.brdf.terms import Term
from matest.brdf.torrance_sparrow import TorranceSparrow
from matest.brdf.ward import Ward
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
        LiTorrance,
        DirectionalDiffuse,
        FirstSurfaceDiffuse,
        SubsurfaceDiffuse,
        ForwardScattering,
        Coherent,
        HeTorrance,
        BlinnPhong,
        NeumannNeumann,
        Lafortune,
        Ward,
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
    with_option = [
        kind(**{key: choice}).expression
        for kind in MODELS.values()
        for key, choices in options_of(kind).items()
        for choice in choices
    ]
    return list(dict.fromkeys([*MODELS, *with_option]))


__all__ = [
    "MODELS",
    "PRESETS",
    "Assembly",
    "BlinnPhong",
    "Brdf",
    "Coherent",
    "CookTorrance",
    "DirectionalDiffuse",
    "Eon",
    "FirstSurfaceDiffuse",
    "ForwardScattering",
    "Fujii",
    "HeTorrance",
    "Lafortune",
    "Lambert",
    "LiTorrance",
    "NeumannNeumann",
    "OrenNayar",
    "OrenNayarExact",
    "OrenNayarQualitative",
    "OrenNayarSingleSlope",
    "SubsurfaceDiffuse",
    "Sum",
    "Term",
    "TorranceSparrow",
    "Ward",
    "assemble",
    "model",
    "preset",
    "unmasked_angle",
    "variants",
]
