"""The first capture.toml of a folder, of what its files say."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import msgspec

from matest.capture import schema
from matest.capture.capture import load_capture
from matest.capture.description import Description, describe, layout_of
from matest.capture.formats import LAYOUTS
from matest.capture.writing import as_toml, changes
from matest.errors import InputError
from matest.progress import Progress, silent

# What a mesh needs and no light list says.
_CAMERA = """
# The files do not say where the camera stood, which a mesh needs: complete these lines and remove the marks. The
# directions of the lights are those of the list, in the axes of the camera
# ({axes}), and light_axes has them turned into those of the mesh.

# [camera]
# kind = "perspective"       # or "orthographic" with height = (world units across the image)
# position = [0, 0, 5]
# target = [0, 0, 0]
# up = [0, 1, 0]
# fov_y = 0.35               # rad
"""
_NO_CAMERA = (
    "The files do not say where the camera stood: complete [camera] in it, by which the lights ({axes}) are turned "
    "into the axes of the mesh, then run 'matest check'."
)
_NO_TRANSFER = "Images of integers also need transfer under [encoding]."


@dataclass(frozen=True)
class Initial:
    """A capture.toml that was written.

    Attributes:
        file: its path.
        understood: how the folder was read, a clause for each convention; empty where it cannot be read as it is.
        notes: what a person should know or do, as sentences.
    """

    file: Path
    understood: dict[str, str]
    notes: tuple[str, ...]


def initialise(path: str | Path, *, transfer: str | float | None = None, progress: Progress = silent) -> Initial:
    """Write the capture.toml of a folder of photographs with a list of lights and a shape.

    The folder is read as `estimate` would read it, so that the file gives the same result.

    Args:
        path: the folder, or the list of lights in it.
        transfer: how pixels encode light, where the folder does not say it or to override it.
        progress: called with a word, the number of images decoded and their total.

    Raises:
        InputError: there is a capture.toml; no lights or shape; anything about the files that cannot be used.
    """
    path = Path(path)
    file = (path if path.is_dir() else path.parent) / "capture.toml"
    _refuse_existing(file)
    if layout_of(path) is None:
        signs = ", ".join(layout.signs for layout in LAYOUTS)
        raise InputError(
            f"{path}: expected a folder of photographs with the directions of their lights; put one of these beside "
            f"them: {signs}."
        )
    description = describe(path, schema.CaptureFile)
    notes = () if description.content is None else description.content.notes
    if description.tables.geometry.mesh is not None and description.tables.camera is None:
        missing = (_NO_CAMERA.format(axes=_axes(description)), *([] if transfer is not None else [_NO_TRANSFER]))
        _write(file, _text(description, transfer, {}) + _CAMERA.format(axes=_axes(description)))
        return Initial(file, {}, (*notes, *missing))
    capture = load_capture(path, transfer=transfer, progress=progress)
    _write(file, _text(capture.description or description, transfer, capture.understood))
    return Initial(file, capture.understood, capture.photographs.notes)


def _text(description: Description, transfer: str | float | None, understood: dict[str, str]) -> str:
    """The file, which begins with how the folder was read."""
    tables = description.tables
    encoding = tables.encoding if transfer is None else msgspec.structs.replace(tables.encoding, transfer=transfer)
    files = ", ".join(source.name for source in description.sources)
    words = [f"Written by 'matest init' from {files} ({description.layout}); change what is not so."]
    words += [f"{topic}: {clause}" for topic, clause in understood.items() if topic != "read from"]
    if description.content is not None:
        words += [f"taken for granted: {assumption}" for assumption in description.content.assumptions]
    content = {} if tables.mask is None else {"mask": tables.mask}
    content |= {} if tables.light_axes == "world" else {"light_axes": tables.light_axes}
    content |= {"geometry": changes(tables.geometry), "encoding": changes(encoding)}
    content |= {} if tables.camera is None else {"camera": changes(tables.camera)}
    content |= {"image": [changes(image) for image in tables.image]}
    return "".join(f"# {line}\n" for line in words) + "\n" + as_toml(content)


def _axes(description: Description) -> str:
    """Of the lights, as the layout has them."""
    return "" if description.content is None else description.content.axes


def _refuse_existing(file: Path) -> None:
    if os.path.lexists(file):
        raise InputError(
            f"{file}: is there already and stays as it is; 'matest check' says how it is read, and a new one can be "
            "written once it has another name."
        )


def _write(file: Path, text: str) -> None:
    """Write a file that must not exist, whole or not at all.

    Raises:
        InputError: it exists.
        OSError: it cannot be written.
    """
    try:
        with file.open("x", encoding="utf-8") as target:
            try:
                target.write(text)
                target.flush()
            except OSError:
                file.unlink()
                raise
    except FileExistsError:
        _refuse_existing(file)
