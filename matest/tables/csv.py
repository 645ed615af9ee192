"""CSV tables of reflectance: `theta_i,phi_i,theta_r,phi_r,value…`, one row a pair of directions.

Tables with a column `code` are single measurements, which `measurements` reads.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch

from matest.directions import from_angles
from matest.errors import InputError, errors_of, nearest
from matest.tables import measurements, readings
from matest.tables.columns import SLIP, Text, in_channels
from matest.tables.declaration import READINGS, Declaration
from matest.tables.table import LARGEST, Table

ANGLES = ("theta_i", "phi_i", "theta_r", "phi_r")


def read(path: Path, declaration: Declaration) -> Table:
    """The table in a CSV file.

    The first line names the columns. Lines `# units: rad`, `# azimuth: retro`, `# quantity: f` declare what is meant;
    what nobody declares is found by `readings`, or refused where two readings fit alike; what is declared holds, and a
    note says where the values clearly contradict it. Columns named by wavelength
    (`450 nm`) state those of the channels.

    Raises:
        InputError: see above; text that is no such table.
    """
    text = Text.read(path)
    if measurements.CODE in measurements.headings(text):
        return measurements.read(text, declaration)
    declared, rows = _declarations(text), _rows(text)
    with errors_of(path):
        # Options come before what the file says.
        declaration = declaration.completed(declared)
        finite = (np.abs(rows) < LARGEST).all(1)  # False for NaN
        angles, values = rows[finite, : len(ANGLES)], rows[finite, len(ANGLES) :]
        units, radians = readings.in_radians(angles, declaration.units)
        theta_i, theta_r = radians[:, 0], radians[:, 2]
        above = (theta_i < np.pi / 2) & (theta_r < np.pi / 2) & (theta_i >= 0)
        if not above.any():
            raise InputError("expected directions above the horizon, and no row has two; check the units.")
        radians, values = radians[above], values[above]
        # A negative polar angle of the viewer lies on the other side of the normal.
        over = radians[:, 2] < 0
        radians[over, 2:] = np.stack([-radians[over, 2], radians[over, 3] + np.pi], axis=1)
        if (odd := readings.other_unit(angles, declaration.units)) and not (
            declaration.azimuth and declaration.quantity
        ):
            raise InputError(
                f"{odd}, and such angles do not tell the rest; correct the unit, or declare azimuth and quantity too."
            )
        azimuth = declaration.azimuth or readings.azimuth(radians, values)
        doubts = [*readings.doubts(angles, radians, values, declaration)]
        if azimuth == "forward":
            radians[:, 1] += np.pi
        quantity = declaration.quantity or readings.quantity(radians, values)
        spectra = torch.from_numpy(readings.as_reflectance(radians, values, quantity))
        reflectance, channels, wavelengths, of_channels = in_channels(spectra, text.names[4:], declaration)
    theta_i, phi_i, theta_r, phi_r = torch.from_numpy(np.ascontiguousarray(radians.T))
    notes = [f"Read with angles in {units}, azimuth {azimuth}, quantity {quantity}.", *doubts, *of_channels]
    return Table(
        path, from_angles(theta_i, phi_i), from_angles(theta_r, phi_r), reflectance, channels, wavelengths, notes=notes,
        skipped={"not a number": int((~finite).sum()), "below the horizon": int((~above).sum())},
    )  # fmt: skip


def _declarations(text: Text) -> Mapping[str, str]:
    """What comments declare, by key.

    Raises:
        InputError: a slip in a key, or a word that is none of its words.
    """
    declared = {}
    for number, name, value in text.comments:
        key, word = name.lower(), value.lower()
        with errors_of(f"{text.path}: line {number}"):
            if key in READINGS:
                Declaration(**{key: word})  # type: ignore[arg-type]
                declared[key] = word
            elif difflib.get_close_matches(key, READINGS, n=1, cutoff=SLIP):
                raise InputError(f"'{name}' declares nothing; {nearest(key, READINGS)} Correct it.")
    return declared


def _rows(text: Text) -> np.ndarray:
    """All rows [n, 4 angles and values].

    Raises:
        InputError: other columns, or text where a number should be.
    """
    if tuple(text.names[:4]) != ANGLES or len(text.names) < 5:
        raise InputError(
            f"{text.path}: expected the columns {','.join(ANGLES)} and one or more values in the first line, or those "
            f"of single measurements (code, light_x, ...), and it reads '{','.join(text.names)[:60]}'; name the "
            "columns so."
        )
    rows = text.numbers(text.cells())
    if not (np.abs(rows) < LARGEST).all(1).any():
        raise InputError(f"{text.path}: expected rows of numbers below the names of the columns, and there are none.")
    return rows
