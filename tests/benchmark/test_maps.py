"""The suite of maps, on tiny captures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from rich.console import Console

from matest.benchmark import Effort, load
from matest.benchmark.instruments.map_intervals import SMOOTH, Setting
from matest.benchmark.suite import Record
from matest.benchmark.suites import maps
from matest.benchmark.suites.command import Cost
from matest.brdf import OrenNayar
from tests.benchmark.test_selection import HereInOrder

pytestmark = pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="reads Linux's /proc")


@pytest.fixture(scope="module")
def found() -> list[Record]:
    """Records of a run smaller than a quick one, held to the limits of cost; the command is a stand-in."""
    tiny = replace(
        maps.QUICK, command=24, costs=tuple(maps.COSTS), judged=True, growing=(16, 24), accurate=24, covered=24,
        settings=(SMOOTH[2], Setting("sphere", "oren-nayar", 3, 2)), race=maps.Rules(16, (0.3, 0.1), 3),
    )  # fmt: skip

    def cost_of(_: Path, *options: str) -> Cost:
        return Cost(0.5, 2.0, 4.0 if options[-1] == "albedo,sigma" else 2.0, 1600.0, {})

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(maps, "QUICK", tiny)
        patch.setattr(maps, "cost_of", cost_of)
        patch.setattr(maps, "processes", HereInOrder)
        return list(load("maps").run(Effort(quick=True)))


def test_no_figure_is_named_twice(found: list[Record]) -> None:
    names = [(record.case, record.metric) for record in found]
    assert len(set(names)) == len(names)


def test_costs_are_held_to_the_limit_of_their_maps(found: list[Record]) -> None:
    ratios = {record.case: record for record in found if record.metric == "command / decode"}
    assert {case: (one.value, one.limit, one.misses) for case, one in ratios.items()} == {
        "12 × 24²: albedo": (4, 3, True),
        "12 × 24²: albedo,sigma": (8, 10, False),
    }
    assert all(record.misses for record in found if record.metric == "peak")


def test_growth_has_a_time_for_every_size_and_an_exponent(found: list[Record]) -> None:
    for case in ("growth: albedo", "growth: albedo,sigma"):
        metrics = {record.metric: record for record in found if record.case == case}
        assert sum(metric.startswith("time of ") for metric in metrics) == 2
        assert metrics["exponent"].limit == 1.05


def test_the_race_has_errors_of_both_at_the_same_pixels(found: list[Record]) -> None:
    metrics = {record.metric: record for record in found if record.case == "race, 16²: cook-torrance"}
    assert metrics["adam / matest"].value == pytest.approx(metrics["adam"].value / metrics["matest"].value)
    for what in ("median error", "far off"):
        assert {f"{who}, {name}: {what}" for who in ("matest", "adam") for name in ("diffuse", "slope")} <= set(metrics)
    assert "3 steps" in metrics["adam"].note


def test_only_known_pixels_count_and_slopes_are_held_to_their_limits() -> None:
    truth = OrenNayar(torch.full((4, 1), 0.5, dtype=torch.float64), 0.4)
    value, known = torch.tensor([[0.5], [0.51], [0.6], [0.9]]), torch.tensor([True, True, True, False])
    median, far = maps.errors("case", "matest", {"albedo": value}, truth, known, judged=True)
    assert median.value == pytest.approx(0.02)
    assert far.value == pytest.approx(1 / 3)
    assert median.misses
    assert far.misses
    for record in maps.errors("case", "matest", {"albedo": value}, truth, known, judged=False):
        assert record.limit is None


def test_where_no_pixel_is_known_there_is_no_figure() -> None:
    truth = OrenNayar(torch.full((1, 1), 0.5, dtype=torch.float64), 0.4)
    none = maps.errors("case", "matest", {"albedo": torch.ones(1, 1)}, truth, torch.tensor([False]), judged=True)
    assert [record.value for record in none] == [None, None]


def test_the_table_fits(found: list[Record]) -> None:
    terminal = Console(width=80, record=True)
    terminal.print(load("maps").table(found))
    shown = terminal.export_text()
    assert "…" not in shown
    for text in ("sphere: oren-nayar, albedo", "(2 materials, 3 images)", "adam, slope", "times as long as matest"):
        assert text in shown


def test_the_table_fits_the_largest_figures() -> None:
    found = [
        Record("maps", "12 × 1024²: albedo,sigma", "decode", 1.234, "s"),
        Record("maps", "12 × 1024²: albedo,sigma", "command", 123.4, "s"),
        Record("maps", "12 × 1024²: albedo,sigma", "peak", 12345.6, "MB"),
        Record("maps", "12 × 1024²: albedo,sigma", "command / decode", 123.4, "1"),
        *(Record("maps", "growth: albedo", f"time of {pixels:,}", 123.4, "s") for pixels in (1e4, 1e5, 697_280)),
        Record("maps", "growth: albedo", "exponent", 1.234, "1", limit=1.05),
        Record("maps", "errors, sphere: cook-torrance", "pixels", 43_580, "1"),
        Record("maps", "errors, sphere: cook-torrance", "known", 12_345, "1"),
        Record("maps", "errors, sphere: cook-torrance", "reduced chi2", 12.34, "1"),
        Record("maps", "errors, sphere: cook-torrance", "matest", 1234.5, "s"),
        Record("maps", "errors, sphere: cook-torrance", "matest, diffuse: median error", 0.0012345, "1"),
        Record("maps", "errors, sphere: cook-torrance", "matest, diffuse: far off", 0.0012345, "1"),
    ]
    terminal = Console(width=80, record=True)
    terminal.print(load("maps").table(found))
    assert "…" not in terminal.export_text()
