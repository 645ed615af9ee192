"""From the tables of geometry and camera in a file to the surface that its images show."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from matest.capture.description import Description
from matest.capture.objects import objects_mesh
from matest.capture.schema import CameraTable
from matest.errors import Fault, InputError, errors_of, refuse
from matest.photographs.images import full_scale, read_image, read_mask
from matest.scene.camera import Camera
from matest.scene.circle import Circle, fit_circle
from matest.scene.mesh import Mesh
from matest.scene.objects import Objects
from matest.scene.sight import Precision
from matest.scene.surface import Surface, from_mesh, from_normals, from_sphere


@dataclass(frozen=True)
class _View:
    """The geometry of a description as `factor` × `factor` rays per pixel see it.

    Attributes:
        shape: height and width of the images in pixels.
        coverage: of each pixel by the mask, [H, W] in [0, 1].
        camera: for `factor` times the resolution of the images.
        precision: of the surface.
    """

    description: Description
    shape: tuple[int, int]
    factor: int
    coverage: np.ndarray | None
    camera: Camera | None
    precision: Precision

    @property
    def fine_shape(self) -> tuple[int, int]:
        return self.factor * self.shape[0], self.factor * self.shape[1]

    @property
    def mask(self) -> np.ndarray | None:
        inside = None if self.coverage is None else self.coverage > 0
        if inside is None or self.factor == 1:
            return inside
        return inside.repeat(self.factor, axis=0).repeat(self.factor, axis=1)


def visible_surface(
    description: Description, shape: tuple[int, int], factor: int = 1, precision: Precision = np.float64
) -> Surface:
    """The surface that images of `shape` show, sampled by `factor` × `factor` rays per pixel, in some precision.

    Raises:
        InputError: geometry missing or ambiguous, or of another size than the images.
    """
    tables, file, coverage = description.tables, description.file, None
    kinds = [kind for kind in _SURFACES if getattr(tables.geometry, kind) is not None]
    if len(kinds) != 1 and not tables.object:
        kinds = kinds or ["none"]
        raise InputError(f"{file}: [geometry] needs one of mesh, normals or shape; got {' and '.join(kinds)}.")
    if tables.mask is not None:
        coverage = read_mask(description.path(tables.mask, "mask"))
        check_size(coverage, shape, f"{description.folder / tables.mask}: the mask")
    camera = None if tables.camera is None else camera_of(tables.camera, str(file), factor)
    view = _View(description, shape, factor, coverage, camera, precision)
    return _of_objects(view) if tables.object else _SURFACES[kinds[0]](view)


def check_size(image: np.ndarray, shape: tuple[int, int], label: str) -> None:
    """Refuse an image of another size than `shape`."""
    if image.shape[:2] != shape:
        raise InputError(
            f"{label} must have the size of the images ({shape[0]}×{shape[1]}); got {image.shape[0]}×{image.shape[1]}. "
            "Export it at the images' resolution."
        )


def camera_of(table: CameraTable, label: str, factor: int = 1) -> Camera:
    """The camera of images with `factor` times the resolution that its table is for.

    Raises:
        InputError: keys that do not fit the kind of camera, a pose without direction.
    """
    refuse(label, _camera_faults(table))
    matrix = table.matrix and (*(tuple(factor * value for value in row) for row in table.matrix[:2]), table.matrix[2])
    distortion = tuple(table.distortion)
    with errors_of(label):
        return Camera(table.position, table.target, table.up, table.height, table.fov_y, matrix, distortion)


def _camera_faults(table: CameraTable) -> Iterator[Fault]:
    keys = [key for key in ("fov_y", "matrix") if getattr(table, key) is not None]
    if table.kind == "perspective":
        yield len(keys) != 1, f"[camera] of kind 'perspective' needs fov_y or matrix, one of them; got {keys}."
    else:
        wrong = bool(keys or table.distortion)
        yield wrong, "[camera] of kind 'orthographic' takes height, not fov_y, matrix or distortion."
    count = len(table.distortion)
    yield count not in (0, 4, 5, 8), f"camera.distortion takes k1, k2, p1, p2[, k3]; got {count} numbers."
    if table.matrix is not None:
        skewed = (table.matrix[0][1], table.matrix[1][0], *table.matrix[2]) != (0, 0, 0, 0, 1)
        yield skewed, "camera.matrix must read [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]; skew is not known."


def _of_mesh(view: _View) -> Surface:
    camera = _needed_camera(view)
    path = view.description.path(view.description.tables.geometry.mesh or "", "geometry.mesh")
    mesh = Mesh.load(path)
    with errors_of(path):
        return from_mesh(mesh, camera, view.fine_shape, view.mask, view.precision)


def _of_objects(view: _View) -> Surface:
    camera, description = _needed_camera(view), view.description
    tables = description.tables.object
    mesh, object_of_face = objects_mesh(tables, description.path)
    with errors_of(description.file):
        surface = from_mesh(mesh, camera, view.fine_shape, view.mask, view.precision)
    objects = Objects(tuple(table.name for table in tables), object_of_face[surface.faces])
    rim = surface.rim | objects.borders(surface.shape, surface.pixels)
    return replace(surface, objects=objects, rim=rim)


def _needed_camera(view: _View) -> Camera:
    """The camera that a mesh needs.

    Raises:
        InputError: there is none.
    """
    camera, description = view.camera, view.description
    if camera is None or (camera.orthographic and camera.height is None):
        place = ""
        if description.layout is not None:
            place = (
                ", by which the directions of the list, that are in the camera's axes, are turned into those of the "
                "mesh; 'matest init' writes a capture.toml to put it in"
            )
        raise InputError(
            f"{description.file}: a mesh needs a [camera] with position, target and height (orthographic), fov_y or "
            f"matrix{place}."
        )
    return camera


def _of_normals(view: _View) -> Surface:
    geometry = view.description.tables.geometry
    path = view.description.path(geometry.normals or "", "geometry.normals")
    normals, positions = _vectors(path, view.shape, "normals"), None
    if geometry.positions is not None:
        positions_path = view.description.path(geometry.positions, "geometry.positions")
        positions = _vectors(positions_path, view.shape, "positions")
    elif geometry.width is not None:
        positions = _plane(view.shape, geometry.width)
    surface = from_normals(normals, view.camera, view.mask, positions, view.precision)
    if not len(surface):
        raise InputError(f"{path}: no pixel has a normal that faces the viewer; z must point toward the viewer.")
    return surface


def _of_sphere(view: _View) -> Surface:
    label, factor = view.description.file, view.factor
    if view.camera is not None and not view.camera.orthographic:
        raise InputError(
            f"{label}: shape = 'sphere' is a circle seen by a distant camera; for a perspective camera give the sphere "
            "as a mesh."
        )
    centre, radius, circle = _circle(view)
    centre_of_rays = (factor * centre[0], factor * centre[1])
    surface = from_sphere(view.fine_shape, centre_of_rays, factor * radius, view.mask, view.precision)
    if not len(surface):
        raise InputError(f"{label}: the sphere at {centre} with radius {radius} covers no pixel of the image and mask.")
    return replace(surface, circle=circle)


def _circle(view: _View) -> tuple[tuple[float, float], float, Circle | None]:
    """Centre and radius of the sphere in pixels, from the file or fitted to the mask; the fit where there is one."""
    geometry, label = view.description.tables.geometry, view.description.file
    if geometry.centre is not None and geometry.radius is not None:
        return geometry.centre, geometry.radius, None
    if geometry.centre is not None or geometry.radius is not None:
        raise InputError(f"{label}: give both centre and radius of the sphere, or neither (they are fitted).")
    if view.coverage is None:
        raise InputError(
            f"{label}: shape = 'sphere' needs a mask to fit the circle to, or centre and radius in pixels."
        )
    with errors_of(label):
        circle = fit_circle(view.coverage)
    return circle.centre, circle.radius, circle


def _vectors(path: Path, shape: tuple[int, int], content: str) -> np.ndarray:
    """A map of vectors [H, W, 3]; integers encode −1 to 1 as 0 to full scale, and a background of zeros."""
    image = read_image(path, coloured=False)
    if image.shape != (*shape, 3):
        raise InputError(
            f"{path}: {content} must be H×W×3 like the images ({shape[0]}×{shape[1]}×3); got "
            f"{'×'.join(map(str, image.shape))}. Render them at the images' resolution."
        )
    if image.dtype.kind == "f":
        return image
    return np.where(image.any(axis=2, keepdims=True), image / (full_scale(image.dtype) / 2) - 1, 0.0)


def _plane(shape: tuple[int, int], width: float) -> np.ndarray:
    """Positions [H, W, 3] of the pixel centres on the plane z = 0, the origin at the image's centre."""
    rows, columns = np.indices(shape) + 0.5
    scale = width / shape[1]
    return np.stack([scale * (columns - shape[1] / 2), scale * (shape[0] / 2 - rows), np.zeros(shape)], axis=-1)


# Makers of the surface by the key of [geometry] that names it.
_SURFACES: dict[str, Callable[[_View], Surface]] = {"mesh": _of_mesh, "normals": _of_normals, "shape": _of_sphere}
