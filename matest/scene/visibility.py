"""Cast shadows: the pixels that each light reaches, and the share of the sky that each pixel sees."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from matest.scene.lights import Light
from matest.scene.rim import starts_of_rows
from matest.scene.shadow_grid import Grid
from matest.scene.surface import Surface
from matest.workers import in_threads

# Rays that measure how much of the sky a pixel sees: the error is about 1 % of the sky.
_SKY_RAYS = 128
# Pixels whose sky is traced at once: a million rays, some 50 MB.
_SKY_PIXELS = 8_192
# Pixels that face a light up to which all are traced.
_ALL_TRACED = 1 << 18
# Pixels whose rays are cast at once: few enough for their numbers to stay in the processor's cache.
_AT_ONCE = 1 << 15
# Distance of a ray's origin from its facet, share of the mesh's extent: rays then miss the facet itself.
_RAY_OFFSET = 1e-4


def cast_shadows(surface: Surface, light: Light, grid: Grid | None = None, node: int = 0) -> np.ndarray | None:
    """True where another part of the mesh stands between the pixel and the light [N]; None where nothing can.

    Nothing can on a convex body or a surface without a mesh. Where the facet faces away from the light although the
    smooth normal does not, the ray starts inside the body and the pixel counts as shadowed: a coarse mesh does not show
    where light ends.

    Large images are traced at every fourth pixel of every fourth row, and wholly about the edges of the shadows and of
    the surface: a shadow is missed only if it lies between these pixels without touching one.

    Args:
        surface: that may shadow itself.
        light: that it is lit by.
        grid: over the surface, which serves all lights; None: made if needed.
        node: which of the points that stand for the light.
    """
    if not _may_shadow_itself(surface):
        return None
    facing = _facing(surface, light, node)
    if np.count_nonzero(facing) > _ALL_TRACED:
        return (grid or Grid.over(surface)).shadow(facing, lambda index: _blocked(surface, light, node, index))
    shadow = np.zeros(len(surface), dtype=bool)
    index = np.flatnonzero(facing)
    shadow[index] = _blocked(surface, light, node, index)
    return shadow


def grid_of_large(surface: Surface) -> Grid | None:
    """The grid that `cast_shadows` needs over a surface; None where it needs none."""
    return Grid.over(surface) if len(surface) > _ALL_TRACED and _may_shadow_itself(surface) else None


def _may_shadow_itself(surface: Surface) -> bool:
    return surface.mesh is not None and surface.faces is not None and not surface.mesh.convex


def _facing(surface: Surface, light: Light, node: int) -> np.ndarray:
    """True where the surface faces a light [N]; elsewhere a pixel is dark anyway, and needs no ray."""
    if light.nodes == 1 and not light.near:
        toward, _ = light.at(None)
        return (surface.normals.detach() @ toward[0].detach().to(surface.normals.dtype) > 0).numpy()
    facing = np.empty(len(surface), dtype=bool)
    for part in torch.arange(len(surface)).split(_AT_ONCE):
        toward = _toward(surface, light, node, part)
        facing[part.numpy()] = ((surface.normals[part].double() * toward).sum(-1) > 0).detach().numpy()
    return facing


def _toward(surface: Surface, light: Light, node: int, index: Tensor) -> Tensor:
    """Unit vectors from some pixels [n] to one of the points that stand for a light [1 or n, 3]."""
    assert surface.positions is not None
    positions, normals = surface.positions[index].double(), surface.normals[index].double()
    return light.toward(node, positions, normals, surface.toward_viewer(index).double())


def _blocked(surface: Surface, light: Light, node: int, index: np.ndarray) -> np.ndarray:
    """Whether the mesh stands between some pixels and a light [n]."""
    mesh, positions, faces = surface.mesh, surface.positions, surface.faces
    assert mesh is not None
    assert positions is not None
    assert faces is not None
    blocked = np.empty(len(index), dtype=bool)
    for first in range(0, len(index), _AT_ONCE):
        part = index[first : first + _AT_ONCE]
        toward = _toward(surface, light, node, torch.from_numpy(part))
        origins = positions[part].detach().numpy() + _RAY_OFFSET * mesh.extent * mesh.face_normals(faces[part])
        directions = np.broadcast_to(toward.detach().numpy(), origins.shape)
        reach = light.distance(torch.from_numpy(origins)).detach().numpy() if light.near else None
        blocked[first : first + _AT_ONCE] = mesh.blocked(origins, directions, reach)
    return blocked


def unoccluded_fraction(surface: Surface, index: np.ndarray | slice = slice(None)) -> np.ndarray | None:
    """Share of an even sky's light that reaches each pixel, f = (1/π) ∫ N·L dω over the unoccluded sky, float32 [N].

    Of some pixels only, where an `index` [n] says so; each has the same share whichever others are asked for.

    None where nothing can stand in the way (see `cast_shadows`). 128 rays a pixel with a density proportional to the
    cosine, the same set turned by a random angle at each pixel: accurate to about 1 % of the sky.

    Source: Cook & Torrance 1982, the factor f of the ambient term.
    """
    mesh = surface.mesh
    if mesh is None or surface.faces is None or mesh.convex:
        return None
    assert surface.positions is not None
    # The hemisphere is that of the facet, not of the smooth normal: no ray starts into the body.
    normals = mesh.face_normals(surface.faces[index])
    origins = surface.positions.numpy()[index] + _RAY_OFFSET * mesh.extent * normals
    axis = np.where(np.abs(normals[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    tangent = np.cross(axis, normals)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    bitangent = np.cross(normals, tangent)
    # A sunflower pattern in the unit disc, projected up to the hemisphere, has a density proportional to the cosine.
    number = np.arange(_SKY_RAYS) + 0.5
    radius, angle = np.sqrt(number / _SKY_RAYS), number * (math.pi * (3 - math.sqrt(5)))
    turn = np.random.default_rng(0).uniform(0, 2 * math.pi, len(surface))[index]
    fraction = np.empty(len(origins), dtype=np.float32)

    def trace(part: np.ndarray) -> None:
        along = turn[part, None] + angle
        x, y, z = radius * np.cos(along), radius * np.sin(along), np.sqrt(1 - radius * radius)
        frame = (tangent[part, None], bitangent[part, None], normals[part, None])
        toward = x[..., None] * frame[0] + y[..., None] * frame[1] + z[:, None] * frame[2]
        start = np.repeat(origins[part], _SKY_RAYS, axis=0)
        fraction[part] = 1 - mesh.blocked(start, toward.reshape(-1, 3)).reshape(-1, _SKY_RAYS).mean(axis=1)

    list(in_threads(trace, np.array_split(np.arange(len(origins)), max(len(origins) // _SKY_PIXELS, 1))))
    return fraction


def shadow_edges(surface: Surface, shadow: np.ndarray) -> np.ndarray:
    """True for pixels within one pixel of a shadow's edge, where a pixel may be lit in part [N]."""
    import cv2

    edges = np.zeros(len(surface), dtype=bool)
    shadowed = np.flatnonzero(shadow)
    if not len(shadowed):
        return edges
    # The rows of the shadow and one more on either side.
    width = surface.shape[1]
    top, bottom = surface.pixels[shadowed[[0, -1]]] // width + (-1, 2)
    first, last = starts_of_rows(surface.pixels, width, top, bottom)
    places = surface.pixels[first:last] - top * width
    # The background counts as lit where shadows grow and as shadowed where they shrink: no silhouette is their edge.
    image = np.zeros((bottom - top, width), np.uint8)
    image.reshape(-1)[places] = shadow[first:last]
    kernel = np.ones((3, 3), np.uint8)
    grown = cv2.dilate(image, kernel)
    image.fill(1)
    image.reshape(-1)[places] = shadow[first:last]
    edges[first:last] = (grown != cv2.erode(image, kernel)).reshape(-1)[places]
    return edges
