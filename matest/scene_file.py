"""A scene file: geometry, lights and camera like those of a capture, and the material of every object."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch

from matest.bands import Band, bands
from matest.brdf import Brdf, model, preset
from matest.brdf.curvature import curvature
from matest.capture import schema
from matest.capture.assembly import ImageFormat, Setup, realise
from matest.capture.description import Description, describe, image_channels, image_shape
from matest.direction_error import direction_note
from matest.errors import Fault, InputError, errors_of, refuse
from matest.estimation.specification import optics, resolve
from matest.parameters import Role
from matest.scene import Scene
from matest.scene.environment import MIRROR_SOLID_ANGLE
from matest.shading import Material
from matest.supersampling import PixelMeans

# Level of the brightest pixel of integer images without a scale, fraction of full scale: noise does not saturate it.
PEAK_LEVEL = 0.9
# Type of pixels by their bits, the better ones first; None: floats.
DTYPES = {16: np.uint16, 8: np.uint8, None: np.float32}
# Bits that each format of images can hold.
_BITS: dict[str, tuple[int | None, ...]] = {
    ".exr": (None,),
    ".npy": (None,),
    ".png": (16, 8),
    ".tif": (16, 8),
    ".tiff": (16, 8),
}


@dataclass(frozen=True)
class SimulatedScene:
    """A scene file and the geometry, light and material that it describes.

    Attributes:
        description: content of the file.
        images: format of the images that it is rendered to.
        material: the model, or by name that of each object.
        setup: geometry and lights at the images' resolution times the supersampling, and the camera.
        supersampling: rays per pixel and axis.
    """

    description: Description[schema.SceneFile]
    images: ImageFormat
    material: Material
    setup: Setup
    supersampling: int

    @property
    def scene(self) -> Scene:
        """Geometry and lights."""
        return self.setup.scene

    @property
    def notes(self) -> list[str]:
        """What is approximate about its images, in sentences."""
        directions = direction_note(self.scene, self.material)
        return [*self.setup.notes, *([] if directions is None else [directions])]

    @cached_property
    def pixels(self) -> PixelMeans:
        """The means over the rays of each pixel."""
        return PixelMeans.of(self.scene, self.supersampling)

    def by_band(self, values: np.ndarray) -> Iterator[tuple[Band, np.ndarray]]:
        """Bands of rows of its images, from top to bottom, and their share of values at covered pixels [m, …]."""
        first = 0
        for band in bands(self.scene.surface, self.supersampling):
            last = first + len(band.covered)
            yield band, values[first:last]
            first = last


def load_scene(path: str | Path) -> SimulatedScene:
    """Read a scene: a folder with a `scene.toml`, or that file.

    Raises:
        InputError: anything about it that cannot be used, in one sentence.
    """
    description = describe(path, schema.SceneFile)
    file, tables = description.file, description.tables
    material = material_in(description)
    images = scene_format(description, material)
    supersampling = tables.camera.supersampling if tables.camera else 1
    if supersampling > 1 and tables.geometry.normals:
        raise InputError(f"{file}: camera.supersampling must be 1 with a normal map; got {supersampling}.")
    if tables.encoding.flat is not None or isinstance(tables.encoding.black, str):
        raise InputError(f"{file}: a simulated camera has no flat field or dark frame; use a number for black.")
    black = tables.encoding.black
    if images.dtype.kind == "u" and not black < PEAK_LEVEL:
        raise InputError(f"{file}: encoding.black must leave room for light, below {PEAK_LEVEL}; got {black}.")
    transfer = tables.encoding.transfer or "linear"
    lights = [light for image in tables.image for light in image.lights]
    broad = any(light.size is not None or light.environment is not None for light in lights)
    setup = realise(
        description,
        images,
        transfer=transfer,
        supersampling=supersampling,
        curvature=max(map(curvature, brdfs_of(material))) if broad else None,
    )
    with errors_of(file):
        material = _with_optics(material, setup.scene)
    return SimulatedScene(description, images, material, setup, supersampling)


def material_in(description: Description[schema.SceneFile]) -> Material:
    """The material of a scene file, or by name those of its objects.

    Raises:
        InputError: see `material_of`.
    """
    tables, file = description.tables, description.file
    if not tables.object:
        return material_of(tables.material or {}, f"{file}: [material]")
    return {
        table.name: material_of(table.material or {}, f"{file}: object '{table.name}': [object.material]")
        for table in tables.object
    }


def brdfs_of(material: Material) -> list[Brdf]:
    """The model, or those of all objects."""
    return [*material.values()] if isinstance(material, Mapping) else [material]


def _with_optics(material: Material, scene: Scene) -> Material:
    """The material with the wavelengths and solid angles that the scene states."""
    if isinstance(material, Mapping):
        return {name: _seen(brdf, scene) for name, brdf in material.items()}
    return _seen(material, scene)


def _seen(brdf: Brdf, scene: Scene) -> Brdf:
    """A model with what the scene states; its mirror-like term sees a map as narrowly as that is looked up."""
    angles = [name for name, declared in brdf.declared.items() if declared.role is Role.SOLID_ANGLE]
    mirror = dict.fromkeys(angles if scene.surrounded else (), torch.tensor(MIRROR_SOLID_ANGLE, dtype=torch.float64))
    return brdf.replace({**optics(brdf, scene, mirror), **mirror})


def scene_format(description: Description[schema.SceneFile], material: Material) -> ImageFormat:
    """The format of the images that a scene of this material is rendered to.

    Raises:
        InputError: colours of neither one nor three values, no size, or file names whose format has not these bits.
    """
    colours = {len(value) for brdf in brdfs_of(material) for value in brdf.parameters.values() if value.ndim}
    channels = image_channels(description, colours)
    shape = image_shape(description)
    bits = bits_of(description.tables, str(description.file))
    return ImageFormat(shape, channels, np.dtype(DTYPES[bits]))


def material_of(table: dict[str, Any], label: str) -> Brdf:
    """The model of a table of a material: a preset, or parameters by name, by path, or in a table per component.

    Raises:
        InputError: an unknown model, preset or parameter, or a value outside its domain.
    """
    values = dict(table)
    expression, name = values.pop("model", None), values.pop("preset", None)
    if expression is not None and name is not None:
        raise InputError(f"{label} has both model and preset; give one of them.")
    if not isinstance(expression if name is None else name, str):
        raise InputError(f'{label} needs model = "NAME" or preset = "NAME"; \'matest models\' lists the names.')
    with errors_of(label):
        if name is not None:
            material = preset(name, values.pop("f0", None))
            if values:
                raise InputError(f"a preset has parameters of its own; leave out {', '.join(values)}.")
            return material
        brdf, fixed = model(expression)
        by_path: dict[str, Any] = dict(fixed)
        for key, value in values.items():
            parts = (
                {f"{key}.{inner}": number for inner, number in value.items()}
                if isinstance(value, dict)
                else {key: value}
            )
            by_path |= {resolve(brdf, path): number for path, number in parts.items()}
        return brdf.replace(by_path)


def bits_of(tables: schema.CaptureFile, label: str) -> int | None:
    """Bits of the images: as the scene says, or as the names of its files imply; None for floats.

    Raises:
        InputError: names of formats that cannot be written, that differ, or that hold no such bits.
    """
    files = [image.file for image in tables.image if image.file]
    bits = tables.noise.bits if tables.noise else None
    refuse(label, _name_faults(files))
    if not files:
        return bits
    common = [choice for choice in DTYPES if all(choice in _BITS[Path(file).suffix.lower()] for file in files)]
    if bits is None and common:
        return common[0]
    if bits not in common:
        raise InputError(f"{label}: {', '.join(files)} cannot hold noise.bits = {bits}; rename them or change bits.")
    return bits


def _name_faults(files: list[str]) -> Iterator[Fault]:
    """Names that images of a capture cannot have."""
    for file in files:
        path = Path(os.path.normpath(file))
        yield not file.isprintable(), f"file = {file!r} has characters that no name should have; rename it."
        unknown = path.suffix.lower() not in _BITS
        yield unknown, f"file = '{file}': images are written as {', '.join(_BITS)}; rename it."
        outside = path.is_absolute() or str(path).startswith("..")
        yield outside, f"file = '{file}' leads outside the capture's folder; name a file inside it."
