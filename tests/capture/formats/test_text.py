from __future__ import annotations

from pathlib import Path

import pytest

from matest.capture.formats.text import lines_of, number, rows_of
from tests.captures import refusal


@pytest.mark.parametrize(
    ("text", "value"),
    [("1", 1), ("-0.5", -0.5), ("+.5", 0.5), ("0,57735", 0.57735), ("1e-3", 1e-3), ("2.", 2), ("1E2", 100)],
)
def test_numbers_have_a_point_or_a_comma(text: str, value: float) -> None:
    assert number(text) == value


@pytest.mark.parametrize("text", ["", "x", "1.2.3", "1,2,3", "nan", "inf", "1e999", "0x10", "1_0"])
def test_other_words_are_no_numbers(text: str) -> None:
    assert number(text) is None


def test_lines_have_numbers_and_no_line_ends(tmp_path: Path) -> None:
    file = tmp_path / "lines.txt"
    file.write_bytes("\ufeffa\r\n\r\n  b c \n".encode())
    assert lines_of(file) == [(1, "a"), (3, "b c")]


def test_text_of_old_windows_is_read(tmp_path: Path) -> None:
    file = tmp_path / "lines.txt"
    file.write_bytes("Münze.jpg".encode("cp1252"))
    assert lines_of(file) == [(1, "Münze.jpg")]


@pytest.mark.parametrize("content", [b"", b"\n \n", b"a\0b"])
def test_files_without_lines_are_refused(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "lines.txt"
    file.write_bytes(content)
    assert str(file) in refusal(lambda: lines_of(file))


def test_rows_have_one_length(tmp_path: Path) -> None:
    file = tmp_path / "rows.txt"
    file.write_text("1 2 3\n4 5,5 6\n", "ascii")
    assert rows_of(file, (1, 3), "a strength") == [[1, 2, 3], [4, 5.5, 6]]
    file.write_text("1 2 3\n4\n", "ascii")
    assert "line 2 should hold a strength (3 numbers); got '4'" in refusal(lambda: rows_of(file, (1, 3), "a strength"))
