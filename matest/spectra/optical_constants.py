"""Optical constants n − ik of metals, from the tables that come with Mitsuba 3 or from a file. Wavelengths in µm."""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib.machinery import PathFinder
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from matest.errors import InputError, nearest
from matest.spectra.colour import VISIBLE, to_rgb

# The metals among Mitsuba's tables, by their English names.
_SYMBOLS = {
    "aluminium": "Al",
    "aluminum": "Al",
    "beryllium": "Be",
    "chromium": "Cr",
    "copper": "Cu",
    "gold": "Au",
    "iridium": "Ir",
    "lithium": "Li",
    "mercury": "Hg",
    "molybdenum": "Mo",
    "nickel": "Ni",
    "niobium": "Nb",
    "potassium": "K",
    "rhodium": "Rh",
    "silver": "Ag",
    "sodium": "Na",
    "tantalum": "Ta",
    "tungsten": "W",
    "vanadium": "V",
}
_ETA = ".eta.spd"
# Largest first wavelength of a table in µm; that of one in nm is larger.
_LARGEST_START = 20.0
# Largest number of a table: those of nature are below a million.
_LARGEST = 1e15


@dataclass(frozen=True, eq=False)
class OpticalConstants:
    """Complex refractive index η − ik over wavelength, linear in between.

    Args:
        wavelengths: [Λ] in µm, increasing.
        eta: refractive index [Λ].
        k: extinction coefficient [Λ].
        source: names of the files, with the comments in them.
    """

    wavelengths: Tensor
    eta: Tensor
    k: Tensor
    source: str

    def at(self, wavelengths: Tensor) -> tuple[Tensor, Tensor]:
        """η and k at wavelengths in µm, in their shape and type.

        Raises:
            InputError: wavelengths outside the table.
        """
        table, at = self.wavelengths, wavelengths.to(self.wavelengths).contiguous()
        if not ((at >= table[0]) & (at <= table[-1])).all():
            raise InputError(
                f"optical constants are tabulated from {table[0]:g} to {table[-1]:g} µm, but wavelengths from "
                f"{at.min():g} to {at.max():g} came; leave out those beyond the table {self.source}."
            )
        above = torch.searchsorted(table, at, right=True).clamp(max=len(table) - 1)
        below = above - 1
        fraction = (at - table[below]) / (table[above] - table[below])
        eta, k = (torch.lerp(values[below], values[above], fraction).to(wavelengths) for values in (self.eta, self.k))
        return eta, k


def optical_constants(name_or_path: str | Path, k_path: str | Path | None = None) -> OpticalConstants:
    """Optical constants of a metal by name, or from files.

    A name is English (`copper`) or that of a table of Mitsuba 3 (`Cu`, `Cu_palik`, `TiN`), in any case; of two tables
    of a metal the one without `_palik` is taken. Whatever has a suffix or a folder is a file: columns wavelength, n,
    k; or a block of wavelength, n and below it one of wavelength, k (as refractiveindex.info exports); or one block in
    this file and one in `k_path` (as Mitsuba's `.spd`). Columns are separated by commas or white space, blocks by a
    line of words, `#` starts a comment. Wavelengths are in nm if all are above 20, otherwise in µm.

    Raises:
        InputError: Mitsuba is not installed, an unknown name, a file missing or malformed.

    Source: Mitsuba's tables are from luxpop.com, most of them after Palik 1985, 1991.
    """
    path = Path(name_or_path)
    if k_path is None and not path.suffix and len(path.parts) == 1:
        path = _mitsuba_table(path.name)
        k_path = path.with_name(path.name.removesuffix(_ETA) + ".k.spd")
    paths = [path] if k_path is None else [path, Path(k_path)]
    tables = [_read(file) for file in paths]
    comments = dict.fromkeys(comment for _, of_file in tables for comment in of_file)
    files = " and ".join(map(str, paths))

    blocks = [block for of_file, _ in tables for block in of_file]
    columns = [block.shape[1] for block in blocks]
    if columns not in ([3], [2, 2]):
        raise InputError(
            f"{files}: expected columns wavelength, n, k, or a block of wavelength, n and one of wavelength, k; "
            f"but {' and '.join(map(str, columns)) or 'no'} columns of numbers came."
        )
    eta_at, eta = _by_wavelength(blocks[0], 1, files)
    k_at, k = _by_wavelength(blocks[-1], -1, files)
    at = np.union1d(eta_at, k_at)
    at = at[(at >= max(eta_at[0], k_at[0])) & (at <= min(eta_at[-1], k_at[-1]))]
    if len(at) < 2:
        raise InputError(f"{files}: n and k have fewer than two wavelengths in common; give tables that overlap.")
    if eta.min() == 0:
        raise InputError(f"{files}: n must be positive, but is 0 at {eta_at[eta.argmin()]:g} µm; leave out such lines.")
    return OpticalConstants(
        torch.from_numpy(at),
        torch.from_numpy(np.interp(at, eta_at, eta)),
        torch.from_numpy(np.interp(at, k_at, k)),
        " and ".join(path.name for path in paths) + (f" ({' '.join(comments)})" if comments else ""),
    )


