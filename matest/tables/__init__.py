"""Measured reflectances: files of directions and values, one module a format, and the samples that they give."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from matest.errors import Fault, InputError, refuse
from matest.tables import cornell, csv, merl
from matest.tables.declaration import EVERY_WAVELENGTH, RGB, Declaration
from matest.tables.table import Table

# Reader of each format, by the suffix of its files.
FORMATS = {
    ".binary": merl.read,
    ".brdf": cornell.read,
    ".csv": csv.read,
}

__all__ = ["FORMATS", "Declaration", "Table", "load_table"]


def load_table(path: str | Path, declaration: Declaration | None = None) -> Table:
    """The measured reflectance in a file: MERL `.binary`, Cornell `.brdf`, or CSV.

    Args:
        path: the file.
        declaration: what the file leaves open, and which channels to take.

    Raises:
        InputError: no such file, a format that is not read, content that cannot be used, channels that it lacks.
    """
    path = Path(path)
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"{path}: expected a measured table ({', '.join(FORMATS)}); got '{path.suffix or path.name}'.")
    if not path.is_file():
        raise InputError(f"{path}: expected a file with a measured table, and there is none; check the path.")
    declaration = declaration or Declaration()
    table = FORMATS[path.suffix.lower()](path, declaration)
    refuse(path, _channel_faults(table, declaration))
    return table


def _channel_faults(table: Table, declaration: Declaration) -> Iterator[Fault]:
    """Why a table has not the channels that are asked for: only wavelengths give others than it has."""
    wanted = declaration.channels
    given = wanted == EVERY_WAVELENGTH or (wanted == RGB and [*map(str.lower, table.channels)] == [*RGB])
    yield (
        table.wavelengths is None and not given,
        f"--channels {wanted} needs a table of wavelengths, and its channels are {', '.join(table.channels)} without "
        "any; omit it, or name the columns of a CSV table by wavelength, as 450 nm.",
    )
