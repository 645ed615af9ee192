"""The limits of the machine have their units, and are shown before anything else."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from rich.console import Console

from matest.benchmark import load, plan
from matest.benchmark.instruments import passes
from matest.benchmark.suites import limits


@pytest.fixture
def _small(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(limits, "LARGE", 2**20)
    monkeypatch.setattr(limits, "SIZE", 32)
    monkeypatch.setattr(passes, "SPELL", 0.0)
    limits.machine.cache_clear()
    yield
    limits.machine.cache_clear()


@pytest.mark.usefixtures("_small")
@pytest.mark.parametrize("quick", [True, False])
def test_limits_are_first_and_say_of_what_run(quick: bool) -> None:
    names, effort = plan("stress", quick=quick)
    assert names[0] == "limits"
    suite = load("limits")
    found = {record.metric: record for record in suite.run(effort)}
    assert found["quick"].value == quick
    measured = limits.machine()
    # A copy reads and writes every byte.
    assert found["memory bandwidth"].value == pytest.approx(2e-9 / measured.copy)
    assert found["decoding"].value == pytest.approx(1e9 * measured.decode)
    terminal = Console(width=80, record=True)
    terminal.print(suite.table(list(found.values())))
    shown = terminal.export_text()
    assert "…" not in shown
    assert "memory" in shown


@pytest.mark.usefixtures("_small")
def test_limits_are_measured_once_a_process() -> None:
    assert limits.machine() is limits.machine()
