"""What enters the baseline, with what tolerance, and how it is kept in its file."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from matest.benchmark import baseline
from matest.benchmark.baseline import Baseline, Figure, figures_of
from matest.benchmark.suite import Record
from matest.errors import InputError

ROOT = Path(__file__).parents[2]
QUICK = Record("limits", "run", "quick", 1, "1")
POOLED = [
    Record("efficiency", "lambert", "parameters", 60, "1", "higher"),
    Record("efficiency", "lambert", "given", 1.0, "1", "higher"),
    Record("efficiency", "lambert", "rms error", 1.0, "bound", limit=1.05),
    Record("efficiency", "lambert", "rms error, from", 0.9, "bound"),
    Record("efficiency", "lambert", "rms error, to", 1.2, "bound"),
    Record("efficiency", "lambert", "coverage", 0.95, "1", "higher", 0.93),
    Record("efficiency", "lambert", "coverage, from", 0.76, "1"),
    Record("efficiency", "lambert", "coverage, to", 1.0, "1"),
    Record("efficiency", "lambert", "optimum missed", 0, "1", limit=0),
]
TIMES = [
    Record("estimate", "oren-nayar", "fit", 2.0, "s"),
    Record("estimate", "oren-nayar", "fit / decode", 4.0, "1", limit=1),
]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty checkout as the working directory."""
    (tmp_path / "tests").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def saved(path: Path, records: list[Record]) -> str:
    path.write_text("".join(json.dumps(record.to_dict()) + "\n" for record in records), "utf-8")
    return str(path)


def test_tolerances_of_pooled_figures_are_their_own_statistical_errors() -> None:
    tolerances = {figure.metric: figure.tolerance for figure in figures_of(POOLED)}
    # Errors may reach the end of their interval; of 60 intervals that all held, 5 % may fail.
    assert tolerances == pytest.approx(
        {"given": 0.05, "rms error": 0.2, "coverage": 0.2, "optimum missed": 0.0}, rel=1e-6
    )


def test_seconds_never_enter_and_ratios_count_as_cost() -> None:
    found = list(figures_of([*POOLED, *TIMES]))
    assert [figure.metric for figure in found if figure.kind == "cost"] == ["fit / decode"]
    assert {figure.kind for figure in found if figure.suite == "efficiency"} == {"accuracy"}


def test_a_figure_that_was_not_measured_does_not_enter() -> None:
    assert list(figures_of([Record("peers", "oren-nayar", "adam / matest", None, "1", "higher", 50)])) == []


@pytest.mark.parametrize(("better", "worst"), [("lower", 2.2), ("higher", 1.8)])
def test_the_worst_value_that_passes_lies_on_the_worse_side(better: str, worst: float) -> None:
    assert Figure("s", "c", "m", 2.0, better, 0.1, "cost").worst == pytest.approx(worst)  # type: ignore[arg-type]


def test_a_baseline_is_read_as_it_was_written(here: Path) -> None:
    written = Baseline(quick=tuple(figures_of(POOLED)), full=())
    baseline.write(written)
    assert baseline.read() == written
    lines = (here / baseline.PATH).read_text("utf-8").splitlines()
    assert sum('"suite"' in line for line in lines) == len(written.quick)


def test_new_records_replace_those_of_their_suites_in_their_kind_of_run(here: Path) -> None:
    baseline.main(saved(here / "first", [QUICK, *POOLED, *TIMES]))
    baseline.main(saved(here / "full", [Record("limits", "run", "quick", 0, "1"), *TIMES]))
    faster = Record("estimate", "oren-nayar", "fit / decode", 3.0, "1", limit=1)
    baseline.main(saved(here / "second", [QUICK, faster]))
    found = baseline.read()
    assert [figure.value for figure in found.full] == [4.0]
    assert {figure.suite: figure.value for figure in found.quick} == {"efficiency": 0, "estimate": 3.0}


@pytest.mark.parametrize("text", ["{", "[]", '{"quick": [{"suite": "stress"}]}'])
def test_a_bad_file_is_named_with_the_way_to_mend_it(here: Path, text: str) -> None:
    (here / baseline.PATH).write_text(text, "utf-8")
    with pytest.raises(InputError, match=r"benchmark_baseline.json: expected a baseline.*matest\.benchmark\.baseline"):
        baseline.read()


def test_records_without_their_first_lines_are_refused(here: Path) -> None:
    with pytest.raises(InputError, match="from its first line"):
        baseline.main(saved(here / "cut", POOLED))


@pytest.mark.parametrize("arguments", [[], ["a", "b"]])
def test_one_file_is_asked_for(
    arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["baseline", *arguments])
    with pytest.raises(SystemExit) as stopped:
        baseline.with_file(lambda file: pytest.fail(file))
    assert stopped.value.code == 2
    assert "matest: expected one file" in capsys.readouterr().err


def test_the_baseline_of_the_repository_holds_what_is_selected_and_no_seconds() -> None:
    found = baseline.read(ROOT / baseline.PATH)
    accurate = {figure.suite for figure in found.quick if figure.kind == "accuracy"}
    assert accurate == {"stress", "efficiency", "outliers", "export", "maps", "faults", "fuzz", "peers", "frontier"}
    for figure in (*found.quick, *found.full):
        again = list(
            figures_of(
                [
                    Record(figure.suite, figure.case, figure.metric, figure.value, "1", figure.better),
                    Record(figure.suite, figure.case, f"{figure.metric}, to", figure.value, "1"),
                    Record(figure.suite, figure.case, "exponent, standard error", 0, "1"),
                    Record(figure.suite, figure.case, "parameters", 1, "1"),
                ]
            )
        )
        assert [one.kind for one in again if one.metric == figure.metric] == [figure.kind]
