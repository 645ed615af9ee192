"""The suites of efficiency and of outliers, on a few captures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import pytest
from rich.console import Console

from matest.benchmark import Effort, load
from matest.benchmark.instruments import pooling
from matest.benchmark.instruments import trial as trials
from matest.benchmark.instruments.trial import trial
from matest.benchmark.suites import efficiency, outliers


class Here:
    """Stands in for a pool of processes: the work is done in this one."""

    def __init__(self, *_: object) -> None: ...

    def __enter__(self) -> Here:
        return self

    def __exit__(self, *_: object) -> None: ...

    def map(self, work: Callable[[int], Any], seeds: Iterable[int]) -> Iterator[Any]:
        return map(work, seeds)


@pytest.fixture(autouse=True)
def _few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(efficiency, "processes", Here)
    monkeypatch.setattr(efficiency, "MODELS", ("lambert", "cook-torrance"))
    for suite in (efficiency, outliers):
        monkeypatch.setattr(suite, "CAPTURES_QUICK", 2)


@pytest.mark.parametrize("suite", ["efficiency", "outliers"])
def test_every_figure_has_its_interval_and_the_table_fits(suite: str) -> None:
    said: list[tuple[object, ...]] = []
    found = list(load(suite).run(Effort(quick=True), lambda *words: said.append(words)))
    assert said[-1] == ("cook-torrance", 2, 2)
    by_metric = {(record.case, record.metric): record for record in found}
    assert len(by_metric) == len(found)
    assert {record.suite for record in found} == {suite}
    for case, name in (("lambert", "albedo"), ("cook-torrance", "diffuse")):
        assert by_metric[case, "captures"].value == 2
        for metric in ("rms error", "coverage", f"{name}: rms error", f"{name}: mean error"):
            low, high = (by_metric[case, f"{metric}, {end}"].value for end in ("from", "to"))
            assert low <= by_metric[case, metric].value <= high
    # Two captures say nothing of errors.
    limits = {record.metric: record.limit for record in found if record.limit is not None}
    assert limits == ({"optimum missed": 0} if suite == "efficiency" else {})
    terminal = Console(width=80, record=True)
    terminal.print(load(suite).table(found))
    shown = terminal.export_text()
    assert "…" not in shown
    assert all(name in shown for name in ("lambert", "cook-torrance", "diffuse", "2 captures a model"))


@pytest.mark.parametrize("suite", ["efficiency", "outliers"])
def test_no_capture_is_begun_after_the_time_and_the_table_says_how_many_there_were(suite: str) -> None:
    found = list(load(suite).run(Effort(seconds=0.0)))
    assert {record.case: record.value for record in found if record.metric == "captures"} == {
        "lambert": 1,
        "cook-torrance": 1,
    }
    terminal = Console(width=80, record=True)
    terminal.print(load(suite).table(found))
    assert "1 captures a model" in terminal.export_text()


def test_a_capture_seen_again_is_the_one_of_the_suite() -> None:
    found = trial("lambert", 1)
    assert found == trial("lambert", 1)
    assert found.summary in efficiency.again("lambert", 1)
    assert outliers.again("lambert", 1) != efficiency.again("lambert", 1)


@pytest.mark.parametrize("scale", [0.9876, 123.4])
def test_the_table_fits_the_longest_names_and_figures(scale: float) -> None:
    errors = [scale * error for error in (-1.234, 1.111, 0.123, -0.777)]
    figures = [trials.Figure("slope_ratio", 0.5, 0.1, 0.5 + 0.1 * error, (0.4, 0.6)) for error in errors]
    name = "oren-nayar-exact"
    several = [trials.Trial(name, seed, (one,) * 9, 0.0, "fisher", "") for seed, one in enumerate(figures)]
    found = list(pooling.records("efficiency", name, several, efficiency.TARGETS))
    terminal = Console(width=80, record=True)
    terminal.print(efficiency.table(found))
    shown = terminal.export_text()
    assert "…" not in shown
    assert name in shown


def test_a_record_without_any_figure_says_so_instead_of_failing() -> None:
    nothing = trials.Trial("lambert", 0, (), None, "fisher", "sphere")
    found = list(pooling.records("efficiency", "lambert", [nothing], efficiency.TARGETS))
    assert [(record.metric, record.value) for record in found] == [("captures", 1), ("parameters", 0), ("given", None)]
