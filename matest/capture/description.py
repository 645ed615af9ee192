"""Capture and scene files, read and checked before any photograph is opened."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic

from matest.capture import schema
from matest.capture.formats import LAYOUTS, Content, Layout, recognise
from matest.capture.formats.colmap import model_files
from matest.capture.formats.folder import is_file
from matest.capture.objects import object_faults
from matest.capture.schema import File
from matest.errors import Fault, InputError, errors_of, refuse
from matest.photographs.images import read_image
from matest.samples.uncertainty import Uncertainty

# Name of the file that describes a capture.
_CAPTURE = "capture.toml"


@dataclass(frozen=True)
class Description(Generic[File]):
    """A capture or scene file and its content.

    Attributes:
        file: its path; references in it are relative to its folder.
        root: folder that contains all files that it may refer to.
        tables: its content, in which every number is possible.
        uncertainty: of what it states, as far as it says.
        layout: name of the layout that the tables are made from; None where they are a file's own.
        content: what that layout says.
        sources: the files that it is read from.
    """

    file: Path
    root: Path
    tables: File
    uncertainty: Uncertainty
    layout: str | None = None
    content: Content | None = None
    sources: tuple[Path, ...] = ()

    @property
    def folder(self) -> Path:
        return self.file.parent

    @property
    def name(self) -> str:
        """Name of the folder."""
        return self.folder.absolute().name

    @property
    def names(self) -> tuple[str, ...]:
        """Paths of the image files from the folder; numbers for images without file."""
        files = (table.file for table in self.tables.image)
        return tuple(
            f"image {number}" if file is None else os.path.relpath(self.folder / file, self.folder)
            for number, file in enumerate(files)
        )

    @property
    def files(self) -> tuple[Path, ...]:
        """Every file of the capture or scene: photographs, those that it is read from, those that they refer to.

        Raises:
            InputError: see `path`.
        """
        images = ((f"image {k}: file", table.file) for k, table in enumerate(self.tables.image))
        named = [self.path(name, key) for key, name in images if name is not None]
        return (*named, *self.sources, *(self.path(name, key) for key, name in self.references))

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
        named = [(key, name) for key, name in values.items() if isinstance(name, str)]
        named += [(f"object '{one.name}': mesh", one.mesh) for one in tables.object if one.mesh is not None]
        named += [(f"image {k}: environment", name) for k, name in self.environments]
        return named + [("camera.file", name) for name in self._camera_files]

    @property
    def environments(self) -> list[tuple[int, str]]:
        """Numbers of images and the maps of light around them, each file once."""
        lights = [(k, light.environment) for k, image in enumerate(self.tables.image) for light in image.lights]
        first: dict[str, int] = {}
        for number, name in lights:
            if name is not None:
                first.setdefault(name, number)
        return [(number, name) for name, number in first.items()]

    @property
    def _camera_files(self) -> list[str]:
        """The files that `camera.file` names: itself, or those of the model of COLMAP in that folder."""
        name = self.tables.camera.file if self.tables.camera is not None else None
        if name is None or not (self.folder / name).is_dir():
            return [] if name is None else [name]
        return [os.path.join(name, file) for file in model_files(self.folder / name)]

    def path(self, reference: str, key: str) -> Path:
        """The file that a key of the tables refers to.

        Raises:
            InputError: it lies outside the common folder of the captures, be it by a link, is no regular file, or does
                not exist.
        """
        if not reference.isprintable():
            raise InputError(f"{self.file}: {key} = {reference!r} has characters that no name should have; rename it.")
        target = Path(os.path.normpath(self.folder / reference))
        # What is rendered takes files along, which have to lie in its folder.
        scene = isinstance(self.tables, schema.SceneFile)
        outside = not Path(os.path.abspath(target)).is_relative_to(os.path.abspath(self.root))
        if outside or not Path(os.path.realpath(target)).is_relative_to(os.path.realpath(self.root)):
            how = "" if outside else " by a link"
            raise InputError(
                f"{self.file}: {key} = '{reference}' leads outside {self.root}, the captures' common folder{how}; "
                f"copy the file into it and refer to it there{'' if scene else ', or allow it with --allow-outside'}."
            )
        if not is_file(target):
            raise InputError(f"{target}: no such file; {key} refers to it. Put it there or correct the name.")
        return target


def describe(path: str | Path, kind: type[File], *, root: Path | None = None) -> Description[File]:
    """Read a capture or scene file, or for a capture the files of a layout.

    Args:
        path: the file, or the folder that holds it.
        kind: `schema.CaptureFile` or `schema.SceneFile`.
        root: folder that file references may not leave (default: that of the file).

    Raises:
        InputError: no such file, an unknown key, an impossible value, or no image.
    """
    scene = issubclass(kind, schema.SceneFile)
    laid_out = None if scene else layout_of(path)
    if laid_out is None:
        sources: tuple[Path, ...] = (capture_file(path, "scene.toml" if scene else _CAPTURE),)
        layout, content = None, None
        tables: Any = schema.read(sources[0], kind)
    else:
        layout, sources = laid_out[0].name, laid_out[1]
        content = laid_out[0].read(sources)
        tables = content.tables
    file = sources[0]
    if not tables.image:
        raise InputError(f"{file}: expected at least one [[image]]{' with lights' if scene else ''}; got none.")
    # What a layout says is checked like what a file says.
    schema.check_ranges(tables, file)
    refuse(file, _faults(tables))
    with errors_of(f"{file}: [uncertainty]"):
        uncertainty = Uncertainty.of(tables.uncertainty)
    return Description(file, (root or file.parent).absolute(), tables, uncertainty, layout, content, sources)


def object_names(path: str | Path) -> list[str]:
    """Names of the objects of a capture; none where it shows one without name.

    Raises:
        InputError: its file cannot be used.
    """
    if layout_of(path) is not None:
        return []
    return [table.name for table in describe(path, schema.CaptureFile).tables.object]


def layout_of(path: str | Path) -> tuple[Layout, tuple[Path, ...]] | None:
    """The layout that a folder without capture.toml is of, or that a file is of, and its files; None: of none.

    Raises:
        InputError: see `formats.recognise`.
    """
    path = Path(path)
    if not path.exists() or _is_toml(path) or (path / _CAPTURE).is_file():
        return None
    return recognise(path)


def capture_sources(path: str | Path) -> tuple[Path, ...]:
    """The files that a capture is described by: its capture.toml, or else those of a layout; errors name the first.

    Raises:
        InputError: there are none.
    """
    laid_out = layout_of(path)
    return (capture_file(path, _CAPTURE),) if laid_out is None else laid_out[1]


def capture_file(path: str | Path, name: str) -> Path:
    """The TOML file that a path names: itself, or `name` inside the folder.

    Raises:
        InputError: there is none.
    """
    path = Path(path)
    file = path / name if path.is_dir() else path
    if (path / "transforms.json").is_file() and not file.is_file():
        raise InputError(
            f"{path}: transforms.json has the cameras, but nothing says how the photographs are lit; write a {name} "
            'with [camera] file = "transforms.json", the geometry, and the lights of every image.'
        )
    if not file.is_file():
        signs = f", or with {', '.join(layout.signs for layout in LAYOUTS)}" if name == _CAPTURE else ""
        expected = f"expected a folder with a {name}{signs}" if path.is_dir() or not path.suffix else "no such file"
        raise InputError(f"{path}: {expected}; check the path.")
    if file.suffix.lower() != ".toml":
        raise InputError(
            f"{path}: expected a folder or its {name}; got a {file.suffix or 'nameless'} file. Give the folder."
        )
    return file


def _is_toml(path: Path) -> bool:
    return path.suffix.lower() == ".toml"


def image_shape(description: Description) -> tuple[int, int]:
    """Height and width of images that do not exist yet: the camera's resolution, or the size of normal map or mask.

    Raises:
        InputError: the file states no size.
    """
    file, tables = description.file, description.tables
    if tables.camera is not None and tables.camera.resolution is not None:
        width, height = tables.camera.resolution
        return height, width
    for reference, key in ((tables.geometry.normals, "geometry.normals"), (tables.mask, "mask")):
        if reference is not None:
            height, width, _ = read_image(description.path(reference, key)).shape
            return height, width
    raise InputError(f"{file}: say how large the images are: resolution = [width, height] in [camera].")


def image_channels(description: Description, lengths: Iterable[int] = ()) -> int:
    """Channels of images that do not exist yet: as many as the longest colour has.

    Args:
        description: its lights have colours.
        lengths: of the colours of a material.

    Raises:
        InputError: colours of neither one nor three values.
    """
    counts = dict.fromkeys(lengths, "a colour of the material")
    counts |= {len(colour): key for key, colour in _colours(description.tables) if isinstance(colour, list)}
    for k, name in description.environments:
        key = f"image {k}: environment"
        counts[read_image(description.path(name, key)).shape[2]] = key
    for count in sorted({*counts} - {1, 3}):
        raise InputError(
            f"{description.file}: {counts[count]} must have 3 values (linear RGB) or be one number; got {count}."
        )
    return 3 if 3 in counts else 1


def _colours(tables: schema.CaptureFile) -> Iterator[tuple[str, Any]]:
    """What has a value for each channel, or one for all, and its key."""
    if tables.camera is not None:
        yield "camera.wavelength", tables.camera.wavelength
    for k, image in enumerate(tables.image):
        yield f"image {k}: ambient", image.ambient
        for number, light in enumerate(image.lights):
            for key in ("irradiance", "intensity", "radiance"):
                yield f"image {k}, light {number}: {key}", getattr(light, key)


def _faults(tables: schema.CaptureFile) -> Iterator[Fault]:
    """Keys that do not go together whatever else the file says."""
    camera, geometry = tables.camera, tables.geometry
    near = camera is not None and camera.kind == "perspective"
    yield from object_faults(tables)
    flat = geometry.normals is not None and geometry.positions is None and not near
    sentence = "geometry.width goes with normals seen by a distant viewer, and without positions; leave it out."
    yield geometry.width is not None and not flat, sentence
