"""What commands print: JSON, notes, and no progress bar in a pipe."""

from __future__ import annotations

import io
import json
import sys

import pytest
from rich.table import Table

from matest.commands.console import console, hushed, note, print_json, progress, progress_over
from matest.progress import silent


def test_json_goes_to_standard_output_and_notes_to_standard_error(capsys: pytest.CaptureFixture[str]) -> None:
    print_json({"sigma": "σ"})
    note("the albedo is relative.")
    out, err = capsys.readouterr()
    assert (json.loads(out), err) == ({"sigma": "σ"}, "matest: note: the albedo is relative.\n")
    assert "σ" in out


def test_names_that_move_the_cursor_are_printed_as_escapes_in_tables_too(capsys: pytest.CaptureFixture[str]) -> None:
    table = Table("capture\x1b[2J", title="\u202edlab")
    table.add_row("a\x07b [red]")
    console().print(table, "Written to \x1b]0;title\x07", soft_wrap=True)
    console().print("Written to c\x1b[31m", "\u202eb")
    out, _ = capsys.readouterr()
    assert not {*"\x1b\x07\u202e"} & {*out}
    assert "\\x1b[2J" in out
    assert "[red]" in out
    assert "Written to c\\x1b[31m \\u202eb\n" in out


def test_json_is_whole_where_the_terminal_lacks_a_letter(monkeypatch: pytest.MonkeyPatch) -> None:
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, encoding="latin-1", errors="replace"))
    print_json({"sigma": "σ"})
    sys.stdout.flush()
    assert json.loads(written.getvalue()) == {"sigma": "σ"}


def test_captures_are_counted_on_a_terminal_with_their_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = io.StringIO()
    shown.isatty = lambda: True  # type: ignore[method-assign]
    monkeypatch.setattr(sys, "stderr", shown)
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("TERM", "xterm")
    with progress_over(1000) as advance:
        for _ in range(3):
            advance()
    assert "3 of 1,000 captures" in shown.getvalue()
    assert "a second" in shown.getvalue()


def test_a_pipe_gets_no_progress_bar(capsys: pytest.CaptureFixture[str]) -> None:
    with progress("vase") as say:
        assert say is silent
        say("reading", 1, 2)
    assert capsys.readouterr() == ("", "")


def test_only_json_is_printed_where_the_rest_is_hushed(capsys: pytest.CaptureFixture[str]) -> None:
    with hushed(True):
        note("the albedo is relative.")
        console().print("a table")
        print_json({})
    assert capsys.readouterr() == ("{}\n", "")
    note("again")
    assert capsys.readouterr().err == "matest: note: again\n"
