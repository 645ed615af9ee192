"""MaterialX 1.39: nodes of its physically based library, joined to a material.

Conventions: `roughness` of the surface nodes is the width α of GGX, a pair for tangent and bitangent, as our `slope`
with `distribution=ggx`; `roughness` of `oren_nayar_diffuse_bsdf` is σ in radians of Oren and Nayar's eq. 17, and with
`energy_compensation` the r of EON; `color` is the albedo, linear (`lin_rec709`). As its GLSL evaluates them, masking is
Smith's with correlated heights, and the lobe gets back what a single reflection loses: 1 + F (1 − E)/E, with E the
albedo of a white lobe toward the viewer; of two widths both take the geometric mean.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import torch
from torch import Tensor

from matest.brdf import Brdf, Eon, OrenNayarQualitative
from matest.brdf.fresnel import dielectric, schlick_weight
from matest.directions import Directions, from_angles
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
from matest.export.facets import ggx_facets, is_pair, pair
from matest.export.lobes import METALLIC, Lobe, index_of, is_matte, lobes_of
from matest.shading import SKY_COSINES, interpolate

SUFFIX = ".mtlx"
_VERSION = "1.39"
_COLOUR_SPACE = "lin_rec709"
# Gauss-Legendre nodes over polar angle and azimuth of the facets: the albedo of a white lobe is exact to 1e-3.
_NODES = 16
# Bodies of `oren_nayar_diffuse_bsdf`, and how each names its roughness.
_BODIES = {"lambert": None, "oren-nayar-qualitative": "sigma", "eon": "diffuse_roughness"}
# What the roughness of a body is.
_ROUGHNESS = {"oren-nayar-qualitative": "roughness of the body is σ in rad", "eon": "roughness of the body is EON's r"}
# Inputs of the nodes `body` and `surface`, by our names of their values.
_INPUTS = {
    "color": "body_color",
    "diffuse_roughness": "body_roughness",
    "alpha": "surface_roughness",
    "ior": "surface_ior",
    "color0": "surface_color0",
    "tint": "surface_tint",
}
# The input of each surface that says how much it reflects, beside `tint` of a dielectric.
_OPTICS = {"dielectric_bsdf": "ior", "generalized_schlick_bsdf": "color0"}


def write(material: Brdf, path: Path) -> Conversion:
    """Write a material as a MaterialX document, and measure the error of the conversion.

    Raises:
        InputError: another number of channels than one or three.
        OSError: the file cannot be written.
    """
    check_channels(material, path, "MaterialX's color3")
    lobes = lobes_of(material)
    exact = None if lobes is None else _body_of(lobes)
    surface = ""
    if exact is not None:
        body, values = exact
        error = measured_error(material, lambda wi, wo: reflectance(body, "", values, Directions(wi, wo)))
        notes = [f"MaterialX has this lobe: {_ROUGHNESS[body]}."]
    else:
        family, values, error = best_fit(_families(material, lobes), material)
        body, _, surface = family.name.partition("+")
        facets = "; roughness of the surface is the width of GGX" if surface else ""
        notes = [f"MaterialX's {_spoken(body, surface)} fitted to the material: {_ROUGHNESS[body]}{facets}."]
    parameters: dict[str, Any] = {_INPUTS[name]: value.tolist() for name, value in values.items()}
    parameters["body_energy_compensation"] = body == "eon"
    doc = f"{material.expression} by matest; error of the conversion {error}. {' '.join(notes)}"
    _document(body, surface, values, re.sub(r"\W", "_", path.stem), doc, path)
    return Conversion(error, parameters, notes, (path,))


def reflectance(body: str, surface: str, values: Values, directions: Directions) -> Tensor:
    """f of a body, and a surface where it names one [n, 3], as MaterialX's GLSL evaluates them."""
    rough = values["diffuse_roughness"]
    model = Eon(values["color"], rough) if body == "eon" else OrenNayarQualitative(values["color"], rough)
    total = model.evaluate(directions)
    if not surface:
        return total
    alpha = values["alpha"]
    if surface == "dielectric_bsdf":
        fresnel = dielectric(directions.cos_d, ((values["ior"] - 1) / (values["ior"] + 1)).square())
    else:
        fresnel = values["color0"] + (1 - values["color0"]) * schlick_weight(directions.short_d)
    mean = alpha.prod().sqrt() if is_pair(alpha) else alpha
    white = interpolate(_white_albedo(mean), directions.cos_o)
    lobe = ggx_facets(directions, alpha) * _correlated(directions.cos_i, directions.cos_o, mean)
    tint = values.get("tint", torch.ones(3, dtype=torch.float64))
    return total + tint * fresnel * lobe * (1 + fresnel * (1 - white) / white)


