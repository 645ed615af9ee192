"""Loading a table: by suffix, or refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from matest.brdf import Lambert
from matest.errors import InputError
from matest.tables import FORMATS, Declaration, load_table
from tests.tables.goniometer import in_plane, measured, write_csv


def test_a_format_is_known_by_its_suffix(tmp_path: Path) -> None:
    path = write_csv(measured(Lambert(0.5), in_plane(20)), tmp_path / "table.CSV")
    table = load_table(path, Declaration(azimuth="retro", quantity="f"))
    assert len(table) == len(measured(Lambert(0.5), in_plane(20)))
    assert repr(table).startswith("Table(table.CSV: ")
    with pytest.raises(InputError, match=r"expected a measured table \(\.binary, \.brdf, \.csv\); got '.png'"):
        load_table(tmp_path / "a.png")


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_missing_file_is_named(tmp_path: Path, suffix: str) -> None:
    with pytest.raises(InputError, match=r"missing.*there is none; check the path"):
        load_table(tmp_path / f"missing{suffix}")


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("content", [b"", b"\x00\xff\x81 no table", b"1 2 3\n"])
def test_what_is_no_table_is_refused_with_the_file(tmp_path: Path, suffix: str, content: bytes) -> None:
    path = tmp_path / f"spoilt{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"spoilt.*expected"):
        load_table(path)
