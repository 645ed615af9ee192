"""CSV tables of reflectance: `theta_i,phi_i,theta_r,phi_r,value…`, one row a pair of directions."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch

from matest.directions import from_angles
from matest.errors import InputError, errors_of
from matest.tables import readings
from matest.tables.declaration import Declaration
from matest.tables.table import Table

ANGLES = ("theta_i", "phi_i", "theta_r", "phi_r")
# A line `# units: deg` declares what an option of the same name would.
_DECLARED = re.compile(r"#\s*(units|azimuth|quantity)\s*[:=]\s*([\w-]+)\s*$")
# A column of a wavelength in nm.
_WAVELENGTH = re.compile(r"(\d+(?:\.\d+)?)\s*nm$")


def read(path: Path, declaration: Declaration) -> Table:
    """The table in a CSV file.

    The first line names the columns. Lines `# units: rad`, `# azimuth: retro`, `# quantity: f` declare what is meant;
    what nobody declares is found by `readings`, or refused where two readings fit alike. Columns named by wavelength
    (`450 nm`) state those of the channels.

    Raises:
        InputError: see above; text that is no such table.
    """
    names, rows, declared = _parsed(path)
    with errors_of(path):
        # Options come before what the file says.
        declaration = declaration.completed(declared)
        finite = np.isfinite(rows).all(1)
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
        if azimuth == "forward":
            radians[:, 1] += np.pi
        quantity = declaration.quantity or readings.quantity(radians, values)
    values = readings.as_reflectance(radians, values, quantity)
    lengths = [_WAVELENGTH.match(name) for name in names]
    wavelengths = None
    if all(lengths):
        wavelengths = torch.tensor([float(match[1]) / 1000 for match in lengths if match], dtype=torch.float64)
    theta_i, phi_i, theta_r, phi_r = torch.from_numpy(np.ascontiguousarray(radians.T))
    notes = [f"Read with angles in {units}, azimuth {azimuth}, quantity {quantity}."]
    return Table(
        path, from_angles(theta_i, phi_i), from_angles(theta_r, phi_r), torch.from_numpy(values), _channels(names),
        wavelengths, notes=notes,
        skipped={"not a number": int((~finite).sum()), "below the horizon": int((~above).sum())},
    )  # fmt: skip


def _parsed(path: Path) -> tuple[list[str], np.ndarray, Mapping[str, str]]:
    """Names of the value columns, all rows, and what comments declare.

    Raises:
        InputError: other columns, or text where a number should be.
    """
    try:
        lines = path.read_text("utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise InputError(f"{path}: expected a text file with comma-separated values, and it is none.") from None
    matches = [match for line in lines if (match := _DECLARED.match(line.strip()))]
    declared = {match[1]: match[2] for match in matches}
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
    if not np.isfinite(rows).all(1).any():
        raise InputError(f"{path}: expected rows of numbers below the names of the columns, and there are none.")
    return head[4:], rows, declared


def _channels(names: Sequence[str]) -> list[str]:
    """Names of the channels, each once."""
    return [name if names.count(name) == 1 else f"{name} {place}" for place, name in enumerate(names)]
