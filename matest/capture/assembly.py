"""From a capture or scene file to everything about its photographs except their pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from matest.capture import ranges
from matest.capture.camera_file import with_camera
from matest.capture.description import Description
from matest.capture.environment_maps import EnvironmentMaps
from matest.capture.geometry import check_size, visible_surface
from matest.capture.light_axes import in_world
from matest.capture.light_tables import colour, lights_of
from matest.errors import Fault, InputError, refuse
from matest.photographs.images import full_scale, read_image
from matest.photographs.noise import Noise
from matest.photographs.photographs import Photographs
from matest.photographs.photometry import Encoding
from matest.photographs.sensor import Sensor
from matest.scene.scene import Scene
from matest.scene.sight import Precision
from matest.scene.surface import Surface

# Saturation of integer images that do not state theirs, fraction of full scale: many cameras clip a little below it.
SATURATION = 0.98
# Smallest saturation that is suggested, fraction of full scale: cameras that fill their codes clip above it.
_LOWEST_SATURATION = 0.5
# Largest noise of integer images, fraction of full scale: codes lie above.
_MOST_NOISE = 0.1
# The same of the black level.
_MOST_BLACK = 0.5


@dataclass(frozen=True)
class ImageFormat:
    """The format of all images of a capture.

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
        """The format of an image [H, W, C]."""
        return cls((image.shape[0], image.shape[1]), image.shape[2], image.dtype)


@dataclass(frozen=True)
class Setup:
    """Everything about photographs except their pixels.

    Attributes:
        scene: surface, lights, shadows.
        encoding: from pixels to radiance.
        exposures: per image, 1 where the file states none.
        exposures_stated: whether the file states one.
        noise: of the camera, as the file states it; None where it does not.
        saturation_stated: whether the level at which it clips is stated.
        relative: True when the common scale of the lights is unknown.
        names: of the images.
        notes: on how the files of other programs were read, sentences for the user.
    """

    scene: Scene
    encoding: Encoding
    exposures: tuple[float, ...]
    exposures_stated: bool
    noise: Noise | None
    saturation_stated: bool
    relative: bool
    names: tuple[str, ...]
    notes: tuple[str, ...] = ()

    def with_exposures(self, files: Sequence[float | None]) -> Setup:
        """The setup with exposures that all image files state, relative to the first, where it does not state any."""
        first = files[0]
        if self.exposures_stated or first is None or None in files:
            return self
        exposures = tuple(exposure / first for exposure in files if exposure is not None)
        if max(exposures) == min(exposures):
            return self
        note = (
            f"Exposures are the nominal ones that the image files state, {min(exposures):.3g} to {max(exposures):.3g} "
            "of the first image's; state exposure for each [[image]] if they are known better."
        )
        return replace(self, exposures=exposures, notes=(*self.notes, note))

    def photographs(self, stored: Sequence[np.ndarray], sensor: Sensor) -> Photographs:
        """The photographs with these pixels.

        Args:
            stored: per image the object's pixels [N, C].
            sensor: that took them.
        """
        return Photographs(
            scene=self.scene,
            stored=stored,
            encoding=sensor.encoding,
            exposures=self.exposures,
            noise=sensor.noise,
            clipping=sensor.clipping,
            noise_stated=self.noise is not None,
            relative=self.relative,
            names=self.names,
            notes=self.notes,
        )


def realise(
    description: Description,
    images: ImageFormat,
    *,
    transfer: str | float | None = None,
    supersampling: int = 1,
    precision: Precision = np.float64,
    curvature: float | None = None,
) -> Setup:
    """Geometry, light and camera of a description.

    Args:
        description: of a capture or scene.
        images: their format.
        transfer: overrides `encoding.transfer`: "linear", "srgb" or a gamma.
        supersampling: rays per pixel and axis: the scene has so many times the images' resolution.
        precision: of the surface.
        curvature: of what the material reflects, by which lights with a size, and maps, get points that stand for them
            (`brdf.curvature`); None: it is not known.

    Raises:
        InputError: anything about the files that cannot be used, in one sentence.
    """
    description, of_camera = with_camera(description, images.shape)
    description, of_lights = in_world(description)
    tables = description.tables
    surface = visible_surface(description, images.shape, supersampling, precision)
    encoding = _encoding(description, images, surface, transfer)
    powers_stated = all(light.power_stated for image in tables.image for light in image.lights)
    return Setup(
        scene=_scene(description, surface, images.channels, curvature),
        encoding=encoding,
        exposures=tuple(1.0 if table.exposure is None else table.exposure for table in tables.image),
        exposures_stated=any(table.exposure is not None for table in tables.image),
        noise=_noise(description, images),
        saturation_stated=tables.encoding.saturation is not None,
        relative=tables.encoding.radiometry == "relative" or not powers_stated,
        names=description.names,
        notes=(*of_camera, *of_lights, *([] if surface.objects is None else surface.objects.notes)),
    )