def normal_reflectance(eta: Tensor, k: Tensor) -> Tensor:
    """Reflectance of a conductor in air at normal incidence.

    F0 = ((n−1)² + k²)/((n+1)² + k²)
    """
    return ((eta - 1).square() + k.square()) / ((eta + 1).square() + k.square())


def metal_colour(name: str) -> Tensor:
    """Normal reflectance of a metal under D65 as linear RGB [3], float64; gold's red is a little above 1.

    Raises:
        InputError: see `optical_constants`; a table that does not cover 0.36 to 0.78 µm, as that of lithium.
    """
    return to_rgb(normal_reflectance(*optical_constants(name).at(VISIBLE)))


def _mitsuba_table(name: str) -> Path:
    """Path of Mitsuba's table of η for a metal; the package is not imported, because that loads a renderer."""
    # importlib.util finds no folder once a program has imported Mitsuba.
    package = PathFinder.find_spec("mitsuba")
    if package is None or not package.submodule_search_locations:
        raise InputError(
            f"the optical constants of '{name}' come with Mitsuba, which is not installed: "
            'pip install "matest-brdf[metals]", or give a file of wavelength, n, k.'
        )
    tables: dict[str, Path] = {}
    folder = Path(package.submodule_search_locations[0]) / "data" / "ior"
    for path in sorted(folder.glob("*" + _ETA), reverse=True):  # X_palik comes before X, which then takes its place
        stem = path.name.removesuffix(_ETA).lower()
        tables[stem] = tables[stem.removesuffix("_palik")] = path
    tables |= {english: tables[symbol.lower()] for english, symbol in _SYMBOLS.items() if symbol.lower() in tables}
    if name.lower() not in tables:
        raise InputError(f"no optical constants of '{name}' in {folder}; {nearest(name.lower(), _SYMBOLS)}")
    return tables[name.lower()]


def _read(path: Path) -> tuple[list[np.ndarray], list[str]]:
    """The blocks of numbers [rows, columns] in a text file, and the words of its comments."""
    try:
        lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; expected a table of wavelength, n, k.") from None
    blocks: list[list[list[float]]] = [[]]
    comments = []
    for number, line in enumerate(lines, start=1):
        data, _, comment = line.partition("#")
        if words := " ".join(comment.strip(" ;-").split()):
            comments.append(words)
        cells = [cell for cell in re.split(r"[,;\s]+", data) if cell]
        values = [_number(cell) for cell in cells]
        if all(value is None for value in values):
            blocks += [[]] if cells else []
            continue
        row = [value for value in values if value is not None and 0 <= value < _LARGEST]
        if len(row) < len(cells) or not 2 <= len(row) <= 3 or len(row) != len((blocks[-1] or [row])[0]):
            raise InputError(
                f"{path}: line {number} must hold two or three numbers, none negative, as many as the lines above; "
                f"but is '{line.strip()}'."
            )
        blocks[-1].append(row)
    return [np.array(block) for block in blocks if block], comments


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


def _by_wavelength(block: np.ndarray, column: int, files: str) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths in µm in increasing order, and what a column holds there."""
    at, values = block[block[:, 0].argsort()][:, [0, column]].T
    if at[0] > _LARGEST_START:
        at = at / 1000
    twice = at[1:][at[1:] == at[:-1]]
    if len(twice):
        raise InputError(f"{files}: every wavelength must come once, but {twice[0]:g} µm comes twice.")
    return at, values
