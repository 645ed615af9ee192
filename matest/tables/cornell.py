"""The `.brdf` of Cornell's Program of Computer Graphics: a gonioreflectometer's spectra at scattered directions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from matest.directions import from_angles
from matest.errors import InputError, errors_of
from matest.spectra import to_rgb
from matest.tables.declaration import RGB_NOTE, Declaration
from matest.tables.table import LARGEST, Table

# θi, φi, θr, φr in radians, before the values of a row.
_ANGLES = 4


def read(path: Path, declaration: Declaration) -> Table:
    """The table in a `.brdf` file: the number of wavelengths, the wavelengths in nm, then rows of angles and values.

    Azimuths of light and viewer are equal on the light's side. Values that are not positive are measurements.

    Raises:
        InputError: text that is no such table; a wavelength that it lacks; a declaration of how to read it.
    """
    with errors_of(path):
        declaration.refuse_reading()
    try:
        words = [word for line in path.read_text("utf-8").splitlines() for word in line.partition("#")[0].split()]
        numbers = np.array(words, dtype=float)
    except (ValueError, UnicodeDecodeError):
        raise InputError(f"{path}: expected numbers and # comments, and it has other text; is it a Cornell table?")
    count = int(numbers[0]) if len(numbers) and abs(numbers[0]) < LARGEST else 0
    width = _ANGLES + count
    if count < 1 or numbers[0] != count or len(numbers) < 1 + count + width or (len(numbers) - 1 - count) % width:
        raise InputError(
            f"{path}: expected the number of wavelengths, the wavelengths and rows of four angles with a value for "
            f"each, and the {len(numbers):,} numbers do not divide into such rows; is the file complete?"
        )
    nanometres, rows = numbers[1 : 1 + count], numbers[1 + count :].reshape(-1, width)
    finite = (np.abs(rows) < LARGEST).all(1)  # False for NaN
    theta_i, phi_i, theta_o, phi_o = torch.from_numpy(rows[:, :_ANGLES].T)
    wi, wo = from_angles(theta_i, phi_i), from_angles(theta_o, phi_o)
    kept = torch.from_numpy(finite) & (wi[:, 2] > 0) & (wo[:, 2] > 0)
    if not bool(kept.any()):
        raise InputError(f"{path}: expected polar angles in radians below π/2, and no row has them; convert them.")
    spectra = torch.from_numpy(rows[:, _ANGLES:])[kept]
    wavelengths = torch.from_numpy(nanometres / 1000)
    with errors_of(path):
        places = declaration.wavelengths(nanometres.tolist())
    notes = [_dark(spectra)] if bool((spectra <= 0).any()) else []
    if places is None:
        values, channels, of_channels = to_rgb(spectra, wavelengths), ["R", "G", "B"], None
        notes.append(RGB_NOTE)
    else:
        values, of_channels = spectra[:, places], wavelengths[places]
        channels = [f"{nanometres[place]:g} nm" for place in places]
    skipped = {"not a number": int((~finite).sum()), "below the horizon": int((finite & ~kept.numpy()).sum())}
    return Table(path, wi[kept], wo[kept], values, channels, of_channels, notes=notes, skipped=skipped)


def _dark(spectra: torch.Tensor) -> str:
    count = int((spectra <= 0).sum())
    return f"{count:,} of {spectra.numel():,} values are not positive; they count as measurements of what is dark."
