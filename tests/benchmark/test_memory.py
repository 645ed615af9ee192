"""Peak memory is that of a process of its own, with and without ten times the photographs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

import matest
from matest.benchmark import Effort, load
from matest.benchmark.instruments.photographs import in_files
from matest.benchmark.suites import memory

pytestmark = pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="reads Linux's /proc")


def test_growth_is_the_difference_of_the_peaks(monkeypatch: pytest.MonkeyPatch) -> None:
    counts = []

    def peak(folder: Path, _: str) -> float:
        counts.append(len(matest.load_capture(folder)))
        return 100.0 if len(counts) % 2 else 350.0

    monkeypatch.setattr(memory, "SIZE_QUICK", 32)
    monkeypatch.setattr(memory, "FEW", 2)
    monkeypatch.setattr(memory, "peak", peak)
    found = list(load("memory").run(Effort(quick=True)))
    assert counts == [2, 20]
    assert [record.value for record in found] == [100, 350, 3.5, 250]
    assert [record.metric for record in found if record.misses] == ["growth"]
    terminal = Console(width=80, record=True)
    terminal.print(load("memory").table(found))
    assert "growth = 250, limit 200" in terminal.export_text()


def test_the_peak_does_not_count_what_the_starting_process_holds() -> None:
    held = np.ones(200_000_000)  # 1600 MB
    with in_files("oren-nayar", images=2, size=32) as folder:
        assert 100 < memory.peak(folder, "oren-nayar") < held.nbytes / 2e6
