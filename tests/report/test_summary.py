"""Summaries of many captures: what to look at first comes first, in files and on a terminal."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from rich.console import Console

from matest.report.summary import Row, check_summary, failures, in_order, summary_table, totals, write_summary
from tests.captures import refusal
from tests.estimates import clay

BAD = Row("cup", "bad input", error="cup/01.png: no such file.")
MODEL = "oren-nayar+cook-torrance(distribution=ggx,masking=smith)"


def row(name: str, chi2: float) -> Row:
    return Row(name, "converged", MODEL, chi2, 0.0123, {"sigma": (0.5, 0.01)}, 2, 1.5)


def printed(rows: list[Row]) -> str:
    terminal = Console(width=80, record=True)
    terminal.print(summary_table(rows))
    return terminal.export_text()


def test_a_row_has_the_figures_of_its_result() -> None:
    result = clay().to_dict() | {"timing_s": {"total": 2.5}}
    of = Row.of("vase", result)
    fit = result["fit"]
    assert (of.name, of.model, of.status, of.chi2) == ("vase", result["model"], "converged", fit["reduced_chi2"])
    assert (of.relative_rmse, of.warnings, of.seconds, of.exit_code) == (fit["relative_rmse"], 1, 2.5, 0)
    parameter = result["parameters"]["albedo"]
    assert of.parameters["albedo[1]"] == (parameter["value"][1], parameter["std"][1])
    assert of.parameters["sigma"] == (result["parameters"]["sigma"]["value"], result["parameters"]["sigma"]["std"])


def test_what_has_no_result_comes_first_and_then_the_largest_misfit() -> None:
    rows = [row("good", 1.0), BAD, row("worse", 9.0)]
    assert [each.name for each in in_order(rows)] == ["cup", "worse", "good"]
    assert [each.exit_code for each in in_order(rows)] == [2, 0, 0]


def test_the_files_have_a_row_a_capture(tmp_path: Path) -> None:
    other = Row("a,b\udcff", "converged", "lambert", 1.0, 0.01, {"albedo": (None, None)}, kept=True)
    write_summary(tmp_path, [BAD, row("vase", 1.5), other])
    with (tmp_path / "summary.csv").open(encoding="utf-8-sig", newline="") as file:
        bad, vase, third = csv.DictReader(file)
    assert (bad["error"], bad["chi2"], bad["sigma"]) == (BAD.error, "", "")
    assert (vase["chi2"], vase["sigma"], vase["sigma std"], vase["warnings"]) == ("1.5", "0.5", "0.01", "2")
    assert (third["name"], third["albedo"]) == ("a,b\\udcff", "")
    content = json.loads((tmp_path / "summary.json").read_text("utf-8"))
    assert content["schema"] == "matest.summary/1"
    assert content["captures"][1]["parameters"] == {"sigma": [0.5, 0.01]}
    assert "kept" not in content["captures"][2]


def test_a_summary_replaces_an_earlier_one_and_nothing_else(tmp_path: Path) -> None:
    check_summary(tmp_path / "new")
    write_summary(tmp_path, [BAD])
    check_summary(tmp_path)
    (tmp_path / "summary.json").unlink()
    assert "summary.csv: would be replaced" in refusal(lambda: check_summary(tmp_path))
    (tmp_path / "summary.json").write_text("[]")
    refusal(lambda: check_summary(tmp_path))


@pytest.mark.parametrize("count", [3, 1000])
def test_a_terminal_shows_few_captures_all_and_of_many_the_worst(count: int) -> None:
    rows = in_order([*(row(f"capture-with-a-long-name-{number:04d}", 1.0 + number) for number in range(count)), BAD])
    text = printed(rows)
    assert max(map(len, text.splitlines())) <= 80
    assert text.count("converged") == min(count, 10) + 1
    assert f"{count + 1:,} captures: {count:,} converged, 1 bad input." in text
    assert "-0000" in text.replace("\n", "") if count == 3 else "largest χ²" in text


def test_of_many_failures_the_first_are_told() -> None:
    assert failures([BAD, row("vase", 1.0)]) == [BAD.error]
    told = failures([BAD] * 500)
    assert len(told) == 21
    assert told[-1].startswith("and 480 more captures")


def test_what_was_there_before_is_counted() -> None:
    assert totals([Row("a", "converged", chi2=1.0, kept=True)]) == "1 capture: 1 converged, 1 complete before."
