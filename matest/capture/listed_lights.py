"""Directions of lights from any file that states them, whether or not their photographs are there."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from matest.capture import schema
from matest.capture.description import capture_file
from matest.capture.formats.diligent import DIRECTIONS
from matest.capture.formats.light_list import lights_in
from matest.capture.formats.text import rows_of
from matest.errors import InputError
from matest.lights.comparison import ListedLights


def load_listed_lights(path: str | Path) -> ListedLights:
    """The lights of a `.lp`, a `light_directions.txt` (three numbers a line), or a capture.toml or its folder.

    Raises:
        InputError: another kind of file, or something in it that is no direction.
    """
    path = Path(path)
    if path.is_dir() and not (path / "capture.toml").is_file() and (path / DIRECTIONS).is_file():
        path = path / DIRECTIONS
    if not path.exists():
        raise InputError(f"{path}: no such list of lights; give a .lp, a light_directions.txt or a capture.toml.")
    names: tuple[str, ...] | None = None
    if path.suffix.lower() == ".lp":
        listed = lights_in(path)
        names, directions = tuple(light.name for light in listed), [light.direction for light in listed]
    elif path.suffix.lower() == ".txt":
        directions = [(x, y, z) for x, y, z in rows_of(path, (3,), "the direction x y z to a light")]
    else:
        path = capture_file(path, "capture.toml")
        names, directions = _of_tables(path)
    vectors = np.array(directions, dtype=float)
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    if not (lengths > 0).all() or not np.isfinite(lengths).all():
        wrong = int(np.flatnonzero(~(lengths[:, 0] > 0) | ~np.isfinite(lengths[:, 0]))[0])
        raise InputError(f"{path}: light {wrong} (from 0) is no direction; correct it.")
    return ListedLights(path, names, vectors / lengths)


def _of_tables(path: Path) -> tuple[tuple[str, ...] | None, list[schema.Vector]]:
    """Names of the images of a capture.toml, and the direction of the one light of each.

    Raises:
        InputError: an image without one, or with several.
    """
    tables = schema.read(path, schema.CaptureFile)
    directions = []
    for number, image in enumerate(tables.image):
        stated = [light.direction for light in image.lights]
        if len(stated) != 1 or stated[0] is None:
            raise InputError(f"{path}: image {number} should have one light, with a direction, to compare with.")
        directions.append(stated[0])
    names = [image.file for image in tables.image]
    return (None if None in names else tuple(name for name in names if name is not None)), directions
