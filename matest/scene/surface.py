"""The visible surface: normals, positions and viewing directions of the object's pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import overload

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize

from matest.errors import InputError
from matest.scene.camera import Camera
from matest.scene.circle import Circle
from matest.scene.mesh import Mesh
from matest.scene.objects import Objects
from matest.scene.rim import near_silhouette
from matest.scene.sight import Precision, Sight, index_type


@dataclass(frozen=True)
class Surface:
    """Geometry of the N object pixels of an H×W image.

    Attributes:
        shape: (H, W).
        pixels: flat row-major indices, ascending [N].
        normals: unit normals in world coordinates, facing the viewer [N, 3].
        sightlines: unit vectors to the viewer, [N, 3] or [1, 3] if it is the same everywhere; None where they follow
            from `eye` and `positions`.
        positions: in world units [N, 3], or None where only normals are known.
        rim: True where the pixel touches a silhouette and may mix two surfaces [N].
        faces: triangle seen by each pixel [N] if the surface is a mesh.
        mesh: that mesh.
        coverage: share of the mask's pixels in which there is a surface.
        eye: position of a perspective camera, [3]; None for a distant viewer.
        convex: True for a surface without a mesh that cannot shadow itself.
        circle: the image of a sphere, where it was fitted to the edge of a mask.
        objects: which object each pixel shows; None where there is one.
    """

    shape: tuple[int, int]
    pixels: np.ndarray
    normals: Tensor
    sightlines: Tensor | None
    positions: Tensor | None
    rim: np.ndarray
    faces: np.ndarray | None = None
    mesh: Mesh | None = None
    coverage: float = 1.0
    eye: Tensor | None = None
    convex: bool = False
    circle: Circle | None = None
    objects: Objects | None = None

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

    @property
    def view(self) -> Tensor:
        """Unit vectors to the viewer, [N, 3] or [1, 3] if it is the same everywhere."""
        return self.toward_viewer().detach()

    def toward_viewer(self, index: Tensor | slice = slice(None)) -> Tensor:
        """`view` of some pixels, differentiable in eye and positions that require gradients."""
        if self.sightlines is not None:
            return self.sightlines if len(self.sightlines) == 1 else self.sightlines[index]
        assert self.eye is not None
        assert self.positions is not None
        # At every call: it takes less than memory would, and an optimiser changes positions in place.
        return normalize(self.eye - self.positions[index], dim=-1)

    @overload
    def image(self, values: np.ndarray, background: float = 0.0) -> np.ndarray: ...

    @overload
    def image(self, values: Tensor, background: float = 0.0) -> Tensor: ...

    def image(self, values: np.ndarray | Tensor, background: float = 0.0) -> np.ndarray | Tensor:
        """Values [N, ...] of the object's pixels laid out as an image H×W×…; of a tensor, differentiable."""
        if isinstance(values, Tensor):
            flat = values.new_full((self.shape[0] * self.shape[1], *values.shape[1:]), background)
            pixels = torch.from_numpy(self.pixels).to(values.device, torch.int64)
            return flat.index_copy(0, pixels, values).reshape(*self.shape, *values.shape[1:])
        image = np.full((self.shape[0] * self.shape[1], *values.shape[1:]), background, dtype=values.dtype)
        image[self.pixels] = values
        return image.reshape(*self.shape, *values.shape[1:])

    def take(self, selection: np.ndarray) -> Surface:
        """The same surface restricted to some of its pixels (boolean [N])."""
        index = torch.from_numpy(np.flatnonzero(selection))
        sightlines = self.sightlines
        return replace(
            self,
            pixels=self.pixels[selection],
            normals=self.normals[index],
            positions=None if self.positions is None else self.positions[index],
            rim=self.rim[selection],
            sightlines=sightlines if sightlines is None or len(sightlines) == 1 else sightlines[index],
            faces=None if self.faces is None else self.faces[selection],
            objects=None if self.objects is None else self.objects.take(selection),
        )


