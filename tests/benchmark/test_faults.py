"""Faults: each is caused once, the slow ones where they are asked for, and what they spoil is counted."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

import pytest
from rich.console import Console

from matest.benchmark import Effort, load
from matest.benchmark.instruments import faults
from matest.benchmark.instruments.laboratory import Laboratory, answer_of, laboratory
from matest.benchmark.suites import faults as suite
from matest.report import manifest

pytestmark = pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="finds processes in Linux's /proc")


@pytest.fixture(scope="module")
def lab() -> Iterator[Laboratory]:
    with laboratory(3, seed=1) as made:
        yield made


@pytest.mark.slow
@pytest.mark.parametrize("name", faults.FAULTS)
def test_a_fault_leaves_every_result_whole(lab: Laboratory, name: str) -> None:
    try:
        assert [*faults.FAULTS[name][0](lab)] == []
    except faults.ImpossibleHereError as error:
        pytest.skip(str(error))


def test_what_is_lost_partial_changed_or_left_over_is_seen(tmp_path: Path) -> None:
    lab = Laboratory(tmp_path, random.Random(0), [])
    for name in ("a", "b"):
        (lab.out / name).mkdir(parents=True)
        (lab.out / name / "result.json").write_text('{"albedo": 0.5, "command": "x"}', "utf-8")
        manifest.write(lab.out / name, {}, {})
    lab.answers = {name: answer_of(lab.out / name) for name in ("a", "b")}
    assert [*lab.lost()] == []
    (lab.out / ".a.matest-part").mkdir()
    assert [*lab.lost()] == ["left over: .a.matest-part"]
    assert [*lab.lost(over=False)] == []
    lab.answers["a"] = '{"albedo": 0.4, '
    (lab.out / "b" / "result.json").write_text("half", "utf-8")
    lab.answers["c"] = ""
    assert [*lab.lost(over=False)] == ["only 2 of 3 results", "a has another result", "b is not whole"]


def test_cases_that_spoil_something_are_counted_with_what_they_spoilt(monkeypatch: pytest.MonkeyPatch) -> None:
    def cause(lab: Laboratory) -> Iterator[str]:
        lab.ends.append(3.0)
        if lab.moments.random() < 2:
            yield "ball0 is not whole"

    def impossible(_: Laboratory) -> Iterator[str]:
        raise faults.ImpossibleHereError("no disks here")
        yield

    monkeypatch.setattr(suite, "FAULTS", {"one": (cause, 2), "other": (impossible, 2)})
    monkeypatch.setattr(suite, "laboratory", _empty)
    records = list(load("faults").run(Effort()))
    values = {(record.case, record.metric): record.value for record in records}
    assert values == {
        ("one", "tried"): 2,
        ("one", "lost or partial"): 2,
        ("one", "seconds to the end"): 3.0,
        ("other", "tried"): None,
    }
    terminal = Console(width=80, record=True)
    terminal.print(load("faults").table(records))
    text = terminal.export_text()
    assert "2: ball0 is not whole" in text
    assert "no disks here" in text


class _empty:
    """A laboratory without captures."""

    def __init__(self, *_: object) -> None:
        self.lab = Laboratory(Path(), random.Random(0), [])

    def __enter__(self) -> Laboratory:
        return self.lab

    def __exit__(self, *_: object) -> None:
        pass
