"""From the tables of a capture or scene file to geometry, lights and encoding."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from matest.capture.schema import CameraTable, CaptureFile, EncodingTable, GeometryTable, ImageTable, LightTable
from matest.errors import InputError
from matest.photographs.images import full_scale, read_image, read_mask
from matest.photographs.photometry import Encoding
from matest.scene.camera import Camera
from matest.scene.lights import DirectionalLight, Light, PointLight, unit_direction
from matest.scene.mesh import Mesh
from matest.scene.scene import Scene
from matest.scene.surface import Surface, fit_circle, from_mesh, from_normals, from_sphere


@dataclass(frozen=True)
class Folder:
    """Where the references in a file point: its own folder, and the folder that nothing may lead out of."""

    source: Path
    root: Path

    @property
    def path(self) -> Path:
        return self.source.parent

    def file(self, reference: str, key: str) -> Path:
        """The file a reference names.

        Raises:
            InputError: it lies outside the common folder of the captures, or does not exist.
        """
        target = Path(os.path.normpath(self.path / reference))
        if not Path(os.path.abspath(target)).is_relative_to(os.path.abspath(self.root)):
            raise InputError(
                f"{self.source}: {key} = '{reference}' leads outside {self.root}, the captures' common folder; "
                "copy the file into it and refer to it there."
            )
        if not target.is_file():
            raise InputError(f"{target}: no such file; {key} refers to it. Put it there or correct the name.")
        return target


def build_camera(table: CameraTable, label: str) -> Camera:
    """Raises InputError when the keys do not fit the kind of camera."""
    perspective = table.kind == "perspective"
    given = [key for key in ("fov_y", "matrix") if getattr(table, key) is not None]
    if perspective and len(given) != 1:
        raise InputError(f"{label}: [camera] of kind 'perspective' needs fov_y or matrix, one of them; got {given}.")
    if not perspective and (given or table.distortion):
        raise InputError(f"{label}: [camera] of kind 'orthographic' takes height, not fov_y, matrix or distortion.")
    if table.height is not None and not table.height > 0:
        raise InputError(f"{label}: camera.height must be positive world units; got {table.height}.")
    if table.fov_y is not None and not 0 < table.fov_y < math.pi:
        raise InputError(f"{label}: camera.fov_y must lie between 0 and π rad; got {table.fov_y}.")
    if len(table.distortion) not in (0, 4, 5, 8):
        raise InputError(f"{label}: camera.distortion takes k1, k2, p1, p2[, k3]; got {len(table.distortion)} numbers.")
    if table.matrix is not None and (table.matrix[0][1], table.matrix[1][0], *table.matrix[2]) != (0, 0, 0, 0, 1):
        raise InputError(f"{label}: camera.matrix must read [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]; skew is not known.")
    distortion = tuple(table.distortion)
    try:
        return Camera(table.position, table.target, table.up, table.height, table.fov_y, table.matrix, distortion)
    except InputError as error:
        raise InputError(f"{label}: {error}") from None


def build_surface(tables: CaptureFile, folder: Folder, shape: tuple[int, int], label: str) -> Surface:
    """The visible surface for images of `shape`.

    Raises:
        InputError: geometry missing or ambiguous, or of another size than the images.
    """
    geometry = tables.geometry
    kinds = [key for key in ("mesh", "normals", "shape") if getattr(geometry, key) is not None]
    if len(kinds) != 1:
        raise InputError(
            f"{label}: [geometry] needs one of mesh, normals or shape; got {' and '.join(kinds) or 'none'}."
        )
    level = None
    if tables.mask is not None:
        level = read_mask(folder.file(tables.mask, "mask"))
        _same_size(level, shape, f"{folder.path / tables.mask}: the mask")
    mask = None if level is None else level > 0
    camera = build_camera(tables.camera, label) if tables.camera is not None else None
    if geometry.mesh is not None:
        if camera is None or (camera.orthographic and camera.height is None):
            raise InputError(
                f"{label}: a mesh needs a [camera] with position, target and height (orthographic), fov_y or matrix."
            )
        path = folder.file(geometry.mesh, "geometry.mesh")
        try:
            return from_mesh(Mesh.load(path), camera, shape, mask)
        except InputError as error:
            raise InputError(str(error) if str(error).startswith(str(path)) else f"{path}: {error}") from None
    if geometry.normals is not None:
        return _mapped(geometry, folder, shape, camera, mask)
    if camera is not None and not camera.orthographic:
        raise InputError(
            f"{label}: shape = 'sphere' is a circle seen by a distant camera; for a perspective camera give the sphere "
            "as a mesh."
        )
    return _sphere(geometry, shape, level, label)


def build_lights(table: ImageTable, channels: int, label: str) -> tuple[tuple[Light, ...], bool]:
    """The lights of one image, and whether the power of all of them was given."""
    built = [_light(light, channels, f"{label}, light {k}") for k, light in enumerate(table.lights)]
    return tuple(light for light, _ in built), all(known for _, known in built)


def build_scene(tables: CaptureFile, folder: Folder, surface: Surface, channels: int) -> tuple[Scene, bool]:
    """Surface, lights and ambient light of every image, shadows traced; and whether the power of all lights was given.

    Raises:
        InputError: a light or ambient radiance that makes no sense, a near light on a surface without positions.
    """
    lights, ambient, known = [], [], True
    for number, table in enumerate(tables.image):
        label = f"{folder.source}: image {number}"
        built, given = build_lights(table, channels, label)
        if surface.positions is None and any(light.near for light in built):
            raise InputError(
                f"{label}: a light with a position needs the surface's positions; give a mesh, or positions beside the "
                "normal map."
            )
        lights.append(built)
        known &= given
        ambient.append(colour(table.ambient, channels, f"{label}: ambient"))
    wavelength = None
    if tables.camera is not None and tables.camera.wavelength is not None:
        wavelength = colour(tables.camera.wavelength, channels, f"{folder.source}: camera.wavelength")
        if not bool(((wavelength > 0.1) & (wavelength < 20)).all()):
            raise InputError(
                f"{folder.source}: camera.wavelength is in µm (green is 0.55); got {tables.camera.wavelength}."
            )
    return Scene(surface, tuple(lights), torch.stack(ambient), wavelength=wavelength).with_shadows(), known


def build_encoding(
    table: EncodingTable, folder: Folder, surface: Surface, first: np.ndarray, transfer: str | float | None
) -> Encoding:
    """The encoding of images like `first` (H×W×C). `transfer` overrides the file's.

    Raises:
        InputError: integer images without a transfer function.
    """
    label, integer, channels = str(folder.source), first.dtype.kind == "u", first.shape[2]
    chosen = transfer if transfer is not None else table.transfer
    if chosen is None:
        if integer:
            raise InputError(
                f"{label}: integer images need to say how pixels encode light, and nothing says it; add transfer = "
                '"linear" (raw, PNG of a linear renderer) or "srgb" (camera JPEG) to [encoding], or give --transfer.'
            )
        chosen = "linear"
    if not isinstance(chosen, str) and not chosen > 0:
        raise InputError(f"{label}: encoding.transfer as a number is a gamma and must be positive; got {chosen}.")
    saturation = table.saturation if table.saturation is not None else (0.98 if integer else None)
    scale = 1.0 if table.scale is None else table.scale
    if not (math.isfinite(scale) and scale > 0):
        raise InputError(f"{label}: encoding.scale is the radiance of full scale and must be positive; got {scale}.")
    encoding = Encoding(transfer=chosen, scale=scale, saturation=saturation)
    black: float | np.ndarray
    if isinstance(table.black, str):
        black = _frame(folder.file(table.black, "encoding.black"), surface, encoding, channels)
    else:
        black = float(encoding.linear(np.array(table.black)))
    flat = None
    if table.flat is not None:
        flat = _frame(folder.file(table.flat, "encoding.flat"), surface, encoding, channels)
        if not (flat > 0).all():
            raise InputError(f"{folder.path / table.flat}: a flat field must be positive on the object; it is 0 there.")
    return Encoding(chosen, scale, black, flat, saturation)


def colour(value: float | list[float], channels: int, label: str) -> Tensor:
    """A number or one number per channel as [C], finite and not negative."""
    values = torch.atleast_1d(torch.as_tensor(value, dtype=torch.float64))
    if len(values) not in (1, channels) or not bool((torch.isfinite(values) & (values >= 0)).all()):
        raise InputError(
            f"{label} must be one number or {channels} (one per channel of the images), finite and not negative; got "
            f"{value}."
        )
    return values.expand(channels).clone()


def _light(table: LightTable, channels: int, label: str) -> tuple[Light, bool]:
    if (table.direction is None) == (table.position is None):
        raise InputError(f"{label}: needs either direction (a distant light) or position (a near one).")
    distant = table.direction is not None
    power, unit = (table.irradiance, "irradiance") if distant else (table.intensity, "intensity")
    if (table.intensity if distant else table.irradiance) is not None:
        raise InputError(f"{label}: a light with direction has irradiance, one with position has intensity.")
    if table.solid_angle is not None and not 0 < table.solid_angle <= 4 * math.pi:
        raise InputError(f"{label}: solid_angle must lie between 0 and 4π sr; got {table.solid_angle}.")
    known = power is not None or table.radiance is not None
    if table.radiance is not None:
        if table.solid_angle is None or not distant or power is not None:
            raise InputError(f"{label}: radiance goes with direction and solid_angle, and without irradiance.")
        emitted = colour(table.radiance, channels, f"{label}: radiance") * table.solid_angle
    else:
        emitted = colour(math.pi if power is None else power, channels, f"{label}: {unit}")
    if table.direction is not None:
        direction = unit_direction(list(table.direction), label)
        return DirectionalLight(direction, emitted, table.solid_angle), known
    assert table.position is not None
    position = torch.tensor(table.position, dtype=torch.float64)
    if not bool(torch.isfinite(position).all()):
        raise InputError(f"{label}: position must be finite; got {list(table.position)}.")
    return PointLight(position, emitted, table.solid_angle), known


def _mapped(
    geometry: GeometryTable, folder: Folder, shape: tuple[int, int], camera: Camera | None, mask: np.ndarray | None
) -> Surface:
    assert geometry.normals is not None
    path = folder.file(geometry.normals, "geometry.normals")
    normals = _vectors(path, shape, "normals")
    positions = None
    if geometry.positions is not None:
        positions = _vectors(folder.file(geometry.positions, "geometry.positions"), shape, "positions")
    surface = from_normals(normals, camera, mask, positions)
    if not len(surface):
        raise InputError(f"{path}: no pixel has a normal that faces the viewer; z must point toward the viewer.")
    return surface


def _sphere(geometry: GeometryTable, shape: tuple[int, int], level: np.ndarray | None, label: str) -> Surface:
    if (geometry.centre is None) != (geometry.radius is None):
        raise InputError(f"{label}: give both centre and radius of the sphere, or neither (they are fitted).")
    if geometry.centre is not None and geometry.radius is not None:
        centre, radius = geometry.centre, geometry.radius
        if not radius > 0:
            raise InputError(f"{label}: geometry.radius must be positive pixels; got {radius}.")
    elif level is None:
        raise InputError(
            f"{label}: shape = 'sphere' needs a mask to fit the circle to, or centre and radius in pixels."
        )
    else:
        try:
            centre, radius = fit_circle(level)
        except InputError as error:
            raise InputError(f"{label}: {error}") from None
    surface = from_sphere(shape, centre, radius, None if level is None else level > 0)
    if not len(surface):
        raise InputError(f"{label}: the sphere at {centre} with radius {radius} covers no pixel of the image and mask.")
    return surface


def _vectors(path: Path, shape: tuple[int, int], what: str) -> np.ndarray:
    """An H×W×3 map of vectors; integers encode −1…1 as 0…full scale."""
    image = read_image(path)
    if image.shape[:2] != shape or image.shape[2] != 3:
        raise InputError(
            f"{path}: {what} must be H×W×3 like the images ({shape[0]}×{shape[1]}×3); got "
            f"{'×'.join(map(str, image.shape))}. Render them at the images' resolution."
        )
    if image.dtype.kind == "u":
        background = ~image.any(axis=2)
        vectors = image.astype(np.float64) / (full_scale(image.dtype) / 2) - 1
        vectors[background] = 0
        return vectors
    return image


def _frame(path: Path, surface: Surface, encoding: Encoding, channels: int) -> np.ndarray:
    """A dark frame or flat field at the object's pixels, linear fractions of full scale, [N, 1 or C]."""
    image = read_image(path)
    _same_size(image, surface.shape, f"{path}: the frame")
    if image.shape[2] not in (1, channels):
        raise InputError(
            f"{path}: the frame must have 1 or {channels} channel(s) like the images; got {image.shape[2]}."
        )
    pixels = image.reshape(-1, image.shape[2])[surface.pixels]
    # Floats are linear already; integers are encoded as the images are.
    return encoding.signal(pixels, slice(None)) if image.dtype.kind == "u" else pixels


def _same_size(image: np.ndarray, shape: tuple[int, int], label: str) -> None:
    if image.shape[:2] != shape:
        raise InputError(
            f"{label} must have the size of the images ({shape[0]}×{shape[1]}); got {image.shape[0]}×{image.shape[1]}. "
            "Export it at the images' resolution."
        )