def _correlated(cos_i: Tensor, cos_o: Tensor, alpha: Tensor) -> Tensor:
    """G/(4 cos θi cos θr), Smith's masking with correlated heights (Heitz 2014, eq. 99)."""
    a2 = alpha * alpha
    toward, away = ((a2 + (1 - a2) * cos * cos).sqrt() for cos in (cos_i, cos_o))
    return 0.5 / (toward * cos_o + away * cos_i)


@cache
def _facets() -> tuple[Tensor, Tensor, Tensor]:
    """Nodes in the unit square [16, 16], and their weights [256]."""
    x, weight = np.polynomial.legendre.leggauss(_NODES)
    u, v = (torch.from_numpy(part) for part in np.meshgrid((x + 1) / 2, (x + 1) / 2, indexing="ij"))
    return u, v, torch.from_numpy(np.outer(weight, weight).reshape(-1) / 4)


def _white_albedo(alpha: Tensor) -> Tensor:
    """Albedo [33, 1] of GGX with F = 1 toward viewers at evenly spaced cosines, over facets drawn by their density."""
    u, v, shares = _facets()
    half = from_angles((alpha * (u / (1 - u)).sqrt()).atan(), math.pi * v).reshape(-1, 3)
    cos_o = torch.linspace(0, 1, SKY_COSINES, dtype=torch.float64).clamp(min=0.02)[:, None]
    sin_o = (1 - cos_o * cos_o).sqrt()
    along = sin_o * half[:, 0] + cos_o * half[:, 2]
    cos_i = (2 * along * half[:, 2] - cos_o).clamp(min=0)
    # D cos α dωh has become the measure, and dω = 4 (V·H) dωh.
    values = 4 * _correlated(cos_i, cos_o, alpha) * cos_i * along.clamp(min=0) / half[:, 2]
    return (values * shares).sum(-1, keepdim=True).clamp(0.05, 1)


def _body_of(lobes: Sequence[Lobe]) -> tuple[str, Values] | None:
    """Body and values of the diffuse node that is the one lobe; None where it is not."""
    if len(lobes) > 1 or lobes[0].kind not in _BODIES:
        return None
    body, values = lobes[0].kind, lobes[0].values
    rough = _BODIES[body]
    spread = values[rough].mean() if rough else torch.zeros((), dtype=torch.float64)
    kind = "eon" if body == "eon" else "oren-nayar-qualitative"
    return kind, {"color": values["albedo"].expand(3), "diffuse_roughness": spread}