def from_mesh(
    mesh: Mesh,
    camera: Camera,
    shape: tuple[int, int],
    mask: np.ndarray | None = None,
    precision: Precision = np.float64,
) -> Surface:
    """The mesh as the camera sees it: one ray through each pixel centre, smooth-shaded normals.

    Args:
        mesh: in world units.
        camera: that sees it.
        shape: of the image (H, W).
        mask: True where a ray is cast [H, W]; None: everywhere.
        precision: of normals, and of positions where it is enough for 1e-4 pixel.

    Raises:
        InputError: no ray meets the mesh inside the mask.
    """
    seen = Sight(mesh, camera, shape).columns(mask, precision)
    if not len(seen.pixels):
        low, high = (np.round(corner, 3).tolist() for corner in mesh.bounds)
        raise InputError(
            f"the mesh lies outside the view: expected it to cover pixels of the {shape[1]}×{shape[0]} image, but no "
            f"ray of the camera meets its bounding box {low} to {high} where the mask allows. Check camera.position, "
            "camera.target and the mesh's units."
        )
    if not seen.facing.any():
        raise InputError("all normals of the mesh point away from the camera: it is inside out; flip its faces.")
    candidates = shape[0] * shape[1] if mask is None else np.count_nonzero(mask)
    return Surface(
        shape=shape,
        pixels=seen.pixels[seen.facing],
        normals=torch.from_numpy(seen.normals),
        positions=torch.from_numpy(seen.positions),
        rim=near_silhouette(shape, seen.pixels, seen.depth, seen.jump)[seen.facing],
        sightlines=torch.from_numpy(-camera.forward[None]) if camera.orthographic else None,
        faces=seen.faces,
        mesh=mesh,
        coverage=1.0 if mask is None else len(seen.pixels) / candidates,
        eye=_eye(camera),
    )


def from_normals(
    normals: np.ndarray,
    camera: Camera | None,
    mask: np.ndarray | None = None,
    positions: np.ndarray | None = None,
    precision: Precision = np.float64,
) -> Surface:
    """The surface of a normal map H×W×3 (x right, y up, z toward the viewer; zero or NaN = background)."""
    camera = camera or Camera()
    shape = (normals.shape[0], normals.shape[1])
    length = np.linalg.norm(normals, axis=-1)
    inside = np.isfinite(length) & (length > 0.5)
    if mask is not None:
        inside &= mask
    pixels = np.flatnonzero(inside).astype(index_type(shape))
    unit = normals.reshape(-1, 3)[pixels].astype(np.float64)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    points = None if positions is None else positions.reshape(-1, 3)[pixels].astype(precision)
    sightlines = None
    if camera.orthographic:
        sightlines = -camera.forward[None]
    elif points is None:
        sightlines = -camera.rays(shape, pixels)[1]
    surface = Surface(
        shape=shape,
        pixels=pixels,
        normals=torch.from_numpy(unit.astype(precision, copy=False)),
        positions=None if points is None else torch.from_numpy(points),
        rim=near_silhouette(shape, pixels),
        sightlines=None if sightlines is None else torch.from_numpy(sightlines.astype(precision, copy=False)),
        eye=_eye(camera),
    )
    return surface.take(((surface.normals * surface.view).sum(-1) > 0).numpy())


def from_sphere(
    shape: tuple[int, int],
    centre: tuple[float, float],
    radius: float,
    mask: np.ndarray | None,
    precision: Precision = np.float64,
) -> Surface:
    """A sphere seen orthographically, its image a circle (pixels; centres at +0.5).

    Positions are in units of the radius, with the origin at the sphere's centre.
    """
    x = (np.arange(shape[1]) + 0.5 - centre[0]) / radius
    y = (centre[1] - np.arange(shape[0]) - 0.5) / radius
    inside = (x * x) + (y * y)[:, None] < 1
    if mask is not None:
        inside &= mask
    pixels = np.flatnonzero(inside).astype(index_type(shape))
    rows = pixels // shape[1]
    x, y = x[pixels - rows * shape[1]], y[rows]
    normals = np.stack([x, y, np.sqrt(1 - (x * x + y * y))], axis=-1).astype(precision, copy=False)
    return Surface(
        shape=shape,
        pixels=pixels,
        normals=torch.from_numpy(normals),
        positions=torch.from_numpy(normals.copy()),
        rim=near_silhouette(shape, pixels),
        sightlines=torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64),
        convex=True,
    )


def _eye(camera: Camera) -> Tensor | None:
    return None if camera.orthographic else torch.tensor(camera.position, dtype=torch.float64)
