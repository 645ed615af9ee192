"""Cast shadows: the pixels that each light reaches, and the share of the sky that each pixel sees."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch

from matest.scene.lights import Light
from matest.scene.surface import Surface
from matest.workers import in_threads

# Rays that measure how much of the sky a pixel sees: the error is about 1 % of the sky.
_SKY_RAYS = 128
# Pixels whose sky is traced at once: a million rays, some 50 MB.
_SKY_PIXELS = 8_192
# Pixels that face a light up to which all are traced.
_ALL_TRACED = 1 << 18
# Pixels on a side of the squares between those that are traced first.
_CELL = 4
# Pixels whose rays are cast at once: few enough for their numbers to stay in the processor's cache.
_AT_ONCE = 1 << 15
# Distance of a ray's origin from its facet, share of the mesh's extent: rays then miss the facet itself.
_RAY_OFFSET = 1e-4


def cast_shadows(surface: Surface, light: Light) -> np.ndarray | None:
    """True where another part of the mesh stands between the pixel and the light [N]; None where nothing can.

    Nothing can on a convex body or a surface without a mesh. Where the facet faces away from the light although the
    smooth normal does not, the ray starts inside the body and the pixel counts as shadowed: a coarse mesh does not show
    where light ends.

    Large images are traced at every fourth pixel of every fourth row, and wholly about the edges of the shadows and of
    the surface: a shadow is missed only if it lies between these pixels without touching one.
    """
    if surface.mesh is None or surface.faces is None or surface.mesh.convex:
        return None
    facing = _facing(surface, light)
    shadow = np.zeros(len(surface), dtype=bool)
    if np.count_nonzero(facing) <= _ALL_TRACED:
        index = np.flatnonzero(facing)
        shadow[index] = _blocked(surface, light, index)
        return shadow
    grid = _Grid.over(surface, facing)
    index = grid.corners
    shadow[index] = _blocked(surface, light, index)
    even = grid.has_like_corners(shadow)
    waiting = facing.copy()
    while len(index):
        waiting[index] = False
        index = np.flatnonzero(waiting & ~np.take(even, grid.cell))
        shadow[index] = _blocked(surface, light, index)
        # The cells about an edge are traced too: it may leave the cells that showed it.
        even &= ~grid.is_beside_edge(shadow, facing & ~np.take(even, grid.cell))
    inside = np.flatnonzero(waiting)
    shadow[inside] = shadow[np.take(grid.corner, grid.cell[inside])]
    return shadow


def _facing(surface: Surface, light: Light) -> np.ndarray:
    """True where the surface faces a light [N]; elsewhere a pixel is dark anyway, and needs no ray."""
    positions = surface.positions
    assert positions is not None
    if not light.near:
        toward, _ = light.at(None)
        return (surface.normals.detach() @ toward[0].detach().to(surface.normals.dtype) > 0).numpy()
    facing = np.empty(len(surface), dtype=bool)
    for part in torch.arange(len(surface)).split(_AT_ONCE):
        toward, _ = light.at(positions[part])
        facing[part.numpy()] = ((surface.normals[part] * toward).sum(-1) > 0).detach().numpy()
    return facing


def _blocked(surface: Surface, light: Light, index: np.ndarray) -> np.ndarray:
    """Whether the mesh stands between some pixels and a light [n]."""
    mesh, positions, faces = surface.mesh, surface.positions, surface.faces
    assert mesh is not None
    assert positions is not None
    assert faces is not None
    blocked = np.empty(len(index), dtype=bool)
    for first in range(0, len(index), _AT_ONCE):
        part = index[first : first + _AT_ONCE]
        toward, _ = light.at(positions[part])
        origins = positions[part].detach().numpy() + _RAY_OFFSET * mesh.extent * mesh.face_normals(faces[part])
        directions = np.broadcast_to(toward.detach().numpy(), origins.shape)
        reach = light.distance(torch.from_numpy(origins)).detach().numpy() if light.near else None
        blocked[first : first + _AT_ONCE] = mesh.blocked(origins, directions, reach)
    return blocked


@dataclass(frozen=True, eq=False)
class _Grid:
    """Square cells of `_CELL`² pixels, R rows of S, over the image of a surface; the first pixel of each is its corner.

    Attributes:
        cell: number of the cell that each pixel of the surface lies in [N].
        corner: the pixel of the surface at the corner of each cell, −1 where its ray is not needed [R, S].
        plain: whether all pixels of a cell need a ray and lie off the rim of the surface [R, S].
    """

    cell: np.ndarray
    corner: np.ndarray
    plain: np.ndarray

    @classmethod
    def over(cls, surface: Surface, facing: np.ndarray) -> _Grid:
        """The grid over a surface of which some pixels [N] face the light."""
        # A last row and column of cells without pixels, which have no corner.
        shape = (surface.shape[0] // _CELL + 2, surface.shape[1] // _CELL + 2)
        # In 32 bits, which is several times as fast, and enough for any image.
        pixels = surface.pixels.astype(np.uint32)
        rows = pixels // np.uint32(surface.shape[1])
        columns = pixels - rows * np.uint32(surface.shape[1])
        cell = (rows // np.uint32(_CELL) * np.uint32(shape[1]) + columns // np.uint32(_CELL)).astype(np.int32)
        corner = np.full(shape, -1, dtype=np.int32)
        index = np.flatnonzero(facing & (rows % _CELL == 0) & (columns % _CELL == 0))
        corner.flat[cell[index]] = index
        count = np.bincount(cell[facing & ~surface.rim], minlength=corner.size).reshape(shape)
        return cls(cell, corner, count == _CELL**2)

    @property
    def corners(self) -> np.ndarray:
        """All corners whose rays are needed, ascending."""
        return np.sort(self.corner[self.corner >= 0])

    def has_like_corners(self, shadow: np.ndarray) -> np.ndarray:
        """Whether a cell is plain, and the pixels [N] at its corner and at those of the next cells are alike [R, S]."""
        value = np.where(self.corner >= 0, shadow[self.corner], -1)
        first, others = value[:-1, :-1], (value[1:, :-1], value[:-1, 1:], value[1:, 1:])
        alike = np.zeros_like(self.plain)
        alike[:-1, :-1] = (first >= 0) & np.all([first == other for other in others], axis=0)
        return alike & self.plain

    def is_beside_edge(self, shadow: np.ndarray, traced: np.ndarray) -> np.ndarray:
        """Whether a cell and the eight about it have both shadowed and lit ones of the pixels `traced` [N] [R, S].

        The corner of a cell that is not traced stands for it.
        """
        import cv2

        around = []
        for kind in (True, False):
            holds = (self.corner >= 0) & (shadow[self.corner] == kind)
            holds.flat[self.cell[traced & (shadow == kind)]] = True
            around.append(cv2.dilate(holds.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)
        return np.logical_and(*around)


def unoccluded_fraction(surface: Surface) -> np.ndarray | None:
    """Share of an even sky's light that reaches each pixel, f = (1/π) ∫ N·L dω over the unoccluded sky, float32 [N].

    None where nothing can stand in the way (see `cast_shadows`). 128 rays a pixel with a density proportional to the
    cosine, the same set turned by a random angle at each pixel: accurate to about 1 % of the sky.

    Source: Cook & Torrance 1982, the factor f of the ambient term.
    """
    if surface.mesh is None or surface.faces is None or surface.mesh.convex:
        return None
    assert surface.positions is not None
    mesh = surface.mesh
    # The hemisphere is that of the facet, not of the smooth normal: no ray starts into the body.
    normals = mesh.face_normals(surface.faces)
    origins = surface.positions.numpy() + _RAY_OFFSET * mesh.extent * normals
    axis = np.where(np.abs(normals[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    tangent = np.cross(axis, normals)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    bitangent = np.cross(normals, tangent)
    # A sunflower pattern in the unit disc, projected up to the hemisphere, has a density proportional to the cosine.
    number = np.arange(_SKY_RAYS) + 0.5
    radius, angle = np.sqrt(number / _SKY_RAYS), number * (math.pi * (3 - math.sqrt(5)))
    turn = np.random.default_rng(0).uniform(0, 2 * math.pi, len(surface))
    fraction = np.empty(len(surface), dtype=np.float32)

    def trace(part: np.ndarray) -> None:
        along = turn[part, None] + angle
        x, y, z = radius * np.cos(along), radius * np.sin(along), np.sqrt(1 - radius * radius)
        frame = (tangent[part, None], bitangent[part, None], normals[part, None])
        toward = x[..., None] * frame[0] + y[..., None] * frame[1] + z[:, None] * frame[2]
        start = np.repeat(origins[part], _SKY_RAYS, axis=0)
        fraction[part] = 1 - mesh.blocked(start, toward.reshape(-1, 3)).reshape(-1, _SKY_RAYS).mean(axis=1)

    list(in_threads(trace, np.array_split(np.arange(len(surface)), max(len(surface) // _SKY_PIXELS, 1))))
    return fraction


def shadow_edges(surface: Surface, shadow: np.ndarray) -> np.ndarray:
    """True for pixels within one pixel of a shadow's edge, where a pixel may be lit in part [N]."""
    import cv2

    image = surface.image(shadow.astype(np.uint8))
    kernel = np.ones((3, 3), np.uint8)
    inside = surface.mask.astype(np.uint8)
    grown = cv2.dilate(image, kernel)
    # The background counts as shadowed here, so that the silhouette is no shadow edge.
    shrunk = cv2.erode(np.where(inside > 0, image, 1).astype(np.uint8), kernel)
    return (grown != shrunk).flat[surface.pixels]
