"""Relighting: the material on the object's own normals, ready for the shader of the page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize

from matest.brdf import Brdf
from matest.directions import to_local
from matest.estimation.result import Estimate
from matest.report.assets import asset
from matest.report.baking import SIDE_NODES, TOP, BakedMaterial, bake
from matest.report.document import data_block
from matest.report.format import measured
from matest.report.html import escape
from matest.report.packing import packed
from matest.report.raster import Raster
from matest.scene import DirectionalLight, EnvironmentLight, Light, Scene, Surface
from matest.scene.surface import from_sphere

# Steps from −1 to 1 of the components of normals: a highlight of slope 0.1 shows none of them.
NORMAL_STEPS = 2047
# Steps from 0 to the largest value of a map.
MAP_STEPS = 4095
# Step of tables on their scale, on which 0.01 is 1 %.
TABLE_STEP = 0.002
# The brightest pixels under the first light, the highlight's apart, get this share of full scale.
EXPOSURE = 0.8
# Share of the pixels that are no highlight.
_BELOW_HIGHLIGHT = 0.995
# Normals that tell it.
_MAX_JUDGED = 4000
# Light of captures without any, to the right of the viewer and above; unit length.
_FROM_ABOVE = (0.36, 0.48, 0.8)
# Side of the picture of a sphere, pixels.
SPHERE_SIDE = 240
# Its radius.
SPHERE_RADIUS = 112.0
# Channels that a screen has colours for.
_COLOURS = (1, 3)


@dataclass(frozen=True, eq=False)
class Relighting:
    """A material on an object, seen from afar, under one distant light.

    Attributes:
        shape: height and width of the picture.
        pixels: of it that show the object, flat, ascending [n].
        normals: there, as they are stored [n, 3]: x right, y up, z to the viewer.
        material: with maps, at these pixels.
        baked: the same as tables.
        lights: directions to the light of each photograph, as `normals` [K, 3].
        irradiance: on a surface facing the light [1 or 3].
        white: radiance of full scale.
    """

    shape: tuple[int, int]
    pixels: np.ndarray
    normals: Tensor
    material: Brdf
    baked: BakedMaterial
    lights: Tensor
    irradiance: Tensor
    white: float

    def radiance(self, light: Tensor, changes: Mapping[str, Tensor] | None = None) -> Tensor:
        """Radiance [n, C] under a light from unit vector `light` [3], by the model itself and not its tables."""
        return _radiance(self.material.replace(changes or {}), self.normals, light, self.irradiance)


def relighting(estimate: Estimate, scene: Scene, raster: Raster) -> Relighting | str:
    """The material of an estimate on the surface that a raster shows; a sentence where it cannot be relit."""
    surface = scene.surface
    material = estimate.material
    if material.structure.anisotropic:
        return "No relighting: the model is anisotropic, and tables of it would need a fourth angle."
    if scene.channels not in _COLOURS:
        return f"No relighting: a screen has no colours for {scene.channels} channels."
    if not len(raster.index):
        return "No relighting: the object is too thin to be seen in a preview."
    maps = {name: value for name, value in material.parameters.items() if value.ndim > 1}
    some = torch.from_numpy(raster.index.astype(np.int64))
    values = {name: value[some].double() for name, value in maps.items()}
    means = {name: value.double().nanmean(dim=0) for name, value in maps.items()}
    shown = {
        name: torch.where(value.isnan(), means[name], value).clamp(min=0).nan_to_num() for name, value in values.items()
    }
    ranges = {name: (value.amin(0), value.amax(0)) for name, value in shown.items()}
    frame = viewer_frame(surface, raster.index)
    middle = None if surface.positions is None else surface.positions[some].double().mean(0, keepdim=True)
    normals = _stored(facing_normals(surface, frame, raster.index))
    lights = torch.stack([_main_light(lights, middle, frame)[0] for lights in scene.lights])
    irradiance = _main_light(scene.lights[0], middle, frame)[1]
    relit = Relighting(
        shape=raster.shape,
        pixels=np.flatnonzero(raster.sources < len(raster.index)),
        normals=normals,
        material=material.replace(shown),
        baked=bake(material.replace(means), ranges),
        lights=lights,
        irradiance=irradiance,
        white=1.0,
    )
    return _exposed(relit)


def relit_sphere(estimate: Estimate) -> Relighting | str:
    """The material of an estimate without photographs on a sphere, lit from above on the right."""
    surface = from_sphere((SPHERE_SIDE, SPHERE_SIDE), (SPHERE_SIDE / 2, SPHERE_SIDE / 2), SPHERE_RADIUS, None)
    light = DirectionalLight(torch.tensor(_FROM_ABOVE, dtype=torch.float64), torch.full((1,), math.pi).double())
    ambient = torch.zeros(1, estimate.channels, dtype=torch.float64)
    return relighting(estimate, Scene(surface, ((light,),), ambient), Raster.of(surface, 1))


def _exposed(relit: Relighting) -> Relighting:
    """With the white of its brightest pixels under the first light."""
    some = torch.from_numpy(np.linspace(0, len(relit.normals) - 1, min(_MAX_JUDGED, len(relit.normals))).astype(int))
    at = {name: value[some] for name, value in relit.material.parameters.items() if value.ndim > 1}
    bright = _radiance(relit.material.replace(at), relit.normals[some], relit.lights[0], relit.irradiance).amax(-1)
    return replace(relit, white=float(bright.quantile(_BELOW_HIGHLIGHT)) or 1.0)


def _radiance(material: Brdf, normals: Tensor, light: Tensor, irradiance: Tensor) -> Tensor:
    """Radiance [n, C] toward z of a material on some normals [n, 3] under a light of some irradiance [C] from [3]."""
    viewer = torch.tensor([[0.0, 0.0, 1.0]], dtype=normals.dtype)
    wi, wo = to_local(normals, light.to(normals)[None], viewer)
    with torch.no_grad():
        return material(wi, wo) * wi[:, 2:].clamp(min=0) * irradiance


def viewer_frame(surface: Surface, index: np.ndarray) -> Tensor:
    """Unit vectors to the right, upward and to the viewer of an image of some pixels, in world coordinates [3, 3]."""
    some = torch.from_numpy(index.astype(np.int64))
    toward = normalize(surface.toward_viewer(some).detach().double().mean(0), dim=0)
    right = torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64)
    if surface.positions is not None and len(index) > 1:
        # Across the line of sight positions are linear in the pixels: least squares gives the world's step of a column.
        positions = surface.positions[some].double()
        across = positions - (positions @ toward)[:, None] * toward
        rows, columns = np.divmod(surface.pixels[index].astype(np.float64), surface.shape[1])
        places = torch.from_numpy(np.stack([columns - columns.mean(), rows - rows.mean()], axis=-1))
        step = (torch.linalg.pinv(places.T @ places) @ (places.T @ across))[0]
        right = step if bool(step.norm() > 0) else right
    right = normalize(right - (right @ toward) * toward, dim=0)
    return torch.stack([right, torch.linalg.cross(toward, right), toward])


def facing_normals(surface: Surface, frame: Tensor, index: np.ndarray) -> Tensor:
    """Normals [n, 3] of some pixels, each turned with its viewer so that this one is at z.

    Angles between normal and viewer then are what they are in the image, also near a perspective camera.
    """
    some = torch.from_numpy(index.astype(np.int64))
    normals, view = surface.normals[some].double() @ frame.T, surface.toward_viewer(some).detach().double() @ frame.T
    ahead = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    between = view + ahead
    turned = normals - ((normals * between).sum(-1) / between[..., 2])[:, None] * between
    return turned + 2 * (normals * view).sum(-1)[:, None] * ahead


def _codes(normals: Tensor) -> Tensor:
    """x and y of normals as integers from 0 to NORMAL_STEPS − 1 [n, 2]."""
    return ((normals[:, :2] + 1) * (NORMAL_STEPS - 1) / 2).round()


def _stored(normals: Tensor) -> Tensor:
    """Unit normals [n, 3] as the page stores them."""
    across = 2 * _codes(normals) / (NORMAL_STEPS - 1) - 1
    toward = (1 - across.square().sum(-1, keepdim=True)).clamp(min=0).sqrt()
    return normalize(torch.cat([across, toward], dim=-1), dim=-1)


def _main_light(lights: Sequence[Light], middle: Tensor | None, frame: Tensor) -> tuple[Tensor, Tensor]:
    """Direction in a frame [3] and irradiance [C] of the strongest light at the middle of the object [1, 3].

    The viewer is at z of that frame; a map counts as what of it stands before the object.
    """
    at = [_one_light(light.to(torch.float64, "cpu"), middle, frame[2]) for light in lights]
    if not at:
        return torch.tensor(_FROM_ABOVE, dtype=torch.float64), torch.full((1,), math.pi, dtype=torch.float64)
    direction, power = max(at, key=lambda one: float(one[1].sum()))
    return frame @ direction.detach(), power.detach()


def _one_light(light: Light, middle: Tensor | None, viewer: Tensor) -> tuple[Tensor, Tensor]:
    """Direction [3] and irradiance [C] of a light, as seen from the middle of the object [1, 3]."""
    if isinstance(light, EnvironmentLight):
        return light.before(viewer)
    direction, power = light.at(middle)
    return direction[0], power[0]


def relight_section(estimate: Estimate, relit: Relighting | str | None, names: Sequence[str]) -> str:
    """The section of the page with the data of its shader; empty without pictures."""
    if relit is None:
        return ""
    if isinstance(relit, str):
        return f"<p>{escape(relit)}</p>"
    height, width = relit.shape
    return (
        '<p class="lead">Drag the light over the object, or focus the picture and use the arrow keys. One distant '
        "light, without cast shadows or light of the sky, at first the strongest of a photograph, or what lights most "
        "of a map before the object; colours are sRGB, at one exposure for all directions. "
        "Several sliders at once are exact where the model is a product of what each of them changes.</p>\n"
        f'<div class="relight" id="relight"><div class="stage"><canvas width="{width}" height="{height}" tabindex="0" '
        'role="application" aria-label="the object under a light that arrow keys move"></canvas>'
        '<span class="lamp" aria-hidden="true"></span></div>'
        '<form class="sliders" autocomplete="off"></form><p class="reading" role="status"></p></div>\n'
        f"{data_block('relight-data', _content(estimate, relit, names))}"
        f'<script type="x-shader/x-fragment" id="relight-shader">{asset("relight.glsl")}</script>'
    )


def _content(estimate: Estimate, relit: Relighting, names: Sequence[str]) -> dict[str, Any]:
    baked, parameters = relit.baked, [*relit.baked.spans]
    slabs: list[np.ndarray] = []

    def put(table: Tensor) -> int:
        """The number of the first of some tables [..., W, P, H, 1 or C] among all."""
        first = len(slabs)
        codes = (table / TABLE_STEP).round().to(torch.int16).movedim(-1, -4)
        slabs.extend(codes.reshape(-1, *codes.shape[-4:]).numpy().view(np.uint16))
        return first

    terms = []
    for term in baked.terms:
        terms.append(
            {
                "factors": [[parameters.index(factor.name), int(factor.complement)] for factor in term.factors],
                "unit": term.unit,
                "base": put(term.base),
                "moves": [[parameters.index(name), put(moves)] for name, moves in term.moves.items()],
            }
        )
    pixels = np.zeros((2, relit.shape[0] * relit.shape[1]), dtype=np.uint16)
    # 0 is the background.
    pixels[:, relit.pixels] = 1 + _codes(relit.normals).numpy().T.astype(np.uint16)
    return {
        "width": relit.shape[1],
        "height": relit.shape[0],
        "normals": packed(pixels.reshape(-1, relit.shape[1])),
        "normalSteps": NORMAL_STEPS,
        "lights": [
            {"name": name, "direction": direction} for name, direction in zip(names, relit.lights.tolist(), strict=True)
        ],
        "irradiance": relit.irradiance.tolist(),
        "scale": EXPOSURE / relit.white,
        "parameters": [_parameter(estimate, relit, name) for name in parameters],
        "terms": terms,
        "tables": packed(np.concatenate([slab.reshape(-1, slab.shape[-1]) for slab in slabs])),
        "channels": [len(slab) for slab in slabs],
        "nodes": [*reversed(slabs[0].shape[1:])],
        "step": TABLE_STEP,
        "top": TOP,
        "sideNodes": SIDE_NODES,
        "mapSteps": MAP_STEPS,
        "reciprocal": baked.reciprocal,
    }


def _parameter(estimate: Estimate, relit: Relighting, name: str) -> dict[str, Any]:
    """What the sliders of a parameter need."""
    span, map_of_it = relit.baked.spans[name], relit.material.parameters[name]
    known = estimate.parameters.get(name)
    declared = relit.material.declared[name]
    content: dict[str, Any] = {
        "name": name,
        "meaning": declared.doc,
        "unit": declared.unit,
        "status": known.status if known else "fixed",
        "channels": list(estimate.channel_names) if len(span.value) > 1 else [""],
        "estimates": _estimates(known.value, known.std) if known else [],
        "log": span.log,
        **{key: getattr(span, key).tolist() for key in ("value", "lower", "upper")},
    }
    if map_of_it.ndim > 1:
        top = float(map_of_it.max()) or 1.0
        codes = np.zeros((map_of_it.shape[1], relit.shape[0] * relit.shape[1]), dtype=np.uint16)
        codes[:, relit.pixels] = (map_of_it.numpy().T * (MAP_STEPS / top)).round().astype(np.uint16)
        content |= {"map": packed(codes.reshape(-1, relit.shape[1])), "mapTop": top}
    return content


def _estimates(value: Any, std: Any) -> list[str]:
    """The estimates of a parameter with their error bars, one a channel."""
    values = value if isinstance(value, list) else [value]
    stds = std if isinstance(std, list) else [std] * len(values)
    return [measured(one, error) for one, error in zip(values, stds, strict=True)]
