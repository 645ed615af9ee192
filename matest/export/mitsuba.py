"""Mitsuba 3: a BSDF in a scene file, to include or to load; where Mitsuba lacks the lobes, with a plugin beside it.

A material with textures is a shape in the file: the mesh with the BSDF, whose values are bitmaps in linear EXR.

Conventions: `alpha` of `roughconductor` is the slope m of Beckmann's D = exp(−tan²α/m²)/(π m² cos⁴α), and the width of
GGX; `alpha_u` and `alpha_v` are those along u and v of the surface. `reflectance` is an albedo; F is that of an index
n − ik, of a dielectric with k = 0; masking is Smith's, for Beckmann by Walter's rational function. A `blendbsdf` weighs
each of two lobes by half, so that both are doubled.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import torch
from torch import Tensor

from matest.brdf import Brdf
from matest.brdf.fresnel import conductor
from matest.directions import Directions
from matest.errors import InputError
from matest.export.conversion import (
    Conversion,
    ConversionError,
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
from matest.export.facets import beckmann_facets, ggx_facets, is_pair, reach, separate_ggx
from matest.export.lobes import METALLIC, Lobe, index_of, lobes_of
from matest.export.textured import Textured
from matest.photographs.images import write_image

SUFFIX = ".xml"
# The mesh beside a scene with textures.
MESH_SUFFIX = ".obj"
# The plugin beside a scene.
PLUGIN = "matest_bsdf.py"
_VERSION = "3.0.0"
# Values that the plugin reads as colours.
_COLOURS = {"albedo", "specular", "k", "f0", "eta", "extinction"}
_DISTRIBUTIONS = ("beckmann", "ggx")


def write(material: Brdf, path: Path, *, fitted: bool = False, textured: Textured | None = None) -> Conversion:
    """Write a material as a BSDF of Mitsuba 3, and measure the error of the conversion.

    Args:
        material: of one or three channels.
        path: the `.xml` file.
        fitted: whether Mitsuba's own lobes are fitted where it lacks the material's; otherwise a plugin that has them
            is written beside the file, where there is one.
        textured: the material with its textures, where it has some; they do not go with `fitted`.

    Raises:
        InputError: another number of channels, or textures of a material that must be fitted.
        OSError: a file cannot be written.
    """
    check_channels(material, path, "Mitsuba's RGB")
    lobes = lobes_of(material)
    native = None if lobes is None else _native(lobes)
    if textured is not None and (lobes is None or (fitted and native is None)):
        raise InputError(
            f"{path}: Mitsuba's lobes must be fitted to {material.expression}, which gives no textures; write them "
            "with --to textures, or the means of the maps with --fitted."
        )
    bitmaps = None if textured is None else _Bitmaps(path, textured)
    if lobes is not None and native is None and not fitted:
        return _with_plugin(material, lobes, path, bitmaps)
    if native is not None:
        values: Values = native
        error = measured_error(material, lambda wi, wo: _reflectance(values, Directions(wi, wo)))
        notes = ["Mitsuba has these lobes: alpha is the slope m, reflectance the albedo."]
    else:
        family, values, error = best_fit(_families(material), material)
        notes = [f"Mitsuba's diffuse and {family.name} were fitted to the material; alpha is a slope."]
    distribution = {"distribution": _distribution(values)} if "alpha" in values else {}
    if bitmaps is not None:
        values = _native(bitmaps.lobes) or values
    parameters: dict[str, Any] = {key: _listed(value) for key, value in values.items() if key != "ggx"} | distribution
    root = _bsdf(values, bitmaps)
    remarks = [f"{material.expression} by matest; error of the conversion {error}.", *notes]
    return Conversion(error, parameters, notes, _write(root, path, remarks, bitmaps))


def _listed(value: Tensor) -> Any:
    """A value for people to read: of a texture its mean."""
    return value.mean(0).tolist() if value.ndim > 1 else value.tolist()


def _native(lobes: Sequence[Lobe]) -> dict[str, Tensor] | None:
    """Values of Mitsuba's `diffuse` and `roughconductor` that are these lobes; None where they are not."""
    bodies = [lobe for lobe in lobes if lobe.kind == "lambert"]
    surfaces = [lobe for lobe in lobes if lobe.kind == "microfacet" and _is_native(lobe)]
    if len(bodies) > 1 or len(surfaces) > 1 or len(bodies) + len(surfaces) < len(lobes):
        return None
    values = {"diffuse": _rgb(bodies[0].values["albedo"])} if bodies else {}
    for lobe in surfaces:
        values |= {"specular": _rgb(lobe.values["specular"]), "alpha": lobe.values["slope"]}
        values["ggx"] = torch.tensor(lobe.words["distribution"] == "ggx")
        if lobe.words["fresnel"] == "conductor":
            values |= {"eta": _rgb(lobe.values["eta"]), "k": _rgb(lobe.values["extinction"])}
        else:
            index = _rgb(index_of(lobe.values["f0"]))
            values |= {"eta": index, "k": torch.zeros_like(index)}
    return values


