"""The models that `auto` tries, from few to many components: guidelines of the papers as a list."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Component(Enum):
    """A process at or below the surface, by the word that a result names it with."""

    BODY = "body"
    ROUGHNESS = "rough body"
    COAT = "coated body"
    GLOSS = "gloss"
    METAL = "metal"
    MULTIPLE = "scattering between facets"
    SECOND_LOBE = "second lobe"
    FORWARD = "forward scattering"
    TAIL = "long tails of slopes"


@dataclass(frozen=True)
class Recipe:
    """A model that `auto` tries.

    Attributes:
        expression: as `--model` takes it.
        surface: what kind of surface it is, in words.
        components: what its light comes from.
        level: models of a level are all tried; those of the next only where no mixture of what was tried would do.
    """

    expression: str
    surface: str
    components: frozenset[Component]
    level: int


def _recipe(level: int, expression: str, surface: str, *components: Component) -> Recipe:
    return Recipe(expression, surface, frozenset(components), level)


_C = Component
# A dielectric of index 1.9 stands for those whose highlight is brighter than one of index 1.5 can make it.
_BRIGHT = "f0=0.1"
# Reflectance of most metals: nearly constant over angles and wavelengths (guideline D).
_METALLIC = "f0=0.9"

# The distribution of Trowbridge and Reitz, of longer tails, with the masking that belongs to it.
_GGX = "distribution=ggx,masking=smith"

# The level of recipes of another slope distribution, tried where no model of the levels before holds or on request.
DISTRIBUTIONS = 4

# Within a level from few to many unknowns; a later one replaces an earlier one only if it predicts better.
RECIPES = (
    _recipe(0, "lambert", "matte", _C.BODY),
    _recipe(1, "oren-nayar", "rough matte", _C.BODY, _C.ROUGHNESS),
    _recipe(1, "cook-torrance(fresnel=schlick,diffuse=0)", "metal", _C.METAL),
    _recipe(2, "cook-torrance", "gloss over matte", _C.BODY, _C.GLOSS),
    _recipe(2, "cook-torrance(fresnel=schlick)", "metal or coloured gloss over matte", _C.METAL, _C.MULTIPLE),
    _recipe(2, "li-torrance", "coated or paper-like", _C.COAT, _C.GLOSS),
    _recipe(2, f"li-torrance(uniform=on,subsurface=off,{_METALLIC})", "rough metal", _C.METAL, _C.MULTIPLE),
    _recipe(2, "oren-nayar+torrance-sparrow", "gloss over rough matte", _C.BODY, _C.ROUGHNESS, _C.GLOSS),
    _recipe(2, "oren-nayar+cook-torrance", "gloss over rough matte", _C.BODY, _C.ROUGHNESS, _C.GLOSS),
    _recipe(3, "cook-torrance(lobes=2,fresnel=schlick,diffuse=0)", "metal of two slopes", _C.METAL, _C.SECOND_LOBE),
    _recipe(3, f"cook-torrance({_BRIGHT})", "bright gloss over matte", _C.BODY, _C.GLOSS),
    _recipe(3, f"li-torrance({_BRIGHT})", "coated or paper-like, bright gloss", _C.COAT, _C.GLOSS),
    _recipe(3, "cook-torrance(lobes=2)", "gloss of two widths over matte", _C.BODY, _C.GLOSS, _C.SECOND_LOBE),
    _recipe(
        3, "cook-torrance(lobes=2,fresnel=schlick)", "metal of two slopes with diffuse light", _C.METAL, _C.MULTIPLE,
        _C.SECOND_LOBE,
    ),
    _recipe(3, "li-torrance(forward=on)", "coated, forward scattering", _C.COAT, _C.GLOSS, _C.FORWARD),
    _recipe(3, "li-torrance(uniform=on)", "coated over matte", _C.BODY, _C.COAT, _C.GLOSS),
    _recipe(DISTRIBUTIONS, f"cook-torrance({_GGX},fresnel=schlick,diffuse=0)", "metal", _C.METAL, _C.TAIL),
    _recipe(DISTRIBUTIONS, f"cook-torrance({_GGX})", "gloss over matte", _C.BODY, _C.GLOSS, _C.TAIL),
    _recipe(
        DISTRIBUTIONS, f"cook-torrance({_GGX},fresnel=schlick)", "metal or coloured gloss over matte", _C.METAL,
        _C.MULTIPLE, _C.TAIL,
    ),
    _recipe(
        DISTRIBUTIONS, f"oren-nayar+cook-torrance({_GGX})", "gloss over rough matte", _C.BODY, _C.ROUGHNESS, _C.GLOSS,
        _C.TAIL,
    ),
    _recipe(
        DISTRIBUTIONS, "cook-torrance(distribution=ggx,lobes=2,masking=smith)", "gloss of two widths over matte",
        _C.BODY, _C.GLOSS, _C.SECOND_LOBE, _C.TAIL,
    ),
)  # fmt: skip
