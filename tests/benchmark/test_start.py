"""Fresh processes: what is measured is what was run."""

from __future__ import annotations

import pytest
from rich.console import Console

from matest.benchmark import Effort, load
from matest.benchmark.suites import start


def test_the_estimate_is_compared_with_torch_and_its_own_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(start, "SIZE", 32)
    found = list(load("start").run(Effort(quick=True)))
    values = {record.metric: record.value for record in found}
    ratio = values["matest estimate"] / (values["import torch"] + values["fit"])
    assert values["estimate / (import torch + fit)"] == pytest.approx(ratio)
    assert 0 < values["fit"] < values["matest estimate"]
    assert {r.metric: r.limit for r in found if r.limit} == {
        "matest --help": 0.3,
        "estimate / (import torch + fit)": 1.5,
    }
    terminal = Console(width=80, record=True)
    terminal.print(load("start").table(found))
    assert "…" not in terminal.export_text()


def test_a_process_that_fails_gives_no_time() -> None:
    with pytest.raises(start.subprocess.CalledProcessError):
        start.seconds("-c", "raise SystemExit(1)")
