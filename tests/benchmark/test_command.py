"""The suite that measures the whole command."""

from __future__ import annotations

import json
import subprocess
import tomllib
from pathlib import Path

import pytest
from rich.console import Console

from matest.benchmark import load
from matest.benchmark.instruments.photographs import in_files
from matest.benchmark.suite import Effort
from matest.benchmark.suites import command

pytestmark = pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="reads Linux's /proc")


def test_a_capture_is_decoded_and_estimated_in_a_process_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "QUICK_CASES", (command.Case(3, 48, mesh=True, peak_limit=1.0),))
    records = {record.metric: record for record in load("command").run(Effort(quick=True))}
    values = {metric: record.value for metric, record in records.items()}
    # Of so small a capture what is left beside the imports may be less than their spread, even below zero.
    assert all(values[metric] > 0 for metric in ("decode", "imports", "peak", *command.STAGES))
    assert values["command / decode"] == pytest.approx(values["command"] / values["decode"])
    # Torch and the rest take far longer to import than so small a capture to estimate.
    assert values["imports"] > 0.3
    assert values["peak"] > 100
    assert records["peak"].misses
    terminal = Console(width=80, record=True)
    terminal.print(load("command").table(list(records.values())))
    assert "3 × 48², mesh" in terminal.export_text()


def test_the_captures_state_no_noise() -> None:
    with in_files(command.MODEL, images=2, size=32, mesh=True) as folder:
        file = folder / "capture.toml"
        assert "noise" in tomllib.loads(file.read_text("utf-8"))
        command.forget_noise(file)
        tables = tomllib.loads(file.read_text("utf-8"))
    assert "noise" not in tables
    assert len(tables["image"]) == 2


def test_a_command_that_fails_is_no_figure() -> None:
    with pytest.raises(subprocess.CalledProcessError):
        command._last_line(command._COMMAND, ["estimate", "nowhere"])
    assert command._last_line(command._IMPORTS, [], json.dumps(["math"]))["cpu"] < 1
