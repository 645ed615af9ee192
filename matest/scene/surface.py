"""The visible surface: normals, positions and viewing directions of the object's pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize

from matest.errors import InputError
from matest.scene.camera import Camera
from matest.scene.mesh import Mesh
from matest.workers import in_threads

# Pixels from the silhouette within which a pixel may mix object and background: optics and mask are accurate to about
# a pixel each.
RIM_WIDTH = 2
# Rays that are cast at a time: few enough for their numbers to stay in the processor's cache.
_RAYS = 1 << 15


@dataclass(frozen=True)
class Surface:
    """Geometry of the N object pixels of an H×W image, double precision.

    Attributes:
        shape: (H, W).
        pixels: flat row-major indices, ascending [N].
        normals: unit normals in world coordinates, facing the viewer [N, 3].
        view: unit vectors to the viewer, [N, 3] or [1, 3] if it is the same everywhere; computed from `eye` and
            `positions` where there are both.
        positions: in world units [N, 3], or None where only normals are known.
        rim: True where the pixel touches a silhouette and may mix two surfaces [N].
        faces: triangle seen by each pixel [N] if the surface is a mesh.
        mesh: that mesh.
        coverage: share of the mask's pixels in which there is a surface.
        eye: position of a perspective camera, [3]; None for a distant viewer.
        convex: True for a surface without a mesh that cannot shadow itself.
    """

    shape: tuple[int, int]
    pixels: np.ndarray
    normals: Tensor
    view: Tensor
    positions: Tensor | None
    rim: np.ndarray
    faces: np.ndarray | None = None
    mesh: Mesh | None = None
    coverage: float = 1.0
    eye: Tensor | None = None
    convex: bool = False

    def __post_init__(self) -> None:
        if self.eye is not None and self.positions is not None:
            object.__setattr__(self, "view", normalize(self.eye.detach() - self.positions.detach(), dim=-1))

    def __len__(self) -> int:
        return len(self.pixels)

    @cached_property
    def mask(self) -> np.ndarray:
        """Object pixels as an H×W boolean image."""
        mask = np.zeros(self.shape, dtype=bool)
        mask.flat[self.pixels] = True
        return mask

    def normals_as(self, dtype: torch.dtype) -> Tensor:
        """`normals` in another precision; single precision is kept for the next call."""
        if self.normals.requires_grad or dtype != torch.float32:
            return self.normals.to(dtype)
        return self._single_normals

    @cached_property
    def _single_normals(self) -> Tensor:
        with torch.inference_mode(False):
            return self.normals.float()

    def toward_viewer(self, index: Tensor | slice = slice(None)) -> Tensor:
        """`view` of some pixels, differentiable in eye and positions that require gradients."""
        moving = any(value is not None and value.requires_grad for value in (self.eye, self.positions))
        if moving and self.eye is not None and self.positions is not None:
            # Computed at every call, because an optimiser changes positions in place.
            return normalize(self.eye - self.positions[index], dim=-1)
        return self.view if len(self.view) == 1 else self.view[index]

    def image(self, values: np.ndarray, background: float = 0.0) -> np.ndarray:
        """Values [N, ...] of the object's pixels laid out as an image H×W×…"""
        image = np.full((self.shape[0] * self.shape[1], *values.shape[1:]), background, dtype=values.dtype)
        image[self.pixels] = values
        return image.reshape(*self.shape, *values.shape[1:])

    def take(self, selection: np.ndarray) -> Surface:
        """The same surface restricted to some of its pixels (boolean [N])."""
        index = torch.from_numpy(np.flatnonzero(selection))
        return replace(
            self,
            pixels=self.pixels[selection],
            normals=self.normals[index],
            view=self.view if len(self.view) == 1 else self.view[index],
            positions=None if self.positions is None else self.positions[index],
            rim=self.rim[selection],
            faces=None if self.faces is None else self.faces[selection],
        )