def saturation(description: Description, images: ImageFormat) -> float | tuple[float, ...] | None:
    """Stored value from which on the sensor is saturated, one or one per channel; None: never.

    Raises:
        InputError: another number of values, or one that no integer reaches.
    """
    stated = description.tables.encoding.saturation
    if stated is None:
        return SATURATION if images.dtype.kind == "u" else None
    values = stated if isinstance(stated, list) else [stated]
    if len(values) not in (1, images.channels):
        raise InputError(
            f"{description.file}: encoding.saturation must be one number or {images.channels} (one per channel of the "
            f"images); got {stated}."
        )
    if images.dtype.kind == "u" and (highest := max(values)) > 1:
        raise InputError(
            f"{description.file}: encoding.saturation is a fraction of full scale, which no integer exceeds; got "
            f"{highest:g}; {_meant(highest, full_scale(images.dtype))}"
        )
    return tuple(values) if len(values) > 1 else values[0]


def _meant(saturation: float, top: float) -> str:
    """A clause with the fraction of full scale that a number above 1 may stand for: a percentage, or a code."""
    for unit in (100, top):
        if _LOWEST_SATURATION <= saturation / unit <= 1:
            return f"did you mean {saturation / unit:.2g}?"
    return "give at most 1."


def _noise(description: Description, images: ImageFormat) -> Noise | None:
    """The noise that a file states; None where it states none.

    Raises:
        InputError: in codes, not in fractions of full scale, or so much that integers hold nothing else.
    """
    table = description.tables.noise
    if table is None:
        return None
    if images.dtype.kind == "u":
        top = full_scale(images.dtype)
        stated = (("noise.read", table.read), ("noise.gain", table.gain))
        refuse(description.file, (_too_much(key, value, _MOST_NOISE, top) for key, value in stated))
    return Noise(table.read, table.gain)


def _too_much(key: str, value: float, most: float, top: float) -> Fault:
    """Whether a fraction of full scale of integers is beyond what sensors have, and the sentence that says so."""
    codes = f" If that is a code of {top:.0f}, give {value / top:.3g}." if abs(value) >= 1 else ""
    return abs(value) > most, f"{key} is a fraction of full scale, at most {most:g}; got {value:g}.{codes}"


def _encoding(
    description: Description, images: ImageFormat, surface: Surface, transfer: str | float | None
) -> Encoding:
    """The encoding of images of a format. `transfer` overrides the file's.

    Raises:
        InputError: integer images without a transfer function, a dark frame or flat field that does not fit them.
    """
    table, integer = description.tables.encoding, images.dtype.kind == "u"
    transfer = table.transfer if transfer is None else transfer
    if transfer is None and integer:
        mend = (
            'add transfer = "linear" (raw, PNG of a linear renderer) or "srgb" (camera JPEG) to [encoding], or give '
            "--transfer."
        )
        if description.layout is not None:
            mend = "give --transfer linear (raw, PNG of a linear renderer), srgb (camera JPEG) or a gamma."
        raise InputError(
            f"{description.file}: integer images need to say how pixels encode light, and nothing says it; {mend}"
        )
    if isinstance(transfer, int | float) and transfer not in ranges.GAMMA:
        raise InputError(f"{description.file}: encoding.transfer {ranges.GAMMA.rule}; got {transfer}.")
    encoding = Encoding(
        transfer="linear" if transfer is None else transfer,
        scale=1.0 if table.scale is None else table.scale,
        saturation=saturation(description, images),
    )

    def frame(file: str, key: str) -> np.ndarray:
        return _frame(description.path(file, key), surface, encoding, images.channels)

    if isinstance(table.black, str):
        black: float | np.ndarray = frame(table.black, "encoding.black")
    else:
        if integer:
            refuse(description.file, [_too_much("encoding.black", table.black, _MOST_BLACK, full_scale(images.dtype))])
        black = float(encoding.linear(np.array(table.black)))
    flat = None if table.flat is None else frame(table.flat, "encoding.flat")
    if table.flat is not None and flat is not None and not (flat > 0).all():
        raise InputError(
            f"{description.folder / table.flat}: a flat field must be positive on the object; it is 0 there."
        )
    return replace(encoding, black=black, flat=flat)


def _frame(path: Path, surface: Surface, encoding: Encoding, channels: int) -> np.ndarray:
    """A dark frame or flat field at the object's pixels, linear fractions of full scale, [N, 1 or C]."""
    image = read_image(path)
    check_size(image, surface.shape, f"{path}: the frame")
    if image.shape[2] not in (1, channels):
        raise InputError(
            f"{path}: the frame must have 1 or {channels} channel(s) like the images; got {image.shape[2]}."
        )
    pixels = image.reshape(-1, image.shape[2])[surface.pixels]
    # Floats are linear already; integers are encoded as the images are.
    return encoding.signal(pixels, slice(None)) if image.dtype.kind == "u" else pixels


def _scene(description: Description, surface: Surface, channels: int, curvature: float | None) -> Scene:
    """Surface, lights and ambient light of every image, with shadows.

    Raises:
        InputError: a light, ambient radiance or wavelength that makes no sense, a near light without positions.
    """
    file, camera = description.file, description.tables.camera
    lights, ambient = [], []
    maps = EnvironmentMaps(description.path, channels, curvature)
    for number, table in enumerate(description.tables.image):
        lights.append(lights_of(table, surface, channels, curvature, f"{file}: image {number}", maps))
        ambient.append(colour(table.ambient, channels, f"{file}: image {number}: ambient"))
    wavelength = None
    if camera is not None and camera.wavelength is not None:
        wavelength = colour(camera.wavelength, channels, f"{file}: camera.wavelength")
    return Scene(surface, tuple(lights), torch.stack(ambient), wavelength=wavelength).with_shadows()
