"""CSV tables of reflectance: `theta_i,phi_i,theta_r,phi_r,value…`, one row a pair of directions."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch

from matest.directions import from_angles
from matest.errors import InputError, errors_of, nearest
from matest.spectra import to_rgb
from matest.tables import readings
from matest.tables.declaration import READINGS, RGB_NOTE, Declaration
from matest.tables.table import LARGEST, Table

ANGLES = ("theta_i", "phi_i", "theta_r", "phi_r")
# A line `# units: deg` declares what an option of the same name would; any other comment is free.
_DECLARED = re.compile(r"#\s*(\w+)\s*[:=]\s*(.*)$")
# Similarity (2 · matching letters / letters of both) from which on a word is a slip for a key: of "unit" 0.89, of
# "azimut" 0.92; "quality", which is none, has 0.8.
_SLIP = 0.85
# A column of a wavelength in nm.
_WAVELENGTH = re.compile(r"(\d+(?:\.\d+)?)\s*nm$")


def read(path: Path, declaration: Declaration) -> Table:
    """The table in a CSV file.

    The first line names the columns. Lines `# units: rad`, `# azimuth: retro`, `# quantity: f` declare what is meant;
    what nobody declares is found by `readings`, or refused where two readings fit alike; what is declared holds, and a
    note says where the values clearly contradict it. Columns named by wavelength
    (`450 nm`) state those of the channels.

    Raises:
        InputError: see above; text that is no such table.
    """
    names, rows, declared = _parsed(path)
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
        azimuth = declaration.azimuth or readings.azimuth(radians, values)
        doubts = [*readings.doubts(angles, radians, values, declaration)]
        if azimuth == "forward":
            radians[:, 1] += np.pi
        quantity = declaration.quantity or readings.quantity(radians, values)
        spectra = torch.from_numpy(readings.as_reflectance(radians, values, quantity))
        reflectance, channels, wavelengths, of_channels = _in_channels(spectra, names, declaration)
    theta_i, phi_i, theta_r, phi_r = torch.from_numpy(np.ascontiguousarray(radians.T))
    notes = [f"Read with angles in {units}, azimuth {azimuth}, quantity {quantity}.", *doubts, *of_channels]
    return Table(
        path, from_angles(theta_i, phi_i), from_angles(theta_r, phi_r), reflectance, channels, wavelengths, notes=notes,
        skipped={"not a number": int((~finite).sum()), "below the horizon": int((~above).sum())},
    )  # fmt: skip


def _in_channels(
    values: torch.Tensor, names: Sequence[str], declaration: Declaration
) -> tuple[torch.Tensor, list[str], torch.Tensor | None, list[str]]:
    """Values of the wanted channels [n, C], names and wavelengths (µm) of these, and a note on how they came about.

    Raises:
        InputError: a wavelength that the table lacks.
    """
    matches = [_WAVELENGTH.match(name) for name in names]
    nanometres = [float(match[1]) for match in matches if match]
    if len(nanometres) < len(names):
        return values, _channels(names), None, []
    wavelengths = torch.tensor(nanometres, dtype=torch.float64) / 1000
    places = declaration.wavelengths(nanometres)
    if places is None:
        order = wavelengths.argsort()
        return to_rgb(values[:, order], wavelengths[order]), ["R", "G", "B"], None, [RGB_NOTE]
    return values[:, places], _channels([names[place] for place in places]), wavelengths[places], []


def _declarations(path: Path, lines: Sequence[str]) -> Mapping[str, str]:
    """What comments declare, by key.

    Raises:
        InputError: a slip in a key, or a word that is none of its words.
    """
    declared = {}
    for number, line in enumerate(lines, 1):
        match = _DECLARED.match(line.strip())
        if match is None:
            continue
        key, word = match[1].lower(), match[2].strip().lower()
        with errors_of(f"{path}: line {number}"):
            if key in READINGS:
                Declaration(**{key: word})  # type: ignore[arg-type]
                declared[key] = word
            elif difflib.get_close_matches(key, READINGS, n=1, cutoff=_SLIP):
                raise InputError(f"'{match[1]}' declares nothing; {nearest(key, READINGS)} Correct it.")
    return declared


def _parsed(path: Path) -> tuple[list[str], np.ndarray, Mapping[str, str]]:
    """Names of the value columns, all rows, and what comments declare.

    Raises:
        InputError: other columns, text where a number should be, or a comment that misspells what it declares.
    """
    try:
        lines = path.read_text("utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise InputError(f"{path}: expected a text file with comma-separated values, and it is none.") from None
    declared = _declarations(path, lines)
    content = [(number, line) for number, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
    head = [name.strip() for name in content[0][1].split(",")] if content else []
    if tuple(head[:4]) != ANGLES or len(head) < 5:
        raise InputError(
            f"{path}: expected the columns {','.join(ANGLES)} and one or more values in the first line, and it reads "
            f"'{content[0][1][:60] if content else ''}'; name the columns so."
        )
    rows = np.empty((len(content) - 1, len(head)))
    for row, (number, line) in enumerate(content[1:]):
        try:
            rows[row] = [float(cell) if cell.strip() else np.nan for cell in line.split(",")]
        except ValueError:
            raise InputError(
                f"{path}: expected {len(head)} numbers in line {number}, and it reads '{line[:60]}'; correct it."
            ) from None
    if not (np.abs(rows) < LARGEST).all(1).any():
        raise InputError(f"{path}: expected rows of numbers below the names of the columns, and there are none.")
    return head[4:], rows, declared


def _channels(names: Sequence[str]) -> list[str]:
    """Names of the channels, each once."""
    return [name if names.count(name) == 1 else f"{name} {place}" for place, name in enumerate(names)]
