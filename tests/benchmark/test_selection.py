"""The suite of the automatic choice, on few captures."""

from __future__ import annotations

import pytest
from rich.console import Console

from matest.benchmark import Effort, load
from matest.benchmark.suites import selection
from matest.benchmark.suites.selection import LIMITS, MISFITS, TRUTHS, Choice, choice, cost_without_model
from matest.estimation.recipes import RECIPES
from tests.benchmark.test_efficiency import Here


class HereInOrder(Here):
    """Stands in for a pool of processes."""

    def map(self, work, *arguments):  # type: ignore[no-untyped-def, override]
        return map(work, *arguments)


def test_every_truth_has_components_that_a_recipe_has() -> None:
    possible = {recipe.components for recipe in RECIPES}
    assert all(truth.components in possible for truth in TRUTHS.values())


@pytest.mark.parametrize("name", ["lambert", "copper"])
def test_a_choice_finds_the_components_and_predicts_as_well_as_the_truth(name: str) -> None:
    result = choice(name, 0)
    assert result.right
    assert result.error == pytest.approx(1, abs=0.05)
    assert result.ratio > 1


@pytest.mark.parametrize("misfit", MISFITS)
def test_the_cost_where_no_model_holds_is_that_of_the_choice_and_the_fit(misfit: str) -> None:
    assert cost_without_model(misfit, 0) > 1


def test_the_table_fits_and_wrong_choices_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(selection, "processes", HereInOrder)
    choices = [Choice("oren-nayar", True, 1.0, 2.0), Choice("lambert", False, 1.3, 2.5)]
    monkeypatch.setattr(selection, "choice", lambda _, seed: choices[seed])
    monkeypatch.setattr(selection, "cost_without_model", lambda _, seed: 2.0 + seed)
    records = list(load("selection").run(Effort(quick=True)))
    by_metric = {(record.case, record.metric): record for record in records}
    for name in TRUTHS:
        assert by_metric[name, "right"].value == 0.5
        assert by_metric[name, "right"].misses
        assert "lambert" in by_metric[name, "right"].note
        assert by_metric[name, "predicted"].value == 0.5
        assert by_metric[name, "auto / named"].value == 2.25
        assert by_metric[name, "auto / named"].limit == LIMITS["auto / named"]
    for misfit in MISFITS:
        assert by_metric[misfit, "auto / named"].value == 2.5
        assert not by_metric[misfit, "auto / named"].misses
    terminal = Console(width=80, record=True)
    terminal.print(load("selection").table(records))
    assert "…" not in terminal.export_text()