def _families(material: Brdf, lobes: Sequence[Lobe] | None) -> list[Family]:
    """Bodies of both kinds, each with a dielectric and with a metallic surface; without, where there is none."""
    kinds = {lobe.kind for lobe in lobes} if lobes is not None else {"unknown"}
    smooth = kinds <= {"lambert", "microfacet", "ward"}
    colour, f0 = even_colour(material), own_f0(material) or 0.04
    smooth_body, rough_body = (torch.tensor(value, dtype=torch.float64) for value in (0.0, 0.3))
    slopes = own_slopes(material, pairs_of=not is_isotropic(material))
    one = torch.ones(3, dtype=torch.float64)
    held = {"diffuse_roughness": smooth_body} if smooth else {}
    first = {"color": colour.clamp(max=1)} | ({} if smooth else {"diffuse_roughness": rough_body})
    families = []
    for body, widest in (("oren-nayar-qualitative", 0.5 * math.pi), ("eon", 1.0)):
        bounds = {"color": (0.0, math.inf if body != "eon" else 1.0)}
        bounds |= {} if smooth else {"diffuse_roughness": (0.0, widest)}
        if is_matte(lobes):
            families.append(_family(body, "", [first], bounds, held))
            continue
        starts = [{**first, "alpha": slope} for slope in slopes]
        bounds["alpha"] = (1e-3, 1.0)
        index = index_of(torch.tensor(f0 if f0 < METALLIC else 0.04, dtype=torch.float64))
        coated = [{**start, "tint": one} for start in starts]
        metals = [{**start, "color0": max(f0, 0.5) * one} for start in starts]
        families += [
            _family(body, "dielectric_bsdf", coated, bounds | {"tint": (0.0, math.inf)}, {**held, "ior": index}),
            _family(body, "generalized_schlick_bsdf", metals, bounds | {"color0": (0.0, 1.0)}, held),
        ]
        if smooth:
            # With σ = 0 both bodies are Lambert's.
            break
    return families


def _family(
    body: str, surface: str, starts: Sequence[Values], bounds: Mapping[str, tuple[float, float]], held: Values
) -> Family:
    def member(values: Values, directions: Directions) -> Tensor:
        return reflectance(body, surface, values, directions)

    return Family(f"{body}+{surface}" if surface else body, member, starts, bounds, held)


def _spoken(body: str, surface: str) -> str:
    diffuse = "oren_nayar_diffuse_bsdf" + (" with energy_compensation" if body == "eon" else "")
    return f"{diffuse} and {surface} were" if surface else f"{diffuse} was"


def _document(body: str, surface: str, values: Values, name: str, doc: str, path: Path) -> None:
    root = ElementTree.Element("materialx", version=_VERSION, colorspace=_COLOUR_SPACE)
    node = _node(root, "oren_nayar_diffuse_bsdf", "body", "BSDF")
    _input(node, "color", "color3", values["color"])
    _input(node, "roughness", "float", values["diffuse_roughness"])
    ElementTree.SubElement(node, "input", name="energy_compensation", type="boolean", value=str(body == "eon").lower())
    whole = "body"
    if surface:
        node = _node(root, surface, "surface", "BSDF")
        optics = _OPTICS[surface]
        _input(node, optics, "float" if optics == "ior" else "color3", values[optics])
        if "tint" in values:
            _input(node, "tint", "color3", values["tint"])
        _input(node, "roughness", "vector2", torch.tensor(pair(values["alpha"])))
        # Ours add up; a layer would dim the body below the surface.
        node = _node(root, "add", "sum", "BSDF")
        for place, lobe in enumerate(("body", "surface"), 1):
            _link(node, f"in{place}", "BSDF", lobe)
        whole = "sum"
    _link(_node(root, "surface", "shader", "surfaceshader"), "bsdf", "BSDF", whole)
    last = _node(root, "surfacematerial", f"{name}_material", "material")
    last.set("doc", doc)
    _link(last, "surfaceshader", "surfaceshader", "shader")
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(path, "utf-8", xml_declaration=True)


def _node(root: ElementTree.Element, category: str, name: str, kind: str) -> ElementTree.Element:
    return ElementTree.SubElement(root, category, name=name, type=kind)


def _input(node: ElementTree.Element, name: str, kind: str, value: Tensor) -> None:
    text = ", ".join(f"{number:.9g}" for number in value.flatten().tolist())
    ElementTree.SubElement(node, "input", name=name, type=kind, value=text)


def _link(node: ElementTree.Element, name: str, kind: str, source: str) -> None:
    ElementTree.SubElement(node, "input", name=name, type=kind, nodename=source)
