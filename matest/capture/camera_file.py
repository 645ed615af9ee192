"""The camera of a capture that names another program's file: which photograph of that file is meant, and its camera."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import PurePosixPath

import msgspec

from matest.capture.description import Description
from matest.capture.formats.colmap import read_colmap
from matest.capture.formats.transforms import read_transforms
from matest.capture.formats.view import CameraFile, View
from matest.capture.schema import CameraTable, File, check_ranges
from matest.errors import Fault, InputError, nearest, refuse
from matest.photographs.readers import READERS

# Keys of [camera] that a file replaces.
_REPLACED = ("position", "target", "up", "height", "fov_y", "matrix", "distortion")
# Names of frames that a refusal lists, at most.
_LISTED = 4


def with_camera(description: Description[File], shape: tuple[int, int]) -> tuple[Description[File], tuple[str, ...]]:
    """The description with what `camera.file` says in place of its name, and sentences on how it was read.

    Args:
        description: of a capture or scene.
        shape: height and width of its images.

    Raises:
        InputError: the file cannot be read, has no camera for these images, or several.
    """
    table = description.tables.camera
    if table is None or (table.file is None and table.frame is None):
        return description, ()
    refuse(description.file, _faults(table))
    file = _read(description)
    size = (shape[1], shape[0])
    places = _places(description, file)
    view = file.view(places[0], size)
    other = next((place for place in places if file.view(place, size).table() != view.table()), None)
    if other is not None:
        names = f"'{file.names[places[0]]}' and '{file.names[other]}'"
        raise InputError(
            f"{description.file}: a capture has one camera for all images, but {names} have different ones in "
            f"{file.path}; make a capture of each view, or name one of them as frame in [camera]."
        )
    view, notes = _for_images(view, size, file)
    own = {key: getattr(table, key) for key in ("wavelength", "resolution", "supersampling")}
    camera = msgspec.structs.replace(view.table(), **own)
    tables = msgspec.structs.replace(description.tables, camera=camera)
    check_ranges(tables, file.path)
    return replace(description, tables=tables), tuple(f"{file.path.name}: {note}." for note in (*view.notes, *notes))


def _faults(table: CameraTable) -> Iterator[Fault]:
    yield table.file is None, "camera.frame is a photograph in camera.file; give the file, too."
    defaults = {field.name: field.default for field in msgspec.structs.fields(table)}
    stated = [key for key in _REPLACED if getattr(table, key) not in (defaults[key], [])]
    yield bool(stated), f"camera.file says everything of the camera; remove {', '.join(stated)} or the file."


def _read(description: Description) -> CameraFile:
    """The camera file of a description: a folder is a model of COLMAP."""
    paths = [description.path(name, key) for key, name in description.references if key == "camera.file"]
    if len(paths) > 1:
        return read_colmap(paths[0].parent)
    if paths[0].suffix.lower() != ".json":
        raise InputError(
            f"{paths[0]}: expected a transforms.json or the folder of a sparse model of COLMAP as camera.file; give "
            "one of them."
        )
    return read_transforms(paths[0])


def _places(description: Description, file: CameraFile) -> list[int]:
    """Places in the file of the photographs whose camera the images have."""
    table, names = description.tables.camera, list(file.names)
    assert table is not None
    if table.frame is not None:
        places = _same(table.frame, names)
        if not places:
            raise InputError(
                f"{description.file}: camera.frame = '{table.frame}' is not in {file.path}; {_some(table.frame, names)}"
            )
        return places
    images = [image.file for image in description.tables.image if image.file is not None]
    found = sorted({place for image in images for place in _same(image, names)})
    if found or len(names) == 1:
        return found or [0]
    raise InputError(
        f"{description.file}: none of the {len(names)} photographs in {file.path} has the name of an image; say which "
        f"one's camera it is, such as frame = '{names[0]}' in [camera]."
    )


def _some(name: str, names: Sequence[str]) -> str:
    """A clause with the nearest name, or with a few of them."""
    clause = nearest(name, names)
    return clause if len(names) <= _LISTED or clause.endswith("?") else f"known are {_first(names)} and more."


def _first(names: Iterable[str]) -> str:
    return ", ".join(list(names)[:_LISTED])


def _same(name: str, names: Sequence[str]) -> list[int]:
    """Places of the names that are like a name: the path, or else the file's name, or that without its suffix."""
    wanted = _spellings(name)
    for length in range(len(wanted)):
        places = [place for place, other in enumerate(names) if _spellings(other)[length] == wanted[length]]
        if places:
            return places
    return []


def _spellings(name: str) -> tuple[str, str, str]:
    path = PurePosixPath(name.replace("\\", "/"))
    return str(path), path.name, path.stem if path.suffix.lower() in READERS else path.name


def _for_images(view: View, size: tuple[int, int], file: CameraFile) -> tuple[View, tuple[str, ...]]:
    """The view with a lens for images of a size, and a note if it was for others."""
    stated = view.lens.size
    if stated == size:
        return view, ()
    lens = view.lens.scaled(size)
    sizes = ["×".join(map(str, one)) for one in (stated, size)]
    if lens is None:
        raise InputError(
            f"{file.path}: its camera is for images of {sizes[0]} pixels (width × height), but those of the capture "
            f"have {sizes[1]}; use the images that it was made from."
        )
    return replace(view, lens=lens), (f"its camera is for images of {sizes[0]} pixels and is scaled to {sizes[1]}",)
