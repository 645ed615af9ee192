"""What a capture or scene file says, read and checked before any of its photographs is looked at."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic

from matest.capture import schema
from matest.capture.schema import File
from matest.errors import InputError
from matest.photographs.images import read_image

# Largest width and height of images that are not there yet, pixels.
_MAX_SIDE = 16384


@dataclass(frozen=True)
class Description(Generic[File]):
    """A file and what stands in it.

    Attributes:
        file: that was read; its references are relative to the folder it lies in.
        root: folder that no reference may lead out of.
        tables: its content, every number of it possible.
    """

    file: Path
    root: Path
    tables: File

    @property
    def folder(self) -> Path:
        return self.file.parent

    @property
    def name(self) -> str:
        """Name of the folder."""
        return self.folder.absolute().name

    @property
    def names(self) -> tuple[str, ...]:
        """The image files as seen from the folder; numbers where there are none."""
        files = (table.file for table in self.tables.image)
        return tuple(
            f"image {number}" if file is None else os.path.relpath(self.folder / file, self.folder)
            for number, file in enumerate(files)
        )

    @property
    def references(self) -> list[tuple[str, str]]:
        """Keys that name files beside the images, and those files."""
        tables = self.tables
        values = {
            "mask": tables.mask,
            "geometry.mesh": tables.geometry.mesh,
            "geometry.normals": tables.geometry.normals,
            "geometry.positions": tables.geometry.positions,
            "encoding.black": tables.encoding.black,
            "encoding.flat": tables.encoding.flat,
        }
        return [(key, name) for key, name in values.items() if isinstance(name, str)]

    def path(self, reference: str, key: str) -> Path:
        """The file that a key of the tables refers to.

        Raises:
            InputError: it lies outside the common folder of the captures, or does not exist.
        """
        target = Path(os.path.normpath(self.folder / reference))
        if not Path(os.path.abspath(target)).is_relative_to(os.path.abspath(self.root)):
            raise InputError(
                f"{self.file}: {key} = '{reference}' leads outside {self.root}, the captures' common folder; "
                "copy the file into it and refer to it there."
            )
        if not target.is_file():
            raise InputError(f"{target}: no such file; {key} refers to it. Put it there or correct the name.")
        return target


def describe(path: str | Path, kind: type[File], *, root: Path | None = None) -> Description[File]:
    """Read a capture or scene file.

    Args:
        path: the file, or the folder that holds it.
        kind: `schema.CaptureFile` or `schema.SceneFile`.
        root: folder that file references may not leave (default: that of the file).

    Raises:
        InputError: no such file, something in it that is no key or number of its kind, no image.
    """
    scene = issubclass(kind, schema.SceneFile)
    file = capture_file(path, "scene.toml" if scene else "capture.toml")
    tables = schema.read(file, kind)
    if not tables.image:
        raise InputError(f"{file}: expected at least one [[image]]{' with lights' if scene else ''}; got none.")
    _check_numbers(tables, file)
    return Description(file, (root or file.parent).absolute(), tables)


def capture_file(path: str | Path, name: str) -> Path:
    """The TOML file that a path names: itself, or `name` inside the folder.

    Raises:
        InputError: there is none.
    """
    path = Path(path)
    file = path / name if path.is_dir() else path
    if not file.is_file():
        expected = f"expected a folder with a {name}" if path.is_dir() or not path.suffix else "no such file"
        raise InputError(f"{path}: {expected}; check the path.")
    if file.suffix.lower() != ".toml":
        raise InputError(
            f"{path}: expected a folder or its {name}; got a {file.suffix or 'nameless'} file. Give the folder."
        )
    return file


def image_shape(description: Description) -> tuple[int, int]:
    """Height and width of images that are not there yet: the camera's resolution, or the size of normal map or mask.

    Raises:
        InputError: nothing says it, or not in pixels.
    """
    file, tables = description.file, description.tables
    if tables.camera is not None and tables.camera.resolution is not None:
        width, height = tables.camera.resolution
        if not (0 < width <= _MAX_SIDE and 0 < height <= _MAX_SIDE):
            raise InputError(f"{file}: camera.resolution must be width and height in pixels; got [{width}, {height}].")
        return height, width
    for reference, key in ((tables.geometry.normals, "geometry.normals"), (tables.mask, "mask")):
        if reference is not None:
            height, width, _ = read_image(description.path(reference, key)).shape
            return height, width
    raise InputError(f"{file}: say how large the images are: resolution = [width, height] in [camera].")


def image_channels(description: Description, lengths: Iterable[int] = ()) -> int:
    """Channels of images that are not there yet: as many as the longest colour.

    Args:
        description: whose lights have colours.
        lengths: of the colours of a material.

    Raises:
        InputError: colours of neither one nor three values.
    """
    tables = description.tables
    colours: list[Any] = [image.ambient for image in tables.image]
    colours += [
        c for i in tables.image for light in i.lights for c in (light.irradiance, light.intensity, light.radiance)
    ]
    colours.append(tables.camera.wavelength if tables.camera else None)
    several = ({len(c) for c in colours if isinstance(c, list)} | {*lengths}) - {1}
    if not several <= {3}:
        raise InputError(
            f"{description.file}: colours must have 3 values (linear RGB) or be one number; got {sorted(several)} "
            "values."
        )
    return 3 if several else 1


def _check_numbers(tables: schema.CaptureFile, file: Path) -> None:
    """Refuse numbers that make no sense whatever else the file says.

    Raises:
        InputError: the first of them.
    """
    for value, possible, rule in _rules(tables):
        if not possible:
            raise InputError(f"{file}: {rule.format(value)}")


def _rules(tables: schema.CaptureFile) -> Iterator[tuple[float | None, bool, str]]:
    """Numbers of a file, whether they are possible, and what is said if not."""
    radius, camera, scale, noise = tables.geometry.radius, tables.camera, tables.encoding.scale, tables.noise
    yield radius, _positive(radius), "geometry.radius must be positive pixels; got {}."
    if camera is not None:
        yield camera.height, _positive(camera.height), "camera.height must be positive world units; got {}."
        possible = camera.fov_y is None or 0 < camera.fov_y < math.pi
        yield camera.fov_y, possible, "camera.fov_y must lie between 0 and π rad; got {}."
    yield scale, _positive(scale), "encoding.scale is the radiance of full scale and must be positive; got {}."
    if noise is not None:
        for key, value in (("read", noise.read), ("gain", noise.gain)):
            rule = f"noise.{key} must be finite and not negative; got {{}}. Correct or remove it."
            yield value, math.isfinite(value) and value >= 0, rule
    for number, image in enumerate(tables.image):
        yield image.exposure, _positive(image.exposure), f"image {number}: exposure must be positive; got {{}}."


def _positive(value: float | None) -> bool:
    """True where nothing is stated too."""
    return value is None or (math.isfinite(value) and value > 0)
