"""One simulated capture: errors in units of the bound, and nothing wrong passes for right."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

import matest
from matest.benchmark.instruments import trial as trials
from matest.benchmark.instruments.trial import draw, trial


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


def test_a_capture_that_raises_is_named_by_its_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise matest.InputError("no lit pixel.")

    monkeypatch.setattr(trials.matest, "estimate", fail)
    with pytest.raises(matest.InputError) as caught:
        trial("lambert", 17)
    assert "lambert with seed 17" in caught.value.__notes__[0]
