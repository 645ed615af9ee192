"""RTI's list of lights: `.lp`, a line with their number, then `name x y z` for each photograph.

Directions point to the light, x right and z toward the camera. y is up in RTIBuilder's and Relight's lists, and down in
those of programs that count rows: the photographs decide. Strengths are equal and unknown.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from matest.capture.formats import folder
from matest.capture.formats.layout import Content, Layout
from matest.capture.formats.text import lines_of, number
from matest.capture.schema import CaptureFile, EncodingTable, ImageTable, LightTable
from matest.errors import InputError

# A number of lights: of nine digits at most, so that any text can be tried.
_COUNT = re.compile(r"[0-9]{1,9}")
# Numbers of a line, after the name.
_COORDINATES = 3
# Rounding of unit vectors that were written with three digits.
_UNIT_TOLERANCE = 2e-3


class Light(NamedTuple):
    """A line of a list.

    Attributes:
        line: its number in the file.
        name: of the photograph as written.
        direction: as written.
        commas: whether decimal commas were written.
    """

    line: int
    name: str
    direction: tuple[float, float, float]
    commas: bool


def _find(path: Path) -> tuple[Path, ...]:
    return folder.list_of_lights(path, ".lp")


def _read(files: tuple[Path, ...]) -> Content:
    file = files[0]
    lights = lights_in(file)
    images = [folder.image_named(file, light.name, light.line) for light in lights]
    for image, count in Counter(images).items():
        if count > 1:
            raise InputError(f"{file}: names {image} {count} times; each photograph has one light. Correct the list.")
    mask = folder.mask(file.parent)
    tables = CaptureFile(
        geometry=folder.geometry(file.parent),
        mask=None if mask is None else mask.name,
        encoding=EncodingTable(radiometry="relative"),
        image=[
            ImageTable(file=image, lights=[LightTable(direction=light.direction)])
            for image, light in zip(images, lights, strict=True)
        ],
    )
    assumptions = ["all lights are distant and equally strong"]
    if tables.geometry.shape is not None:
        assumptions.append("the mask is the outline of a sphere")
    judged = tables.geometry.mesh is None
    if not judged:
        assumptions.append("y of the list is up, which the photographs do not decide beside a mesh")
    return Content(
        tables=folder.with_view(tables, file.parent),
        axes="x right, y up, z toward the viewer",
        assumptions=tuple(assumptions),
        notes=(*_notes(lights, images), *folder.unlisted(file, images)),
        open_causes=("lights y down",) if judged else (),
    )


def lights_in(file: Path) -> list[Light]:
    """The lines of a list.

    Raises:
        InputError: no number of lights, another one than there are, or a line with something else.
    """
    (first, head), *lines = lines_of(file)
    if not _COUNT.fullmatch(head):
        raise InputError(
            f"{file}: line {first} should hold the number of lights and nothing else; got '{head[:60]}'. Add the line."
        )
    if int(head) != len(lines):
        raise InputError(
            f"{file}: line {first} says {int(head)} lights, and {len(lines)} follow; complete the list or correct the "
            "number."
        )
    if not lines:
        raise InputError(f"{file}: expected at least one light; got none.")
    return [_light(file, line, text) for line, text in lines]


def _light(file: Path, line: int, text: str) -> Light:
    """One light; blanks may be part of the name, which ends before the last three numbers."""
    words = text.rsplit(maxsplit=_COORDINATES)
    values = [number(word) for word in words[1:]]
    if len(words) != 1 + _COORDINATES or None in values:
        raise InputError(f"{file}: line {line} should hold 'name x y z'; got '{text[:60]}'. Correct the line.")
    x, y, z = (value for value in values if value is not None)
    if x == y == z == 0:
        raise InputError(f"{file}: line {line} ({words[0]}) has the light 0 0 0, which is no direction; correct it.")
    return Light(line, words[0].strip("\"'"), (x, y, z), any("," in word for word in words[1:]))


def _notes(lights: Sequence[Light], images: Sequence[str]) -> list[str]:
    notes = []
    if commas := sum(light.commas for light in lights):
        notes.append(f"{commas} of {len(lights)} lights are written with decimal commas, which are read as points.")
    lengths = [math.hypot(*light.direction) for light in lights]
    if odd := sum(abs(length - 1) > _UNIT_TOLERANCE for length in lengths):
        notes.append(
            f"{odd} of {len(lights)} lights are no unit vectors (lengths {min(lengths):.3g} to {max(lengths):.3g}): "
            "their directions count, not their lengths."
        )
    if other := [(light.name, image) for light, image in zip(lights, images, strict=True) if light.name != image]:
        name, image = other[0]
        notes.append(
            f"{len(other)} of {len(lights)} photographs are read though the list names them otherwise: {image} for "
            f"{name}. Folders of another computer and the case of letters do not count."
        )
    if sorted(images) != list(images):
        notes.append("The list is not in the order of the photographs' names: lights go by name.")
    return notes


LAYOUT = Layout("RTI light list", "an .lp file", _find, _read)