class _View(NamedTuple):
    """What the rays of a camera through some pixels meet; the n rays that meet nothing are left out.

    Attributes:
        pixels: flat row-major indices [n].
        distance: to the surface along the ray [n].
        cos_o: cosine between the smooth normal and the direction to the viewer [n].
        faces: triangle met by the m rays whose pixels face the viewer [m].
        positions: where they meet it, in world units [m, 3].
        normals: there, unit, smooth-shaded [m, 3].
    """

    pixels: np.ndarray
    distance: np.ndarray
    cos_o: np.ndarray
    faces: np.ndarray
    positions: np.ndarray
    normals: np.ndarray

    @classmethod
    def room(cls, count: int) -> _View:
        """Room for the view through so many pixels."""
        index, number, vector = np.empty(count, np.int64), np.empty(count), np.empty((count, 3))
        return cls(index, number, np.empty_like(number), np.empty_like(index), vector, np.empty_like(vector))

    @classmethod
    def of(cls, mesh: Mesh, camera: Camera, shape: tuple[int, int], pixels: np.ndarray) -> _View:
        """The view of a mesh through some pixels of an image."""
        origins, directions = camera.rays(shape, pixels)
        if camera.orthographic:
            # The object is seen whole, wherever the camera stands on its line of sight.
            start = mesh.nearest_depth(camera.forward) - mesh.extent
            origins = origins + directions * (start - origins @ camera.forward)[:, None]
        faces, distance = mesh.first_hits(origins, directions)
        hit = faces >= 0
        faces, distance, directions = faces[hit], distance[hit], directions[hit]
        positions = origins[hit] + distance[:, None] * directions
        normals = mesh.interpolated_normals(faces, positions)
        cos_o = -np.einsum("ij,ij->i", normals, directions)
        # A smooth-shaded normal may point away from the viewer at the limb; such pixels are left out.
        facing = cos_o > 0
        return cls(pixels[hit], distance, cos_o, faces[facing], positions[facing], normals[facing])

    @classmethod
    def through(cls, mesh: Mesh, camera: Camera, shape: tuple[int, int], pixels: np.ndarray) -> _View:
        """The same for many pixels, part by part on all processors, each written where it belongs."""
        whole = cls.room(len(pixels))

        def trace(first: int) -> list[int]:
            part = cls.of(mesh, camera, shape, pixels[first : first + _RAYS])
            for column, values in zip(whole, part, strict=True):
                column[first : first + len(values)] = values
            return [len(values) for values in part]

        counts = list(in_threads(trace, range(0, max(len(pixels), 1), _RAYS)))
        return cls(*(_packed(column, sizes) for column, sizes in zip(whole, zip(*counts, strict=True), strict=True)))


def _packed(column: np.ndarray, sizes: Sequence[int]) -> np.ndarray:
    """The first so many of every `_RAYS` values, moved together in place."""
    end = 0
    for number, size in enumerate(sizes):
        column[end : end + size] = column[number * _RAYS : number * _RAYS + size]
        end += size
    column.resize((end, *column.shape[1:]), refcheck=False)
    return column


def from_mesh(mesh: Mesh, camera: Camera, shape: tuple[int, int], mask: np.ndarray | None = None) -> Surface:
    """The mesh as the camera sees it: one ray through each pixel centre, smooth-shaded normals.

    Raises:
        InputError: no ray meets the mesh inside the mask.
    """
    candidates = np.arange(shape[0] * shape[1]) if mask is None else np.flatnonzero(mask)
    seen = _View.through(mesh, camera, shape, candidates)
    pixels, distance, cos_o, *_ = seen
    if not len(pixels):
        low, high = (np.round(corner, 3).tolist() for corner in mesh.bounds)
        raise InputError(
            f"the mesh lies outside the view: expected it to cover pixels of the {shape[1]}×{shape[0]} image, but no "
            f"ray of the camera meets its bounding box {low} to {high} where the mask allows. Check camera.position, "
            "camera.target and the mesh's units."
        )
    facing = cos_o > 0
    if not facing.any():
        raise InputError("all normals of the mesh point away from the camera: it is inside out; flip its faces.")
    rim = _rim(shape, pixels, distance, camera.footprint(shape, distance), cos_o)
    # Of an orthographic camera; of others it follows from their position.
    _, direction = camera.rays(shape, pixels[:1])
    return Surface(
        shape=shape,
        pixels=pixels[facing],
        normals=torch.from_numpy(seen.normals),
        view=torch.from_numpy(-direction),
        positions=torch.from_numpy(seen.positions),
        rim=rim[facing],
        faces=seen.faces,
        mesh=mesh,
        coverage=1.0 if mask is None else len(pixels) / len(candidates),
        eye=_eye(camera),
    )


def from_normals(
    normals: np.ndarray, camera: Camera | None, mask: np.ndarray | None = None, positions: np.ndarray | None = None
) -> Surface:
    """The surface of a normal map H×W×3 (x right, y up, z toward the viewer; zero or NaN = background)."""
    camera = camera or Camera()
    shape = (normals.shape[0], normals.shape[1])
    length = np.linalg.norm(normals, axis=-1)
    inside = np.isfinite(length) & (length > 0.5)
    if mask is not None:
        inside &= mask
    pixels = np.flatnonzero(inside)
    _, directions = camera.rays(shape, pixels)
    unit = normals.reshape(-1, 3)[pixels].astype(np.float64)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    points = None if positions is None else positions.reshape(-1, 3)[pixels].astype(np.float64)
    view = -directions
    surface = Surface(
        shape=shape,
        pixels=pixels,
        normals=torch.from_numpy(unit),
        view=torch.from_numpy(view[:1].copy() if camera.orthographic else view),
        positions=None if points is None else torch.from_numpy(points),
        rim=_rim(shape, pixels),
        eye=_eye(camera),
    )
    return surface.take(((surface.normals * surface.view).sum(-1) > 0).numpy())


