"""Shading: radiance = Σ over lights of brdf · cos θi · E, plus ambient light. Differentiable, tile by tile."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from matest.brdf import Brdf, Term
from matest.directions import Directions, above_horizon
from matest.errors import InputError
from matest.scene import Points, Scene, Surface
from matest.scene.points import lit_pairs

# What a surface is made of: one material, or by name that of each object.
Material = Brdf | Mapping[str, Brdf]

# Cosines of the table of reflectance under an even sky: linear interpolation between them is exact to 1e-3.
SKY_COSINES = 33
# Gauss-Legendre nodes over the polar angle (0 to π/2): exact to 1e-3 for lobes of rms slope 0.03 and more.
_POLAR = 64
# Gauss-Legendre nodes over the azimuth (0 to π), likewise.
_AZIMUTH = 64
# Values of a shape that has one at every point: linear interpolation between them is exact to 3e-3 over its domain.
_SKY_SHAPES = 17
# Pixels that are shaded at once: single precision RGB of one light takes 0.8 MB.
_TILE = 1 << 16
# Lights of an image that so many pixels are shaded under at once; under more, as many fewer.
_FEW_NODES = 16


def shade(brdf: Brdf, points: Points) -> Tensor:
    """Radiance [..., C] that leaves `points` toward the viewer.

    Differentiable in the parameters, directions and irradiances; any device, float32 or float64 (that of the points).
    Parameters of shape [..., 1 or C] belong to one point each.

    Raises:
        InputError: ambient light on an anisotropic model, parameters of other points.
    """
    # Parameters per point get an axis for the lights.
    per_point = {name: value.unsqueeze(-2) for name, value in brdf.parameters.items() if value.ndim > 1}
    for name, value in per_point.items():
        if value.ndim == 3 and points.wo.ndim == 2 and 1 < len(value) != len(points.wo) > 1:
            raise InputError(
                f"'{name}' has values at {len(value):,} points and {len(points.wo):,} are shaded: give the values of "
                "these, as material(batch) does of a Trainable with maps."
            )
    pairs = lit_pairs(points)
    if pairs is None or not all(value.ndim == 3 and len(value) in (1, pairs.count) for value in per_point.values()):
        values = brdf.replace(per_point)(points.wi, points.wo[..., None, :])
        radiance = (values * gathered_light(points)).sum(-2)
    else:
        of_pairs = {name: value[pairs.rows] for name, value in per_point.items() if len(value) > 1}
        values = brdf.replace({**per_point, **of_pairs})(pairs.points.wi, pairs.points.wo[:, None])
        radiance = pairs.sums((values * gathered_light(pairs.points))[:, 0])
    if points.ambient is not None:
        radiance = radiance + points.ambient * reflectance(brdf, points.wo[..., 2:])
    return radiance


def gathered_light(points: Points) -> Tensor:
    """Irradiance on the surface from each light, E cos θi, zero below the horizon, [..., L, C]."""
    return points.irradiance * points.wi[..., 2:].clamp(min=0)


def lit_directions(points: Points) -> Directions:
    """Directions [..., L, 1] of every point and light, safe below the horizon."""
    wi, wo = points.wi, points.wo[..., None, :]
    # Photographs rarely have a pixel below it: the check is cheaper than to make every pixel safe.
    if bool((wi[..., 2] > 0).all()) and bool((wo[..., 2] > 0).all()):
        return Directions(wi, wo)
    return above_horizon(wi, wo)[0]


def render(
    scene: Scene, material: Material, *, dtype: torch.dtype = torch.float32, device: torch.device | str = "cpu"
) -> Tensor:
    """Radiance images [K, H, W, C] of a scene's surface made of `material`; 0 on the background.

    Differentiable in the material (and in lights, normals and positions of the scene that require gradients).

    Args:
        scene: of one object or several.
        material: of the surface, or by name of each object.
        dtype, device: of the computation.

    Raises:
        InputError: an object without material.
    """
    return torch.stack([render_image(scene, k, material, dtype=dtype, device=device) for k in range(len(scene))])


def render_image(
    scene: Scene,
    image: int,
    material: Material,
    *,
    dtype: torch.dtype = torch.float32,
    device: torch.device | str = "cpu",
) -> Tensor:
    """One of the images of `render`, [H, W, C]."""
    index = torch.arange(len(scene.surface))
    return scene.surface.image(render_pixels(scene, image, material, index, dtype=dtype, device=device))


def render_pixels(
    scene: Scene,
    image: int,
    material: Material,
    index: Tensor,
    *,
    dtype: torch.dtype = torch.float32,
    device: torch.device | str = "cpu",
) -> Tensor:
    """Radiance [n, C] of some of the surface's N pixels, by their `index` [n], in one of the images of `render`."""
    parts = []
    for tile in index.split(max(_TILE // max(scene.nodes(image) // _FEW_NODES, 1), 1)):
        points = scene.points(image, tile, dtype=dtype, device=device)
        radiance = points.wo.new_zeros(len(tile), scene.channels)
        for brdf, rows in _materials(scene.surface, material, tile):
            of_rows = at_pixels(brdf, tile[rows], len(scene.surface))
            radiance = radiance.index_put((rows,), shade(of_rows, points[rows]).expand(len(rows), scene.channels))
        parts.append(radiance)
    return torch.cat(parts)


def _materials(surface: Surface, material: Material, index: Tensor) -> Iterator[tuple[Brdf, Tensor]]:
    """Each material of some pixels of a surface [n], and which of them are made of it, as numbers of these.

    Raises:
        InputError: an object without material.
    """
    if not isinstance(material, Mapping):
        yield material, torch.arange(len(index))
        return
    names = () if surface.objects is None else surface.objects.names
    if {*names} != {*material}:
        raise InputError(
            f"materials are given of {', '.join(material) or 'nothing'}, and the objects of the scene are "
            f"{', '.join(names) or 'one without name'}: give one for each."
        )
    assert surface.objects is not None
    numbers = torch.from_numpy(surface.objects.index)[index]
    for number in numbers.unique().tolist():
        yield material[names[number]], (numbers == number).nonzero()[:, 0]


def at_pixels(material: Brdf, index: Tensor, count: int) -> Brdf:
    """The material at some of a surface's pixels, by their `index` [n], of which there are `count`."""
    of_pixels = {
        name: value[index.to(value.device)]
        for name, value in material.parameters.items()
        if value.ndim > 1 and len(value) == count > 1
    }
    return material.replace(of_pixels) if of_pixels else material


def reflectance(brdf: Brdf, cos_o: Tensor) -> Tensor:
    """Hemispherical-directional reflectance [..., C] toward viewers at `cos_o` [..., 1] from the normal.

    The share of the radiance of an even sky that is reflected; by reciprocity the albedo of light from there.
    Quadrature at 33 cosines, linear between them: exact to 1e-3 for lobes of rms slope 0.03 and more. Shapes may have a
    value at every point [n, 1 or C], each of which multiplies the time by 17.
    """
    check_sky(brdf)
    nodes = sky_nodes(cos_o.dtype, cos_o.device)
    values = brdf.to(cos_o.dtype, cos_o.device)
    amplitudes = values.structure.amplitudes
    lobes = [name for name, value in values.parameters.items() if name not in amplitudes and value.ndim > 1]
    if lobes:
        return _between_shapes(values, lobes[0], cos_o)
    even = {name: torch.ones_like(value) for name, value in values.parameters.items() if name in amplitudes}
    total = torch.zeros((), dtype=cos_o.dtype, device=cos_o.device)
    for term in sky_terms(values.replace(even).terms(nodes.directions)):
        part = interpolate(term.shape, cos_o)
        for factor in term.factors:
            part = part * factor.value(values.parameters)
        total = total + part
    return total


def _between_shapes(brdf: Brdf, name: str, cos_o: Tensor) -> Tensor:
    """`reflectance` where a shape has a value at every point: linear between some values of it."""
    value = brdf.parameters[name]
    lower, upper = value.detach().aminmax()
    span = (upper - lower).clamp(min=torch.finfo(value.dtype).tiny)
    place = (value - lower) / span * (_SKY_SHAPES - 1)
    total = torch.zeros((), dtype=cos_o.dtype, device=cos_o.device)
    for node in range(_SKY_SHAPES):
        share = (1 - (place - node).abs()).clamp(min=0)
        total = total + share * reflectance(brdf.replace({name: lower + node / (_SKY_SHAPES - 1) * span}), cos_o)
    return total


def sky_light(points: Points, tables: Callable[[], Sequence[Tensor]]) -> Tensor | None:
    """Radiance of K shapes at n points under an even sky, [K, n, C] (or [K, S, n, C]); None where there is no sky.

    Args:
        points: with their ambient radiance.
        tables: returns the integral of each shape over the sky by `sky_terms`, [33, 1 or C], or S of these.
    """
    if points.ambient is None:
        return None
    return torch.stack([points.ambient * interpolate(table, points.wo[..., 2:]) for table in tables()])


def check_sky(brdf: Brdf) -> None:
    """Raise InputError for a model whose reflectance under an even sky is not a function of cos θr alone."""
    if brdf.structure.anisotropic:
        raise InputError(
            f"ambient light on {brdf.expression}, which reflects differently along and across its grooves, is not "
            "computed: leave out the ambient light or choose isotropic=true."
        )


class SkyNodes(NamedTuple):
    """Nodes and weights of an integral over the upper hemisphere, for each viewing cosine of the table."""

    weight: Tensor
    directions: Directions


@lru_cache(maxsize=4)
def sky_nodes(dtype: torch.dtype, device: torch.device) -> SkyNodes:
    x, wx = np.polynomial.legendre.leggauss(_POLAR)
    y, wy = np.polynomial.legendre.leggauss(_AZIMUTH)
    polar, azimuth = np.meshgrid((x + 1) * math.pi / 4, (y + 1) * math.pi / 2, indexing="ij")
    # Both halves of the azimuth count alike for isotropic models.
    weight = np.outer(wx * math.pi / 4, wy * math.pi) * np.sin(polar) * np.cos(polar)
    wi = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1)
    cos_o = np.linspace(0, 1, SKY_COSINES).clip(0.02)
    wo = np.stack([np.sqrt(1 - cos_o**2), np.zeros(SKY_COSINES), cos_o], axis=-1)
    # Made outside inference mode: later calls may differentiate through the cached tensors.
    with torch.inference_mode(False):
        arrays = (weight.reshape(1, -1, 1), wi.reshape(1, -1, 3), wo[:, None])
        weights, toward, viewer = (torch.from_numpy(array).to(device, dtype) for array in arrays)
        return SkyNodes(weights, Directions(toward, viewer))


def sky_terms(terms: tuple[Term, ...]) -> list[Term]:
    """Terms evaluated at the directions of `sky_nodes`, integrated over the sky: shapes [33, 1 or C]."""
    integrated = []
    for term in terms:
        nodes = sky_nodes(term.shape.dtype, term.shape.device)
        integrated.append(Term(term.factors, (term.shape * nodes.weight).sum(-2)))
    return integrated


def interpolate(table: Tensor, cos_o: Tensor) -> Tensor:
    """Values [..., C] at `cos_o` [..., 1] from a table [33, C] over the cosines of `sky_nodes`; S of S tables."""
    table = table.expand(*table.shape[:-2], SKY_COSINES, -1)
    position = cos_o[..., 0].clamp(0, 1) * (SKY_COSINES - 1)
    lower = position.detach().floor().clamp(max=SKY_COSINES - 2)
    share = (position - lower)[..., None]
    index = lower.long()
    return table[..., index, :] * (1 - share) + table[..., index + 1, :] * share
