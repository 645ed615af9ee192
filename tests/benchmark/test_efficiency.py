"""The suites of efficiency and of outliers, on a few captures."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any

import pytest
from rich.console import Console

import matest
from matest.benchmark import SUITES, efficiency, outliers
from matest.benchmark import trial as trials
from matest.benchmark.optimum import excess
from matest.benchmark.simulated import CLEAN, draw
from matest.benchmark.trial import trial
from matest.identifiability.forecast import unknowns_at
from matest.specification import Constraints, specify


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
    monkeypatch.setattr(efficiency, "ProcessPoolExecutor", Here)
    monkeypatch.setattr(efficiency, "MODELS", ("lambert", "cook-torrance"))
    for suite in (efficiency, outliers):
        monkeypatch.setattr(suite, "CAPTURES_QUICK", 2)


@pytest.mark.parametrize("suite", ["efficiency", "outliers"])
def test_every_figure_has_its_interval_and_the_table_fits(suite: str) -> None:
    said: list[tuple[object, ...]] = []
    found = list(SUITES[suite].run(True, lambda *words: said.append(words)))
    assert said[-1] == ("cook-torrance", 2, 2)
    by_metric = {(record.case, record.metric): record for record in found}
    assert len(by_metric) == len(found)
    assert {record.suite for record in found} == {suite}
    for case, name in (("lambert", "albedo"), ("cook-torrance", "diffuse")):
        assert by_metric[case, "captures"].value == 2
        for metric in ("rms error", "coverage", f"{name}: rms error", f"{name}: mean error"):
            low, high = (by_metric[case, f"{metric}, {end}"].value for end in ("from", "to"))
            assert low <= by_metric[case, metric].value <= high
    limits = {record.metric: record.limit for record in found if record.limit is not None}
    expected = {"rms error": 1.05, "coverage": 0.93, "coverage, not above": 0.97, "optimum missed": 0}
    assert limits == (expected if suite == "efficiency" else {"rms error": 1.3, "coverage": 0.9})
    terminal = Console(width=80, record=True)
    terminal.print(SUITES[suite].table(found))
    shown = terminal.export_text()
    assert "…" not in shown
    assert all(name in shown for name in ("lambert", "cook-torrance", "diffuse", "2 captures a model"))


def test_a_capture_seen_again_is_the_one_of_the_suite() -> None:
    found = trial("lambert", 1)
    assert found == trial("lambert", 1)
    assert found.summary in efficiency.again("lambert", 1)
    assert outliers.again("lambert", 1) != efficiency.again("lambert", 1)


@pytest.mark.parametrize("expression", ["oren-nayar", "cook-torrance", "li-torrance"])
def test_a_clean_capture_is_estimated_to_a_few_bounds_at_the_global_optimum(expression: str) -> None:
    found = trial(expression, 1)
    assert len(found.figures) >= 2
    assert found.worst < 5
    assert found.excess is not None
    assert found.excess < 0.5


def test_a_slope_is_compared_as_the_ratio_that_is_reported() -> None:
    found = trial("li-torrance", 1, grid=False).only("slope_ratio")
    length = float(draw("li-torrance", 1).material.parameters["correlation_length"])
    assert found.figures[0].truth == pytest.approx(1 / length)
    assert math.isfinite(found.figures[0].error)


def test_an_estimator_that_is_off_by_ten_bounds_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    honest = trial("lambert", 1).figures[0]
    found = matest.estimate

    def biased(*arguments: Any, **options: Any) -> matest.Estimate:
        outcome = found(*arguments, **options)
        albedo = outcome.parameters["albedo"]
        moved = replace(albedo, value=[value + 10 * honest.bound for value in albedo.value])
        return replace(outcome, parameters={"albedo": moved})

    monkeypatch.setattr(trials.matest, "estimate", biased)
    assert trial("lambert", 1).figures[0].error == pytest.approx(honest.error + 10)


@pytest.mark.parametrize("expression", ["oren-nayar", "cook-torrance"])
def test_the_grid_finds_what_a_fit_stuck_elsewhere_has_missed(expression: str) -> None:
    drawn = draw(expression, 1)
    capture = drawn.photograph(CLEAN)
    held = {"f0": 0.04} if expression == "cook-torrance" else {}
    problem = specify(expression, Constraints(fix=held), channels=capture.channels, relative=False).problem
    truth = unknowns_at(problem, drawn.material.parameters)
    stuck = truth.clone()
    stuck[problem.where[problem.shapes[0]]] *= 2
    assert excess(problem, stuck, capture.samples()) > 100
    # The truth itself is about one unit a parameter above the optimum, and the grid only near it.
    assert excess(problem, truth, capture.samples()) < 20


def test_a_record_without_any_figure_says_so_instead_of_failing() -> None:
    nothing = trials.Trial("lambert", 0, (), None, "fisher", "sphere")
    found = list(efficiency.records("efficiency", "lambert", [nothing], efficiency.TARGETS))
    assert [(record.metric, record.value) for record in found] == [("captures", 1), ("parameters", 0), ("given", None)]