def _rgb(value: Tensor) -> Tensor:
    """A value in three channels, [3] or at texels [T, 3]."""
    return value.expand(*value.shape[:-1], 3)


def _is_native(lobe: Lobe) -> bool:
    words = lobe.words
    smith = words["masking"] == "smith" and words["distribution"] in _DISTRIBUTIONS
    return smith and words["fresnel"] in ("dielectric", "conductor")


def _distribution(values: Values) -> str:
    return _DISTRIBUTIONS[int(values.get("ggx", torch.tensor(False)))]


def _reflectance(values: Values, directions: Directions) -> Tensor:
    """f of Mitsuba's `diffuse` and `roughconductor` [n, 3]."""
    total = values["diffuse"] / math.pi if "diffuse" in values else torch.zeros(3, dtype=torch.float64)
    total = total.expand(len(directions.cos_i), 3)
    if "alpha" not in values:
        return total
    alpha = values["alpha"]
    if _distribution(values) == "ggx":
        lobe = ggx_facets(directions, alpha) * separate_ggx(directions, alpha)
    else:
        cosines = (directions.cos_i, directions.cos_o)
        sides = zip(cosines, reach(directions, alpha), strict=True)
        toward, away = (_walter(cos / slanted) for cos, slanted in sides)
        lobe = beckmann_facets(directions, alpha) * toward * away / (4 * cosines[0] * cosines[1])
    return total + values["specular"] * lobe * conductor(directions.cos_d, values["eta"], values["k"])


def _walter(a: Tensor) -> Tensor:
    """Smith's G1 of a Beckmann surface at a = 1/(α tan θ) by the rational function of Walter et al. 2007."""
    a2 = a * a
    return torch.where(a < 1.6, (3.535 * a + 2.181 * a2) / (1 + 2.276 * a + 2.577 * a2), 1.0)


def _families(material: Brdf) -> list[Family]:
    """`diffuse` with a rough dielectric or a rough conductor of either distribution."""
    colour, f0 = even_colour(material), own_f0(material) or 0.04
    slopes = own_slopes(material, pairs_of=not is_isotropic(material))
    index = index_of(torch.tensor(f0 if f0 < METALLIC else 0.04, dtype=torch.float64)).expand(3)
    metal_k = 2 * torch.tensor(max(f0, 0.5) / (1 - min(max(f0, 0.5), 0.99)), dtype=torch.float64).sqrt().expand(3)
    one, zero = torch.ones(3, dtype=torch.float64), torch.zeros(3, dtype=torch.float64)
    bounds = {"diffuse": (0.0, math.inf), "alpha": (1e-3, 1.0)}
    families = []
    for kind in _DISTRIBUTIONS:
        held = {"ggx": torch.tensor(kind == "ggx")}
        starts = [{"diffuse": colour, "alpha": slope} for slope in slopes]
        coated = [start | {"specular": one} for start in starts]
        metals = [start | {"eta": one, "k": metal_k} for start in starts]
        families += [
            Family(
                f"rough dielectric ({kind})", _reflectance, coated, bounds | {"specular": (0.0, math.inf)},
                held | {"eta": index, "k": zero},
            ),
            Family(
                f"rough conductor ({kind})", _reflectance, metals, bounds | {"eta": (0.05, 10.0), "k": (0.0, 12.0)},
                held | {"specular": one},
            ),
        ]  # fmt: skip
    return families


class _Bitmaps:
    """The files of textures and mesh beside a scene."""

    def __init__(self, path: Path, textured: Textured) -> None:
        self._path, self._textured = path, textured
        self.lobes = lobes_of(textured.at_texels) or []
        self.files: list[Path] = []

    def save_mesh(self) -> Path:
        """Write the mesh, and name its file."""
        mesh = self._path.with_suffix(MESH_SUFFIX)
        self._textured.atlas.save(mesh)
        self.files.append(mesh)
        return mesh

    def element(self, parent: ElementTree.Element, name: str, value: Tensor) -> None:
        """A bitmap of numbers [T, 1] or colours [T, 3] at texels."""
        file = self._path.with_name(f"{self._path.stem}_{name}.exr")
        size = self._textured.size
        write_image(file, value.reshape(size, size, -1).float().numpy())
        self.files.append(file)
        texture = ElementTree.SubElement(parent, "texture", type="bitmap", name=name)
        ElementTree.SubElement(texture, "string", name="filename", value=file.name)
        ElementTree.SubElement(texture, "string", name="wrap_mode", value="clamp")
        # Variants with spectra make them of colours, unless these are raw.
        ElementTree.SubElement(texture, "boolean", name="raw", value="true" if value.shape[1] == 1 else "false")


