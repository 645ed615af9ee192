"""The suite of errors of the calibration, on few captures."""

from __future__ import annotations

import math

import pytest
from rich.console import Console

from matest.benchmark import Effort, load
from matest.benchmark.suites import calibration
from matest.benchmark.suites.calibration import COLUMNS, OBJECTS, ROWS, Outcome, asked, columns_of, trial
from matest.estimation.options import Options
from matest.samples.uncertainty import Uncertainty
from tests.benchmark.test_selection import HereInOrder


def test_what_is_stated_of_every_row_is_an_uncertainty_and_its_families_can_be_refined() -> None:
    for name, row in ROWS.items():
        assert Uncertainty.of(row.size).stated.keys() == row.size.keys()
        for column in columns_of(name, Effort()):
            words = asked(row, column)
            Options(refine=tuple(words["refine"]) if column == "refined" else ("all",))
            assert {*words} == {"declared": {"uncertainty"}, "today": set()}.get(column, {"refine"})


def test_every_kind_of_error_is_estimated_in_all_rows_only_where_the_suite_runs_alone() -> None:
    assert columns_of("blur 1.5 px", Effort()) == COLUMNS
    for short in (Effort(quick=True), Effort(shared=True)):
        assert columns_of("blur 1.5 px", short) == ("today", "declared", "refined")
        assert columns_of("four at once", short) == COLUMNS
    assert columns_of("nothing wrong", Effort(quick=True)) == ("today", "all")
    assert columns_of("normals 2° by pixel", Effort(quick=True)) == ("today", "declared")


@pytest.mark.parametrize("kind", OBJECTS)
def test_an_estimate_is_right_where_nothing_is_wrong(kind: str) -> None:
    outcome = trial("nothing wrong", kind, ["today"], 0)["today"]
    assert abs(outcome.error) < 0.005
    assert abs(outcome.error) < 4 * outcome.std


def test_a_radius_off_by_a_pixel_spoils_the_roughness_which_its_interval_allows_for() -> None:
    outcome = trial("radius 1 px", "sphere", ["today"], 0)["today"]
    assert 0.1 < abs(outcome.error) < 0.4
    assert outcome.std > 0.5 * abs(outcome.error)
    assert outcome.covered


def test_the_same_trial_has_the_same_outcome() -> None:
    assert trial("four at once", "vase", ["today"], 1) == trial("four at once", "vase", ["today"], 1)


def test_the_table_fits_and_shows_what_misses_its_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(calibration, "processes", HereInOrder)

    def stand_in(_: str, __: str, columns: tuple[str, ...], seed: int) -> dict[str, Outcome]:
        wide = Outcome(-0.123456 if seed else 0.123456, 1.5, True)
        return {column: wide if column != "all" else Outcome(math.nan, math.nan, False) for column in columns}

    monkeypatch.setattr(calibration, "trial", stand_in)
    records = list(load("calibration").run(Effort(quick=True)))
    by_metric = {(record.case, record.metric): record for record in records}
    case = "vase: ambient 1 %"
    assert by_metric[case, "error, today"].value == pytest.approx(0.123456)
    assert by_metric[case, "std / error, declared"].misses
    assert not by_metric[case, "coverage, declared"].misses
    assert by_metric[case, "gain, refined"].value == pytest.approx(1)
    assert by_metric[case, "gain, refined"].misses
    assert not by_metric["vase: mesh turned 1°", "gain, refined"].misses
    assert by_metric["vase: four at once", "error, all"].value is None
    assert ("vase: radius 1 px", "captures") not in by_metric
    terminal = Console(width=80, record=True)
    terminal.print(load("calibration").table(records))
    text = terminal.export_text()
    assert "…" not in text
    assert all(column in text for column in COLUMNS)
    assert "100 12.3 12.15" in text
