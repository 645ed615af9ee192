"""The mesh that a capture shows, and the camera that sees it, without the photographs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from matest.capture import schema
from matest.capture.camera_file import with_camera
from matest.capture.description import Description, describe
from matest.capture.geometry import camera_of, visible_surface
from matest.errors import InputError
from matest.scene.camera import Camera
from matest.scene.mesh import Mesh
from matest.scene.surface import Surface

# Facets of the mesh that stands for a sphere, from pole to pole and around: 0.03 % of its radius from it.
_SPHERE = (96, 192)


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """A mesh before the camera of a capture.

    Attributes:
        surface: the object's pixels.
        mesh: the whole object; of `shape = "sphere"` facets with texture coordinates, in units of the radius.
        camera: that sees it, in the mesh's coordinates.
        files: of the capture that they were read from.
    """

    surface: Surface
    mesh: Mesh
    camera: Camera
    files: tuple[Path, ...]


def load_viewpoint(path: str | Path, shape: tuple[int, int], *, root: Path | None = None) -> Viewpoint:
    """Read mesh, mask and camera of a capture.

    Args:
        path: folder or file.
        shape: height and width of its images.
        root: folder that file references may not leave (default: the capture's own).

    Raises:
        InputError: the files cannot be used, or the shape of the object is known as a normal map alone.
    """
    description, _ = with_camera(describe(path, schema.CaptureFile, root=root), shape)
    if description.tables.geometry.normals is not None:
        raise InputError(
            f"{description.file}: the object's shape is a normal map, which has no back and no texture coordinates; "
            "textures need a mesh in [geometry]."
        )
    if description.tables.object:
        raise InputError(
            f"{description.file}: shows several objects, and textures are made of one in [geometry] only; export the "
            "material without maps."
        )
    surface = visible_surface(description, shape, precision=np.float32)
    files = (*description.sources, *(description.path(name, key) for key, name in description.references))
    if surface.mesh is None:
        return Viewpoint(surface, _sphere(), _camera_before_sphere(surface), files)
    return Viewpoint(surface, surface.mesh, _camera(description), files)


def _camera(description: Description) -> Camera:
    table = description.tables.camera
    # A mesh is not visible without one.
    assert table is not None
    return camera_of(table, str(description.file))


def _sphere() -> Mesh:
    """The unit sphere: texture coordinates are longitude from the back, and latitude."""
    rows, columns = _SPHERE
    v, u = np.meshgrid(np.linspace(1, 0, rows + 1), np.linspace(0, 1, columns + 1), indexing="ij")
    longitude, latitude = 2 * np.pi * (u - 0.5), np.pi * (v - 0.5)
    ring = np.cos(latitude)
    vertices = np.stack([ring * np.sin(longitude), np.sin(latitude), ring * np.cos(longitude)], -1).reshape(-1, 3)
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    below, right = corner + columns + 1, corner + 1
    # The first row has no second triangle at its pole, the last row no first.
    upper = np.stack([corner, below, below + 1], axis=1)[: (rows - 1) * columns]
    lower = np.stack([corner, below + 1, right], axis=1)[columns:]
    return Mesh(vertices, np.concatenate([upper, lower]), vertices, np.stack([u.ravel(), v.ravel()], axis=1))


def _camera_before_sphere(surface: Surface) -> Camera:
    """The distant camera that sees the unit sphere where a surface shows it."""
    assert surface.positions is not None
    height, width = surface.shape
    rows = surface.pixels // width
    across = np.stack([surface.pixels - rows * width + 0.5, rows + 0.5])
    x, y = surface.positions[:, :2].double().numpy().T
    # Columns are centre + radius · x, rows centre − radius · y.
    radius = np.hypot(np.ptp(across[0]), np.ptp(across[1])) / np.hypot(np.ptp(x), np.ptp(y))
    centre = across[0].mean() - radius * x.mean(), across[1].mean() + radius * y.mean()
    place = (float((width / 2 - centre[0]) / radius), float((centre[1] - height / 2) / radius))
    return Camera(position=(*place, 2.0), target=(*place, 0.0), height=float(height / radius))
