"""From what a capture or scene file says to everything about its photographs but their pixels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from matest.capture.description import Description
from matest.capture.schema import CameraTable, GeometryTable, LightTable
from matest.errors import InputError
from matest.photographs.images import full_scale, read_image, read_mask
from matest.photographs.noise import Noise
from matest.photographs.photographs import Photographs
from matest.photographs.photometry import Encoding
from matest.scene.camera import Camera
from matest.scene.lights import DirectionalLight, Light, PointLight, unit_direction
from matest.scene.mesh import Mesh
from matest.scene.scene import Scene
from matest.scene.surface import Surface, fit_circle, from_mesh, from_normals, from_sphere

# Saturation of integer images that do not state theirs, fraction of full scale: many cameras clip a little below it.
_SATURATION = 0.98


@dataclass(frozen=True)
class ImageFormat:
    """What all images of a capture have in common.

    Attributes:
        shape: height and width in pixels.
        channels: 1 or 3.
        dtype: of the stored values.
    """

    shape: tuple[int, int]
    channels: int
    dtype: np.dtype

    @classmethod
    def of(cls, image: np.ndarray) -> ImageFormat:
        """That of an image H×W×C."""
        return cls((image.shape[0], image.shape[1]), image.shape[2], image.dtype)


@dataclass(frozen=True)
class Setup:
    """Everything about photographs but their pixels.

    Attributes:
        scene: surface, lights, shadows.
        encoding: from pixels to radiance.
        exposures: per image.
        noise: of the camera as stated, None if it is not.
        relative: True when the common scale of the lights is unknown.
        names: of the images.
    """

    scene: Scene
    encoding: Encoding
    exposures: tuple[float, ...]
    noise: Noise | None
    relative: bool
    names: tuple[str, ...]

    def photographs(self, stored: Sequence[np.ndarray], noise: Noise) -> Photographs:
        """Photographs that were taken so.

        Args:
            stored: per image the object's pixels [N, C].
            noise: stated and rounded, or estimated from them.
        """
        return Photographs(
            scene=self.scene,
            stored=tuple(stored),
            encoding=self.encoding,
            exposures=self.exposures,
            noise=noise,
            noise_stated=self.noise is not None,
            relative=self.relative,
            names=self.names,
        )


def realise(
    description: Description, images: ImageFormat, *, transfer: str | float | None = None, supersampling: int = 1
) -> Setup:
    """Geometry, light and camera of a description.

    Args:
        description: of a capture or scene.
        images: their format.
        transfer: overrides `encoding.transfer`: "linear", "srgb" or a gamma.
        supersampling: rays per pixel and axis: the scene has so many times the images' resolution.

    Raises:
        InputError: anything about the files that cannot be used, in one sentence.
    """
    tables = description.tables
    surface = _surface(description, images.shape, supersampling)
    encoding = _encoding(description, images, surface, transfer)
    scene, powers_stated = _scene(description, surface, images.channels)
    return Setup(
        scene=scene,
        encoding=encoding,
        exposures=tuple(table.exposure for table in tables.image),
        noise=None if tables.noise is None else Noise(tables.noise.read, tables.noise.gain),
        relative=tables.encoding.radiometry == "relative" or not powers_stated,
        names=description.names,
    )


def _camera(table: CameraTable, label: str, supersampling: int = 1) -> Camera:
    """The camera of images with so many times the resolution that the table speaks of.

    Raises:
        InputError: keys that do not fit the kind of camera.
    """
    perspective = table.kind == "perspective"
    given = [key for key in ("fov_y", "matrix") if getattr(table, key) is not None]
    if perspective and len(given) != 1:
        raise InputError(f"{label}: [camera] of kind 'perspective' needs fov_y or matrix, one of them; got {given}.")
    if not perspective and (given or table.distortion):
        raise InputError(f"{label}: [camera] of kind 'orthographic' takes height, not fov_y, matrix or distortion.")
    if len(table.distortion) not in (0, 4, 5, 8):
        raise InputError(f"{label}: camera.distortion takes k1, k2, p1, p2[, k3]; got {len(table.distortion)} numbers.")
    if table.matrix is not None and (table.matrix[0][1], table.matrix[1][0], *table.matrix[2]) != (0, 0, 0, 0, 1):
        raise InputError(f"{label}: camera.matrix must read [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]; skew is not known.")
    distortion = tuple(table.distortion)
    matrix: tuple[tuple[float, ...], ...] | None = table.matrix
    if matrix is not None:
        across, down = (tuple(supersampling * value for value in row) for row in matrix[:2])
        matrix = (across, down, matrix[2])
    try:
        return Camera(table.position, table.target, table.up, table.height, table.fov_y, matrix, distortion)
    except InputError as error:
        raise InputError(f"{label}: {error}") from None


def _surface(description: Description, shape: tuple[int, int], supersampling: int = 1) -> Surface:
    """The visible surface for images of `shape`, or with so many times their resolution.

    Raises:
        InputError: geometry missing or ambiguous, or of another size than the images.
    """
    label, tables = str(description.file), description.tables
    geometry = tables.geometry
    kinds = [key for key in ("mesh", "normals", "shape") if getattr(geometry, key) is not None]
    if len(kinds) != 1:
        raise InputError(
            f"{label}: [geometry] needs one of mesh, normals or shape; got {' and '.join(kinds) or 'none'}."
        )
    level = None
    if tables.mask is not None:
        level = read_mask(description.path(tables.mask, "mask"))
        _same_size(level, shape, f"{description.folder / tables.mask}: the mask")
    mask = None if level is None else (level > 0).repeat(supersampling, axis=0).repeat(supersampling, axis=1)
    fine = (supersampling * shape[0], supersampling * shape[1])
    camera = _camera(tables.camera, label, supersampling) if tables.camera is not None else None
    if geometry.mesh is not None:
        if camera is None or (camera.orthographic and camera.height is None):
            raise InputError(
                f"{label}: a mesh needs a [camera] with position, target and height (orthographic), fov_y or matrix."
            )
        path = description.path(geometry.mesh, "geometry.mesh")
        try:
            return from_mesh(Mesh.load(path), camera, fine, mask)
        except InputError as error:
            raise InputError(str(error) if str(error).startswith(str(path)) else f"{path}: {error}") from None
    if geometry.normals is not None:
        return _mapped(description, shape, camera, mask)
    if camera is not None and not camera.orthographic:
        raise InputError(
            f"{label}: shape = 'sphere' is a circle seen by a distant camera; for a perspective camera give the sphere "
            "as a mesh."
        )
    centre, radius = _circle(geometry, level, label)
    surface = from_sphere(fine, (supersampling * centre[0], supersampling * centre[1]), supersampling * radius, mask)
    if not len(surface):
        raise InputError(f"{label}: the sphere at {centre} with radius {radius} covers no pixel of the image and mask.")
    return surface


def _scene(description: Description, surface: Surface, channels: int) -> tuple[Scene, bool]:
    """Surface, lights and ambient light of every image, shadows traced; and whether the power of all lights is stated.

    Raises:
        InputError: a light or ambient radiance that makes no sense, a near light on a surface without positions.
    """
    file, tables = description.file, description.tables
    lights, ambient, powers_stated = [], [], True
    for number, table in enumerate(tables.image):
        label = f"{file}: image {number}"
        built = tuple(_light(light, channels, f"{label}, light {k}") for k, light in enumerate(table.lights))
        powers_stated &= all(light.power_stated for light in table.lights)
        if surface.positions is None and any(light.near for light in built):
            raise InputError(
                f"{label}: a light with a position needs the surface's positions; give a mesh, or positions beside the "
                "normal map."
            )
        lights.append(built)
        ambient.append(_colour(table.ambient, channels, f"{label}: ambient"))
    wavelength = None
    if tables.camera is not None and tables.camera.wavelength is not None:
        wavelength = _colour(tables.camera.wavelength, channels, f"{file}: camera.wavelength")
        if not bool(((wavelength > 0.1) & (wavelength < 20)).all()):
            raise InputError(f"{file}: camera.wavelength is in µm (green is 0.55); got {tables.camera.wavelength}.")
    return Scene(surface, tuple(lights), torch.stack(ambient), wavelength=wavelength).with_shadows(), powers_stated


def _encoding(
    description: Description, images: ImageFormat, surface: Surface, transfer: str | float | None
) -> Encoding:
    """The encoding of images of a format. `transfer` overrides the file's.

    Raises:
        InputError: integer images without a transfer function, a dark frame or flat field that does not fit them.
    """
    file, table, integer = description.file, description.tables.encoding, images.dtype.kind == "u"
    transfer = table.transfer if transfer is None else transfer
    if transfer is None:
        if integer:
            raise InputError(
                f"{file}: integer images need to say how pixels encode light, and nothing says it; add transfer = "
                '"linear" (raw, PNG of a linear renderer) or "srgb" (camera JPEG) to [encoding], or give --transfer.'
            )
        transfer = "linear"
    if not isinstance(transfer, str) and not transfer > 0:
        raise InputError(f"{file}: encoding.transfer as a number is a gamma and must be positive; got {transfer}.")
    saturation = table.saturation if table.saturation is not None else (_SATURATION if integer else None)
    scale = 1.0 if table.scale is None else table.scale
    encoding = Encoding(transfer=transfer, scale=scale, saturation=saturation)
    black: float | np.ndarray
    if isinstance(table.black, str):
        black = _frame(description.path(table.black, "encoding.black"), surface, encoding, images.channels)
    else:
        black = float(encoding.linear(np.array(table.black)))
    flat = None
    if table.flat is not None:
        flat = _frame(description.path(table.flat, "encoding.flat"), surface, encoding, images.channels)
        if not (flat > 0).all():
            raise InputError(
                f"{description.folder / table.flat}: a flat field must be positive on the object; it is 0 there."
            )
    return Encoding(transfer, scale, black, flat, saturation)


def _colour(value: float | list[float], channels: int, label: str) -> Tensor:
    """A number or one number per channel as [C], finite and not negative."""
    values = torch.atleast_1d(torch.as_tensor(value, dtype=torch.float64))
    if len(values) not in (1, channels) or not bool((torch.isfinite(values) & (values >= 0)).all()):
        raise InputError(
            f"{label} must be one number or {channels} (one per channel of the images), finite and not negative; got "
            f"{value}."
        )
    return values.expand(channels).clone()


def _light(table: LightTable, channels: int, label: str) -> Light:
    if (table.direction is None) == (table.position is None):
        raise InputError(f"{label}: needs either direction (a distant light) or position (a near one).")
    distant = table.direction is not None
    power, unit = (table.irradiance, "irradiance") if distant else (table.intensity, "intensity")
    if (table.intensity if distant else table.irradiance) is not None:
        raise InputError(f"{label}: a light with direction has irradiance, one with position has intensity.")
    if table.solid_angle is not None and not 0 < table.solid_angle <= 4 * math.pi:
        raise InputError(f"{label}: solid_angle must lie between 0 and 4π sr; got {table.solid_angle}.")
    if table.radiance is not None:
        if table.solid_angle is None or not distant or power is not None:
            raise InputError(f"{label}: radiance goes with direction and solid_angle, and without irradiance.")
        emitted = _colour(table.radiance, channels, f"{label}: radiance") * table.solid_angle
    else:
        emitted = _colour(math.pi if power is None else power, channels, f"{label}: {unit}")
    if table.direction is not None:
        direction = unit_direction(list(table.direction), label)
        return DirectionalLight(direction, emitted, table.solid_angle)
    assert table.position is not None
    position = torch.tensor(table.position, dtype=torch.float64)
    if not bool(torch.isfinite(position).all()):
        raise InputError(f"{label}: position must be finite; got {list(table.position)}.")
    return PointLight(position, emitted, table.solid_angle)


def _mapped(
    description: Description, shape: tuple[int, int], camera: Camera | None, mask: np.ndarray | None
) -> Surface:
    geometry = description.tables.geometry
    assert geometry.normals is not None
    path = description.path(geometry.normals, "geometry.normals")
    normals = _vectors(path, shape, "normals")
    positions = None
    if geometry.positions is not None:
        positions = _vectors(description.path(geometry.positions, "geometry.positions"), shape, "positions")
    surface = from_normals(normals, camera, mask, positions)
    if not len(surface):
        raise InputError(f"{path}: no pixel has a normal that faces the viewer; z must point toward the viewer.")
    return surface


def _circle(geometry: GeometryTable, level: np.ndarray | None, label: str) -> tuple[tuple[float, float], float]:
    """Centre and radius of the sphere in pixels, as stated or fitted to the mask."""
    if (geometry.centre is None) != (geometry.radius is None):
        raise InputError(f"{label}: give both centre and radius of the sphere, or neither (they are fitted).")
    if geometry.centre is not None and geometry.radius is not None:
        return geometry.centre, geometry.radius
    if level is None:
        raise InputError(
            f"{label}: shape = 'sphere' needs a mask to fit the circle to, or centre and radius in pixels."
        )
    try:
        return fit_circle(level)
    except InputError as error:
        raise InputError(f"{label}: {error}") from None


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
