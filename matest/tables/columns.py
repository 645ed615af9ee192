"""The text of a CSV table: comments that declare something, named columns, and rows of cells."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from matest.errors import InputError
from matest.spectra import to_rgb
from matest.tables.declaration import RGB_NOTE, Declaration

# A line `# key: value` or `# key = value`.
_DECLARED = re.compile(r"#\s*(\w+)\s*[:=]\s*(.*)$")
# Similarity (2 · matching letters / letters of both) from which on a word is a slip for a key: of "unit" 0.89, of
# "azimut" 0.92; "quality", which is none, has 0.8.
SLIP = 0.85
# What some programs write between columns.
_OTHER_MARKS = {";": "semicolons", "\t": "tabs"}
# A channel of a wavelength in nm.
_WAVELENGTH = re.compile(r"(\d+(?:\.\d+)?)\s*nm$")


@dataclass(frozen=True)
class Text:
    """A CSV file.

    Attributes:
        path: of the file.
        names: of the columns, in its first line; none of an empty file.
        rows: the line's number, and the line, of every row below.
        comments: number, key and value of every line that is like a declaration.
    """

    path: Path
    names: Sequence[str]
    rows: Sequence[tuple[int, str]]
    comments: Sequence[tuple[int, str, str]]

    @classmethod
    def read(cls, path: Path) -> Text:
        """The text of a file.

        Raises:
            InputError: it is no text, or has something else than commas between its columns.
        """
        try:
            lines = path.read_text("utf-8-sig").splitlines()
        except UnicodeDecodeError:
            raise InputError(f"{path}: expected a text file with comma-separated values, and it is none.") from None
        matches = [(number, _DECLARED.match(line.strip())) for number, line in enumerate(lines, 1)]
        comments = [(number, match[1], match[2].strip()) for number, match in matches if match]
        content = [(number, line) for number, line in enumerate(lines, 1) if line.strip() and line[0] != "#"]
        head = content[0][1] if content else ""
        if "," not in head and (mark := next((mark for mark in _OTHER_MARKS if mark in head), None)):
            raise InputError(
                f"{path}: line {content[0][0]} has {_OTHER_MARKS[mark]} between the columns; save it with commas "
                "between them, and points in the numbers."
            )
        names = [name.strip() for name in head.split(",")] if content else []
        return cls(path, names, content[1:], comments)

    def cells(self) -> np.ndarray:
        """Every cell as text, without blanks around it [n, columns].

        Raises:
            InputError: a row with another number of cells.
        """
        cells = [[cell.strip() for cell in line.split(",")] for _, line in self.rows]
        for (number, line), row in zip(self.rows, cells, strict=True):
            if len(row) != len(self.names):
                raise self.fault(number, line, len(self.names))
        return np.array(cells, dtype=object).reshape(len(cells), len(self.names))

    def numbers(self, cells: np.ndarray) -> np.ndarray:
        """Cells of some columns [n, k] as numbers; NaN where one is empty.

        Raises:
            InputError: text where a number should be.
        """
        numbers = np.empty(cells.shape)
        for row, (number, line) in enumerate(self.rows):
            try:
                numbers[row] = [float(cell) if cell else np.nan for cell in cells[row]]
            except ValueError:
                raise self.fault(number, line, cells.shape[1]) from None
        return numbers

    def fault(self, number: int, line: str, count: int) -> InputError:
        """The refusal of a line that should have so many numbers."""
        return InputError(
            f"{self.path}: expected {count} numbers in line {number}, and it reads '{line[:60]}'; correct it."
        )


def in_channels(
    values: Tensor, names: Sequence[str], declaration: Declaration
) -> tuple[Tensor, list[str], Tensor | None, list[str]]:
    """Values of the wanted channels [n, C], names and wavelengths (µm) of these, and a note on how they came about.

    Args:
        values: of all channels.
        names: of these; `450 nm` states a wavelength.
        declaration: which channels to take.

    Raises:
        InputError: a wavelength that the table lacks.
    """
    matches = [_WAVELENGTH.match(name) for name in names]
    nanometres = [float(match[1]) for match in matches if match]
    if len(nanometres) < len(names):
        return values, _each_once(names), None, []
    wavelengths = torch.tensor(nanometres, dtype=torch.float64) / 1000
    places = declaration.wavelengths(nanometres)
    if places is None:
        order = wavelengths.argsort()
        return to_rgb(values[:, order], wavelengths[order]), ["R", "G", "B"], None, [RGB_NOTE]
    return values[:, places], _each_once([names[place] for place in places]), wavelengths[places], []


def _each_once(names: Sequence[str]) -> list[str]:
    """Names of channels; those that are repeated get a number."""
    return [name if names.count(name) == 1 else f"{name} {place}" for place, name in enumerate(names)]
