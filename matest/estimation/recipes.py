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
        dielectric: the same where the f0 that is estimated is that of a dielectric; empty: f0 does not matter.
        components: what its light comes from.
        level: models of a level are all tried; those of the next only where no mixture of what was tried would do.
    """

    expression: str
    surface: str
    components: frozenset[Component]
    level: int
    dielectric: str = ""

    def surface_of(self, f0: float) -> str:
        """What kind of surface it is at this reflectance at normal incidence, averaged over channels."""
        return self.dielectric if self.dielectric and f0 < LEAST_METALLIC_F0 else self.surface


def _recipe(level: int, expression: str, surface: str, *components: Component, dielectric: str = "") -> Recipe:
    return Recipe(expression, surface, frozenset(components), level, dielectric)


# Reflectance at normal incidence from which on a surface is a metal: f0 = ((n − 1)/(n + 1))² is 0.17 for diamond, of
# n = 2.42, and less for nearly all other dielectrics; metals have 0.5 or more (Akenine-Möller, Haines & Hoffman 2018,
# Real-Time Rendering, § 9.5.2).
LEAST_METALLIC_F0 = 0.2

_C = Component
# A dielectric of index 1.9 stands for those whose highlight is brighter than one of index 1.5 can make it.
_BRIGHT = "f0=0.1"
# Reflectance of most metals: nearly constant over angles and wavelengths (guideline D).
_METALLIC = "f0=0.9"

# The distribution of Trowbridge and Reitz, of longer tails, with the masking that belongs to it.
_GGX = "distribution=ggx,masking=smith"

# The last level of recipes that are compared in any case, the simplest models of all.
LAST_LEVEL_OF_ALL = 1
# The level of recipes of another slope distribution, tried where no model of the levels before holds or on request.
DISTRIBUTIONS = 4

# Within a level from few to many unknowns; a later one replaces an earlier one only if it predicts better.
RECIPES = (
    _recipe(0, "lambert", "matte", _C.BODY),
    _recipe(1, "oren-nayar", "rough matte", _C.BODY, _C.ROUGHNESS),
    _recipe(1, "cook-torrance(fresnel=schlick,diffuse=0)", "metal", _C.METAL, dielectric="coloured gloss"),
    _recipe(2, "cook-torrance", "gloss over matte", _C.BODY, _C.GLOSS),
    _recipe(
        2, "cook-torrance(fresnel=schlick)", "metal with diffuse light", _C.METAL, _C.MULTIPLE,
        dielectric="coloured gloss over matte",
    ),
    _recipe(2, "li-torrance", "coated or paper-like", _C.COAT, _C.GLOSS),
    _recipe(2, f"li-torrance(uniform=on,subsurface=off,{_METALLIC})", "rough metal", _C.METAL, _C.MULTIPLE),
    _recipe(2, "oren-nayar+torrance-sparrow", "gloss over rough matte", _C.BODY, _C.ROUGHNESS, _C.GLOSS),
    _recipe(2, "oren-nayar+cook-torrance", "gloss over rough matte", _C.BODY, _C.ROUGHNESS, _C.GLOSS),
    _recipe(
        3, "cook-torrance(lobes=2,fresnel=schlick,diffuse=0)", "metal of two slopes", _C.METAL, _C.SECOND_LOBE,
        dielectric="coloured gloss of two widths",
    ),
    _recipe(3, f"cook-torrance({_BRIGHT})", "bright gloss over matte", _C.BODY, _C.GLOSS),
    _recipe(3, f"li-torrance({_BRIGHT})", "coated or paper-like, bright gloss", _C.COAT, _C.GLOSS),
    _recipe(3, "cook-torrance(lobes=2)", "gloss of two widths over matte", _C.BODY, _C.GLOSS, _C.SECOND_LOBE),
    _recipe(
        3, "cook-torrance(lobes=2,fresnel=schlick)", "metal of two slopes with diffuse light", _C.METAL, _C.MULTIPLE,
        _C.SECOND_LOBE, dielectric="coloured gloss of two widths over matte",
    ),
    _recipe(3, "li-torrance(forward=on)", "coated, forward scattering", _C.COAT, _C.GLOSS, _C.FORWARD),
    _recipe(3, "li-torrance(uniform=on)", "coated over matte", _C.BODY, _C.COAT, _C.GLOSS),
    _recipe(
        DISTRIBUTIONS, f"cook-torrance({_GGX},fresnel=schlick,diffuse=0)", "metal", _C.METAL, _C.TAIL,
        dielectric="coloured gloss",
    ),
    _recipe(DISTRIBUTIONS, f"cook-torrance({_GGX})", "gloss over matte", _C.BODY, _C.GLOSS, _C.TAIL),
    _recipe(
        DISTRIBUTIONS, f"cook-torrance({_GGX},fresnel=schlick)", "metal with diffuse light", _C.METAL, _C.MULTIPLE,
        _C.TAIL, dielectric="coloured gloss over matte",
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
