"""The text of CSV tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from matest.errors import InputError
from matest.tables import Declaration
from matest.tables.columns import Text, in_channels


def test_comments_names_and_rows_are_told_apart(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("\ufeff# a free one\n# units: deg\n\na, b ,c\n1, 2,\n# key = value\n3,x,4\n", "utf-8")
    text = Text.read(path)
    assert text.names == ["a", "b", "c"]
    assert text.comments == [(2, "units", "deg"), (6, "key", "value")]
    assert [number for number, _ in text.rows] == [5, 7]
    cells = text.cells()
    assert cells.tolist() == [["1", "2", ""], ["3", "x", "4"]]
    np.testing.assert_array_equal(text.numbers(cells[:, [0, 2]]), [[1, np.nan], [3, 4]])
    with pytest.raises(InputError, match=r"a\.csv: expected 2 numbers in line 7, and it reads '3,x,4'; correct it\."):
        text.numbers(cells[:, :2])


def test_a_row_of_another_length_and_what_is_no_text_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("a,b\n1,2\n3\n")
    with pytest.raises(InputError, match="expected 2 numbers in line 3, and it reads '3'"):
        Text.read(path).cells()
    path.write_bytes(b"\x81\xff")
    with pytest.raises(InputError, match="expected a text file with comma-separated values"):
        Text.read(path)


def test_channels_that_are_wavelengths_can_be_chosen() -> None:
    values = torch.tensor([[0.1, 0.2]], dtype=torch.float64)
    kept, names, wavelengths, notes = in_channels(values, ["450 nm", "550 nm"], Declaration(channels="550"))
    assert (kept.tolist(), names, notes) == ([[0.2]], ["550 nm"], [])
    assert wavelengths is not None
    assert wavelengths.tolist() == [0.55]
    assert in_channels(values, ["R", "R"], Declaration())[1] == ["R 0", "R 1"]
