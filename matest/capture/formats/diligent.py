"""DiLiGenT, the benchmark of photometric stereo, and its successors DiLiGenT-MV and DiLiGenT10².

Each folder is one object from one view: `light_directions.txt` (x y z to the light, a line an image),
`light_intensities.txt` (R G B by which that light is stronger than others), `filenames.txt`, `mask.png`, and normals
(`Normal_gt.mat`). Axes: x right, y up, z toward the viewer. Values are linear, of 16 bits (Shi et al. 2016; Li et al.
2020; Ren et al. 2022).
"""

from __future__ import annotations

from pathlib import Path

from matest.capture.formats import folder
from matest.capture.formats.layout import Content, Layout
from matest.capture.formats.text import lines_of, rows_of
from matest.capture.schema import CaptureFile, EncodingTable, ImageTable, LightTable
from matest.errors import InputError

_NAMES = "filenames.txt"
DIRECTIONS = "light_directions.txt"
_INTENSITIES = "light_intensities.txt"
# Folders of DiLiGenT-MV, one a view.
_VIEWS = "view_*"
# The first bytes of a PNG.
_PNG = b"\x89PNG"
# Its byte that holds the bits of a channel.
_BITS_OF_PNG = 24


def _find(path: Path) -> tuple[Path, ...]:
    if path.is_file():
        return _find(path.parent) if path.name.lower() in (_NAMES, DIRECTIONS, _INTENSITIES) else ()
    files = folder.files_by_name(path)
    if DIRECTIONS in files:
        return tuple(files[name] for name in (DIRECTIONS, _INTENSITIES, _NAMES) if name in files)
    views = [view for view in sorted(path.glob(_VIEWS)) if DIRECTIONS in folder.files_by_name(view)]
    if views:
        raise InputError(
            f"{path}: holds {len(views)} views of an object, each a capture of its own; give one or several of them, "
            f"as {views[0]}."
        )
    if _NAMES in files and _INTENSITIES in files:
        raise InputError(f"{path}: expected {DIRECTIONS} beside {_NAMES} and {_INTENSITIES}; put it there.")
    return ()


def _read(files: tuple[Path, ...]) -> Content:
    directions_file, place = files[0], files[0].parent
    by_name = {file.name.lower(): file for file in files}
    directions = rows_of(directions_file, (3,), "the direction x y z to a light")
    for number, direction in enumerate(directions, start=1):
        if not any(direction):
            raise InputError(f"{directions_file}: light {number} is 0 0 0, which is no direction; correct it.")
    intensities = _intensities(by_name.get(_INTENSITIES), directions_file, len(directions))
    names, notes = _images(by_name.get(_NAMES), directions_file, len(directions))
    tables = [by_name[name] for name in (DIRECTIONS, _INTENSITIES) if name in by_name]
    if commas := [file.name for file in tables if any("," in text for _, text in lines_of(file))]:
        notes = (*notes, f"{' and '.join(commas)}: decimal commas are read as points.")
    geometry = folder.geometry(place, spheres=False)
    mask = folder.mask(place)
    linear = _sixteen_bits(place / names[0])
    assumptions = ["its images hold linear values of 16 bits"] if linear else []
    if intensities is None:
        assumptions.append("without light_intensities.txt all lights are equally strong")
    else:
        assumptions.append("light_intensities.txt gives the lights' strengths up to one factor")
    lights = [
        LightTable(direction=(x, y, z), irradiance=None if intensities is None else intensities[number])
        for number, (x, y, z) in enumerate(directions)
    ]
    return Content(
        tables=folder.with_view(
            CaptureFile(
                geometry=geometry,
                mask=None if mask is None else mask.name,
                encoding=EncodingTable(transfer="linear" if linear else None, radiometry="relative"),
                image=[ImageTable(file=name, lights=[light]) for name, light in zip(names, lights, strict=True)],
            ),
            place,
        ),
        axes="x right, y up, z toward the viewer",
        assumptions=tuple(assumptions),
        notes=notes,
    )


def _intensities(file: Path | None, directions_file: Path, count: int) -> list[float | list[float]] | None:
    """The strength of each light, one number or one per channel; None where no file gives it."""
    if file is None:
        return None
    rows = rows_of(file, (1, 3), "the strength of a light")
    if len(rows) != count:
        raise InputError(f"{file}: expected {count} lines, one a light of {directions_file.name}; got {len(rows)}.")
    for number, row in enumerate(rows, start=1):
        if not min(row) > 0:
            raise InputError(f"{file}: light {number} must be positive; got {' '.join(map(str, row))}. Correct it.")
    return [row if len(row) > 1 else row[0] for row in rows]


def _images(file: Path | None, directions_file: Path, count: int) -> tuple[list[str], tuple[str, ...]]:
    """The photograph of each light, and what is to be said of them."""
    if file is None:
        photographs = folder.images_in_order(directions_file, count)
        return [path.name for path in photographs], ("Without filenames.txt the lights go by the images' order.",)
    lines = lines_of(file)
    if len(lines) != count:
        raise InputError(f"{file}: expected {count} names, one a light of {directions_file.name}; got {len(lines)}.")
    names = [folder.image_named(file, name, line) for line, name in lines]
    if len({*names}) < count:
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"{file}: names {twice} twice; each light has a photograph of its own. Correct the list.")
    return names, tuple(folder.unlisted(file, names))


def _sixteen_bits(path: Path) -> bool:
    """Whether an image is a PNG of 16 bits."""
    with path.open("rb") as file:
        head = file.read(_BITS_OF_PNG + 1)
    return head.startswith(_PNG) and head[-1] == 16


LAYOUT = Layout("DiLiGenT", "light_directions.txt", _find, _read)
