"""Cast shadows: the pixels that each light reaches, and the share of the sky that each pixel sees."""

from __future__ import annotations

import math

import numpy as np
import torch

from matest.scene.lights import Light
from matest.scene.surface import Surface
from matest.workers import in_threads

# Rays that measure how much of the sky a pixel sees: the error is about 1 % of the sky.
_SKY_RAYS = 128
# Pixels whose sky is traced at once: a million rays, some 50 MB.
_SKY_PIXELS = 8_192
# Distance of a ray's origin from its facet, share of the mesh's extent: rays then miss the facet itself.
_RAY_OFFSET = 1e-4


def cast_shadows(surface: Surface, light: Light) -> np.ndarray | None:
    """True where another part of the mesh stands between the pixel and the light [N]; None where nothing can.

    Nothing can on a convex body or a surface without a mesh. Where the facet faces away from the light although the
    smooth normal does not, the ray starts inside the body and the pixel counts as shadowed: a coarse mesh does not show
    where light ends.
    """
    if surface.mesh is None or surface.faces is None or surface.mesh.convex:
        return None
    assert surface.positions is not None
    mesh, positions = surface.mesh, surface.positions.numpy()
    toward, _ = light.at(surface.positions)
    directions = np.ascontiguousarray(np.broadcast_to(toward.detach().numpy(), positions.shape))
    # Facing away, the pixel is dark anyway: no ray.
    facing = np.flatnonzero(np.einsum("ij,ij->i", surface.normals.numpy(), directions) > 0)
    offset = _RAY_OFFSET * mesh.extent
    origins = positions[facing] + offset * mesh.face_normals(surface.faces[facing])
    faces, distance = mesh.first_hits(origins, directions[facing])
    shadow = np.zeros(len(surface), dtype=bool)
    shadow[facing] = (faces >= 0) & (distance < light.distance(torch.from_numpy(origins)).detach().numpy())
    return shadow


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
