"""glTF 2.0: a metallic-roughness material on a sphere or its mesh.

It has the extensions KHR_materials_specular and _ior, and KHR_materials_anisotropy where the material has a direction.

Conventions of the specification (appendix B): `roughnessFactor` is √α, α the width of GGX as our `slope` with
`distribution=ggx`; masking is Smith's, F Schlick's. A dielectric reflects w F and lets 1 − w max F through to a
Lambertian body of albedo `baseColorFactor`, w = `specularFactor`; F at normal incidence is ((n−1)/(n+1))² ·
`specularColorFactor`. A metal has F = `baseColorFactor` there, and no body. Colours are linear, of Rec. 709; in a
texture they are sRGB. Of two widths the larger is α + (1 − α) `anisotropyStrength`², along the tangent turned by
`anisotropyRotation`. Metalness is the B of a texture, roughness its G, both linear.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from matest.brdf import Brdf
from matest.brdf.fresnel import schlick_weight
from matest.directions import Directions
from matest.errors import InputError
from matest.export.conversion import (
    Conversion,
    Family,
    Values,
    best_fit,
    check_channels,
    even_colour,
    is_isotropic,
    measured_error,
    own_f0,
    own_slopes,
)
from matest.export.facets import correlated_ggx, ggx_facets, is_pair, separate_ggx
from matest.export.gltf_file import Shape, save, sphere
from matest.export.gltf_textures import textures_of
from matest.export.lobes import METALLIC, Lobe, index_of, is_matte, lobes_of
from matest.export.textured import Textured

SUFFIX = ".glb"
_SUFFIXES = (".glb", ".gltf")


def write(material: Brdf, path: Path, *, textured: Textured | None = None) -> Conversion:
    """Write a material as glTF, and measure the error of the conversion.

    Args:
        material: of one or three channels.
        path: a `.glb` or `.gltf` file.
        textured: the material with its textures, where it has some: its mesh takes the place of the sphere.

    Raises:
        InputError: another number of channels, another suffix, or pygltflib is not installed.
        OSError: the file cannot be written.
    """
    check_channels(material, path, "glTF's RGB")
    if path.suffix.lower() not in _SUFFIXES:
        raise InputError(f"{path}: expected a name that ends in .glb or .gltf; give one with -o.")
    try:
        import pygltflib
    except ImportError:
        raise InputError(f'{path}: glTF needs pygltflib, which is not installed: pip install "matest-brdf[gltf]".')
    lobes = lobes_of(material)
    # Textures have a direction of their own at every texel, which no file says.
    turns = textured is None and not is_isotropic(material)
    exact = None if lobes is None else _values_of(lobes)
    if exact is not None:
        values: Values = exact
        error = measured_error(material, lambda wi, wo: reflectance(values, Directions(wi, wo)))
        notes = ["glTF has this lobe; roughnessFactor is the root of GGX's width."]
    else:
        # Masking is bounded where facets have two widths, and not where they have one: either may be nearer.
        fits = [best_fit(_families(material, lobes, turns=each), material) for each in {False, turns}]
        family, values, error = min(fits, key=lambda fit: fit[2].relative_rmse)
        notes = [f"glTF's {family.name} was fitted to the material; roughnessFactor is the root of GGX's width."]
    parameters = _parameters(values)
    textures = None if textured is None else textures_of(textured, values, reflectance)
    if textures is not None:
        error = textures.error
        parameters |= textures.factors
        notes += textures.notes
    extras = {
        "matest": {
            "model": material.expression,
            "relative_rmse": error.relative_rmse,
            "median": error.median,
            "note": " ".join(notes),
        }
    }
    shape = sphere(tangents=is_pair(values["alpha"])) if textured is None else Shape.of(textured.atlas)
    images = {} if textures is None else textures.images
    save(pygltflib, _material(parameters, path.stem, extras), path, shape, images)
    return Conversion(error, parameters, notes, (path,))


def reflectance(values: Values, directions: Directions) -> Tensor:
    """f of a glTF material [n, 3], by appendix B of the specification."""
    alpha = values["alpha"]
    # KHR_materials_anisotropy has correlated heights.
    masking = correlated_ggx(directions, alpha).clamp(max=1) if is_pair(alpha) else separate_ggx(directions, alpha)
    lobe = ggx_facets(directions, alpha) * masking
    rise = schlick_weight(directions.short_d)
    if "weight" not in values:
        return lobe * (values["base"] + (1 - values["base"]) * rise)
    f0 = (((values["ior"] - 1) / (values["ior"] + 1)).square() * values["colour"]).clamp(max=1)
    fresnel = f0 + (1 - f0) * rise
    through = 1 - values["weight"] * fresnel.amax(-1, keepdim=True)
    return through * values["base"] / math.pi + values["weight"] * fresnel * lobe


def _values_of(lobes: Sequence[Lobe]) -> dict[str, Tensor] | None:
    """Values of the glTF material that is one lobe: Lambert's, or of a GGX metal with Schlick's F."""
    if len(lobes) > 1:
        return None
    values, words = lobes[0].values, lobes[0].words
    one, zero = torch.ones((), dtype=torch.float64), torch.zeros((), dtype=torch.float64)
    if lobes[0].kind == "lambert" and float(values["albedo"].max()) <= 1:
        optics = {"ior": 1.5 * one, "colour": one.expand(3), "weight": zero}
        return {"base": values["albedo"].expand(3), "alpha": one, **optics}
    metal = {"distribution": "ggx", "masking": "smith", "fresnel": "schlick"}
    if lobes[0].kind == "microfacet" and words == metal and bool((values["specular"] == 1).all()):
        return {"base": values["f0"].expand(3), "alpha": values["slope"]}
    return None


def _families(material: Brdf, lobes: Sequence[Lobe] | None, *, turns: bool) -> list[Family]:
    """A dielectric over a Lambertian body, and a metal; the body alone for what is matte.

    `turns`: whether facets have two widths.
    """
    colour, f0 = even_colour(material).clamp(max=1), own_f0(material) or 0.04
    slopes = own_slopes(material, pairs_of=turns)
    one = torch.ones((), dtype=torch.float64)
    index = index_of(torch.tensor(f0 if f0 < METALLIC else 0.04, dtype=torch.float64))
    normal = float(((index - 1) / (index + 1)).square())
    coated = [{"base": colour, "alpha": slope, "weight": 0.9 * one, "colour": one.expand(3)} for slope in slopes]
    metals = [{"base": max(f0, 0.5) * one.expand(3), "alpha": slope} for slope in slopes]
    bounds = {"base": (0.0, 1.0), "alpha": (1e-3, 1.0)}
    further = {"weight": (0.0, 1.0), "colour": (0.0, 1 / normal)}
    if is_matte(lobes):
        plain = {"alpha": one, "ior": index, "colour": one.expand(3), "weight": torch.zeros_like(one)}
        return [Family("Lambertian body", reflectance, [{"base": colour}], {"base": (0.0, 1.0)}, plain)]
    return [
        Family("dielectric over a Lambertian body", reflectance, coated, bounds | further, {"ior": index}),
        Family("metal", reflectance, metals, bounds),
    ]


def _parameters(values: Values) -> dict[str, Any]:
    """The values by glTF's names."""
    parameters = {
        "baseColorFactor": [*values["base"].tolist(), 1.0],
        "metallicFactor": 0.0 if "weight" in values else 1.0,
        "roughnessFactor": float(values["alpha"].min().sqrt()),
    }
    if is_pair(values["alpha"]):
        along, across = values["alpha"].tolist()
        least = min(along, across)
        parameters |= {
            "anisotropyStrength": math.sqrt((max(along, across) - least) / (1 - least)) if least < 1 else 0.0,
            "anisotropyRotation": 0.0 if along >= across else 0.5 * math.pi,
        }
    if "weight" in values:
        parameters |= {
            "specularFactor": float(values["weight"]),
            "specularColorFactor": values["colour"].tolist(),
            "ior": float(values["ior"]),
        }
    return parameters


def _material(parameters: dict[str, Any], name: str, extras: dict[str, Any]) -> dict[str, Any]:
    """The entry of a glTF file."""
    specular = {key: parameters[key] for key in ("specularFactor", "specularColorFactor") if key in parameters}
    anisotropy = {key: parameters[key] for key in ("anisotropyStrength", "anisotropyRotation") if key in parameters}
    extensions: dict[str, Any] = {"KHR_materials_anisotropy": anisotropy} if anisotropy else {}
    if specular:
        extensions |= {"KHR_materials_specular": specular, "KHR_materials_ior": {"ior": parameters["ior"]}}
    return {
        "name": name,
        "pbrMetallicRoughness": {
            key: parameters[key] for key in ("baseColorFactor", "metallicFactor", "roughnessFactor")
        },
        "extensions": extensions,
        "extras": extras,
    }
