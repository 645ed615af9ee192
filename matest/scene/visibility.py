"""Cast shadows: which object pixels each light reaches."""

from __future__ import annotations

import numpy as np

from matest.scene.lights import DirectionalLight, Light
from matest.scene.surface import Surface


def cast_shadows(surface: Surface, light: Light) -> np.ndarray | None:
    """True where another part of the mesh stands between the pixel and the light [N]; None where nothing can.

    A convex body, and a surface known only by its normals, cast no shadow rays. Where the facet faces away from the
    light although the smooth normal does not, the ray starts inside the body and the pixel counts as shadowed: on a
    coarse mesh nobody knows where the terminator runs.
    """
    if surface.mesh is None or surface.faces is None or surface.mesh.convex:
        return None
    assert surface.positions is not None
    mesh, positions = surface.mesh, surface.positions.numpy()
    toward, _ = light.at(surface.positions)
    directions = np.ascontiguousarray(np.broadcast_to(toward.detach().numpy(), positions.shape))
    # Facing away, the pixel is dark anyway: no ray.
    facing = np.flatnonzero(np.einsum("ij,ij->i", surface.normals.numpy(), directions) > 0)
    offset = 1e-4 * mesh.extent
    origins = positions[facing] + offset * mesh.face_normals(surface.faces[facing])
    faces, distance = mesh.first_hits(origins, directions[facing])
    blocked = faces >= 0
    if not isinstance(light, DirectionalLight):
        reach = np.linalg.norm(light.position.detach().numpy() - origins, axis=1)
        blocked &= distance < reach
    shadow = np.zeros(len(surface), dtype=bool)
    shadow[facing] = blocked
    return shadow


def shadow_edges(surface: Surface, shadow: np.ndarray) -> np.ndarray:
    """True for pixels within one pixel of a shadow's edge, where a pixel may be lit in part [N]."""
    import cv2

    image = surface.image(shadow.astype(np.uint8))
    kernel = np.ones((3, 3), np.uint8)
    inside = surface.mask.astype(np.uint8)
    grown = cv2.dilate(image, kernel)
    # Outside the object there is no shadow to speak of: the silhouette is no shadow edge.
    shrunk = cv2.erode(np.where(inside > 0, image, 1).astype(np.uint8), kernel)
    return (grown != shrunk).flat[surface.pixels]