def _bsdf(values: Values, bitmaps: _Bitmaps | None) -> ElementTree.Element:
    """The BSDF of `_reflectance`: one plugin, or a blend of two."""
    body, surface = "diffuse" in values, "alpha" in values
    if not (body and surface):
        return _surface(values, 1.0, bitmaps) if surface else _body(values, 1.0, bitmaps)
    blend = ElementTree.Element("bsdf", type="blendbsdf")
    ElementTree.SubElement(blend, "float", name="weight", value="0.5")
    blend.extend([_body(values, 2.0, bitmaps), _surface(values, 2.0, bitmaps)])
    return blend


def _body(values: Values, scale: float, bitmaps: _Bitmaps | None) -> ElementTree.Element:
    element = ElementTree.Element("bsdf", type="diffuse")
    _unbounded(element, "reflectance", scale * values["diffuse"], bitmaps)
    return element


def _surface(values: Values, scale: float, bitmaps: _Bitmaps | None) -> ElementTree.Element:
    element = ElementTree.Element("bsdf", type="roughconductor")
    ElementTree.SubElement(element, "string", name="distribution", value=_distribution(values))
    alpha = values["alpha"]
    if is_pair(alpha):
        for name, along in zip(("alpha_u", "alpha_v"), alpha, strict=True):
            _plain(element, "float", name, along, bitmaps)
    else:
        _plain(element, "float", "alpha", alpha, bitmaps)
    for name in ("eta", "k"):
        _plain(element, "rgb", name, values[name], bitmaps)
    _unbounded(element, "specular_reflectance", scale * values["specular"], bitmaps)
    return element


def _plain(parent: ElementTree.Element, kind: str, name: str, value: Tensor, bitmaps: _Bitmaps | None) -> None:
    """A number or colour, or the bitmap of one."""
    if value.ndim > 1 and bitmaps is not None:
        bitmaps.element(parent, name, value)
    else:
        ElementTree.SubElement(parent, kind, name=name, value=_text(value))


def _unbounded(parent: ElementTree.Element, name: str, colour: Tensor, bitmaps: _Bitmaps | None) -> None:
    """A colour that may exceed 1, which `<rgb>` refuses in reflectances, or the bitmap of one."""
    if colour.ndim > 1 and bitmaps is not None:
        bitmaps.element(parent, name, colour)
        return
    texture = ElementTree.SubElement(parent, "texture", type="srgb", name=name)
    ElementTree.SubElement(texture, "rgb", name="color", value=_text(colour))
    ElementTree.SubElement(texture, "boolean", name="unbounded", value="true")


def _text(value: Tensor) -> str:
    return " ".join(f"{number:.9g}" for number in value.flatten().tolist())


def _with_plugin(material: Brdf, lobes: Sequence[Lobe], path: Path, bitmaps: _Bitmaps | None) -> Conversion:
    """Write the lobes by the names of the plugin, and the plugin beside them."""
    root = ElementTree.Element("bsdf", type="matest")
    parameters: dict[str, object] = {}
    for number, lobe in enumerate(lobes if bitmaps is None else bitmaps.lobes):
        head = f"lobe_{number}"
        parameters[head] = lobe.kind
        ElementTree.SubElement(root, "string", name=head, value=lobe.kind)
        for name, word in lobe.words.items():
            ElementTree.SubElement(root, "string", name=f"{head}_{name}", value=word)
        for name, value in lobe.values.items():
            colour = name in _COLOURS
            numbers = _rgb(value) if colour else value if value.ndim > 1 else value.mean()
            _plain(root, "rgb" if colour else "float", f"{head}_{name}", numbers, bitmaps)
            parameters[f"{head}_{name}"] = _listed(numbers)
    notes = [
        f"Mitsuba lacks these lobes: import {Path(PLUGIN).stem} after set_variant() and before loading the file. It "
        "evaluates the material's own equations, in single precision."
    ]
    # The same equations with the same values.
    error = ConversionError(0.0, 0.0)
    files = _write(root, path, [f"{material.expression} by matest.", *notes], bitmaps)
    plugin = path.with_name(PLUGIN)
    plugin.write_text(Path(__file__).with_name("mitsuba_plugin.py").read_text("utf-8"), "utf-8")
    return Conversion(error, parameters, notes, (path, plugin, *files[1:]))


def _write(root: ElementTree.Element, path: Path, remarks: Sequence[str], bitmaps: _Bitmaps | None) -> tuple[Path, ...]:
    """Write the file, and of textures the mesh around the BSDF; all files, that of the scene first."""
    if bitmaps is not None:
        shape = ElementTree.Element("shape", type="obj")
        ElementTree.SubElement(shape, "string", name="filename", value=bitmaps.save_mesh().name)
        shape.append(root)
        root = shape
    root.set("version", _VERSION)
    root.set("id", path.stem)
    root.insert(0, ElementTree.Comment(" " + " ".join(remarks).replace("--", "- -") + " "))
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(path, "utf-8", xml_declaration=False)
    with path.open("a", encoding="utf-8") as file:
        file.write("\n")
    return (path, *(bitmaps.files if bitmaps is not None else ()))