def from_sphere(shape: tuple[int, int], centre: tuple[float, float], radius: float, mask: np.ndarray | None) -> Surface:
    """A sphere seen orthographically, its image a circle (pixels; centres at +0.5).

    Positions are in units of the radius, with the origin at the sphere's centre.
    """
    rows, columns = np.indices(shape)
    x = (columns + 0.5 - centre[0]) / radius
    y = (centre[1] - rows - 0.5) / radius
    squared = x * x + y * y
    inside = squared < 1
    if mask is not None:
        inside &= mask
    pixels = np.flatnonzero(inside)
    normals = np.stack([x, y, np.sqrt(np.clip(1 - squared, 0, None))], axis=-1).reshape(-1, 3)[pixels]
    return Surface(
        shape=shape,
        pixels=pixels,
        normals=torch.from_numpy(normals),
        view=torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64),
        positions=torch.from_numpy(normals.copy()),
        rim=_rim(shape, pixels),
        convex=True,
    )


def fit_circle(mask: np.ndarray) -> tuple[tuple[float, float], float]:
    """Centre (x, y) and radius in pixels of the circle that a mask's edge follows.

    The edge is the half-level contour of the mask (anti-aliased masks give sub-pixel positions); points on the border
    of the image, where a cropped sphere has no edge, do not count.

    Args:
        mask: H×W, any numeric type; nonzero = object.

    Raises:
        InputError: the edge is not a circle to 3 % of its radius.
    """
    from skimage.measure import CircleModel, find_contours

    level = mask.astype(np.float64) / mask.max()
    contours = find_contours(np.pad(level, 1), 0.5)
    if not contours:
        raise InputError("the mask has no edge to fit a circle to: it must show the sphere against a background.")
    # Padding by one pixel shifts by +1; array index i is the pixel centre i + 0.5.
    edge = max(contours, key=len) - 1 + 0.5
    height, width = mask.shape
    inner = (edge[:, 0] > 1) & (edge[:, 0] < height - 1) & (edge[:, 1] > 1) & (edge[:, 1] < width - 1)
    circle = CircleModel.from_estimate(edge[inner][:, ::-1]) if inner.sum() >= 8 else None
    if not circle:
        raise InputError("no circle could be fitted to the mask's edge: give centre and radius in [geometry].")
    centre, radius = circle.center, float(circle.radius)
    spread = float(np.sqrt(np.mean(circle.residuals(edge[inner][:, ::-1]) ** 2)))
    if spread > 0.03 * radius:
        raise InputError(
            f"the mask's edge is no circle: it strays {spread:.1f} pixels (rms) from the best one, of radius "
            f"{radius:.1f}; a sphere's mask, or centre and radius in [geometry], is needed."
        )
    return (float(centre[0]), float(centre[1])), radius


def _eye(camera: Camera) -> Tensor | None:
    return None if camera.orthographic else torch.tensor(camera.position, dtype=torch.float64)


def _rim(
    shape: tuple[int, int],
    pixels: np.ndarray,
    distance: np.ndarray | None = None,
    footprint: np.ndarray | None = None,
    cos_o: np.ndarray | None = None,
) -> np.ndarray:
    """True for pixels within `RIM_WIDTH` of a silhouette: the object's outline, or a jump in depth across it."""
    import cv2

    inside = np.zeros(shape, dtype=np.uint8)
    inside.flat[pixels] = 1
    if distance is not None and footprint is not None and cos_o is not None:
        depth = np.zeros(shape)
        depth.flat[pixels] = distance
        # Across 3×3 pixels a tilted plane spans 2√2 footprints · tan θ; twice that is a jump.
        allowed = np.zeros(shape)
        allowed.flat[pixels] = footprint * (2 + 4 * np.sqrt(2) / np.clip(cos_o, 0.02, None))
        kernel = np.ones((3, 3), np.uint8)
        span = cv2.morphologyEx(depth, cv2.MORPH_GRADIENT, kernel)
        within = cv2.erode(inside, kernel) > 0
        inside[within & (span > allowed)] = 0
    size = 2 * RIM_WIDTH + 1
    interior = cv2.erode(inside, np.ones((size, size), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=1)
    return interior.flat[pixels] == 0
