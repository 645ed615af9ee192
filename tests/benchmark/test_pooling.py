"""Pooled figures tell a good estimator from a biased one, and honest error bars from wrong ones."""

from __future__ import annotations

import numpy as np
import pytest

from matest.benchmark.instruments.pooling import Interval, coverage, mean_error, records, rms_error
from matest.benchmark.instruments.trial import Figure, Trial
from matest.benchmark.suite import Record
from matest.benchmark.suites.efficiency import TARGETS


def trials(
    count: int = 400, *, spread: float = 1.0, bias: float = 0.0, bars: float = 1.0, excess: float = 0.0
) -> list[Trial]:
    """Estimates of two unknowns whose errors have this spread and bias, in units of the bound 0.1, and such bars."""
    generator = np.random.default_rng(0)
    found = []
    for seed in range(count):
        figures = []
        for label in ("albedo[0]", "sigma"):
            value = 0.5 + 0.1 * (bias + spread * generator.standard_normal())
            reach = 1.96 * 0.1 * bars
            figures.append(Figure(label, 0.5, 0.1, value, (value - reach, value + reach)))
        found.append(Trial("oren-nayar", seed, tuple(figures), excess, "fisher", "sphere"))
    return found


def measured(found: list[Trial]) -> dict[str, Record]:
    return {record.metric: record for record in records("efficiency", "oren-nayar", found, TARGETS)}


def missed(found: list[Trial]) -> set[str]:
    return {metric for metric, record in measured(found).items() if record.misses}


def test_an_efficient_estimator_with_honest_error_bars_misses_no_limit() -> None:
    assert missed(trials()) == set()
    assert rms_error(trials()).value == pytest.approx(1, abs=0.05)
    assert coverage(trials()).value == pytest.approx(0.95, abs=0.015)


@pytest.mark.parametrize(
    ("wrong", "metrics"),
    [
        ({"bias": 0.6, "bars": 1.2}, {"rms error"}),
        ({"spread": 1.2, "bars": 1.2}, {"rms error"}),
        ({"bars": 0.8}, {"coverage"}),
        ({"bars": 1.3}, {"coverage, not above"}),
        ({"excess": 0.6}, {"optimum missed"}),
    ],
)
def test_a_wrong_estimator_misses_the_limit_that_is_there_for_it(wrong: dict[str, float], metrics: set[str]) -> None:
    assert missed(trials(**wrong)) == metrics


def test_few_captures_are_held_to_no_limit_of_errors() -> None:
    limits = {name: record.limit for name, record in measured(trials()).items() if record.limit is not None}
    assert limits == {"rms error": 1.05, "coverage": 0.93, "coverage, not above": 0.97, "optimum missed": 0}
    few = measured(trials(10, bias=5.0))
    assert {name for name, record in few.items() if record.limit is not None} == {"optimum missed"}
    assert few["rms error"].value > 1.05


def test_bias_shows_in_the_mean_error_of_the_parameter() -> None:
    found = measured(trials(bias=0.5))
    assert found["sigma: mean error, from"].value < 0.5 < found["sigma: mean error, to"].value
    assert found["albedo: mean error, from"].value > 0.3


def test_intervals_hold_the_true_figure_as_often_as_they_say() -> None:
    generator = np.random.default_rng(1)

    def again() -> Interval:
        errors = generator.standard_normal(100)
        figures = [Figure("sigma", 0.0, 1.0, float(error), None) for error in errors]
        return rms_error([Trial("lambert", seed, (one,), None, "fisher", "") for seed, one in enumerate(figures)])

    intervals = [again() for _ in range(200)]
    # 95 % up to the small-sample shortfall of the bootstrap.
    assert 0.88 <= np.mean([one.low <= 1 <= one.high for one in intervals]) <= 0.99


def test_errors_of_one_capture_that_lean_the_same_way_widen_the_interval() -> None:
    errors = np.random.default_rng(2).standard_normal(100)

    def captures(times: int) -> list[Trial]:
        figures = [Figure("albedo", 0.0, 1.0, float(error), None) for error in errors]
        return [Trial("lambert", seed, (one,) * times, None, "fisher", "") for seed, one in enumerate(figures)]

    alone, alike = captures(1), captures(4)
    quarter = alike[:25]
    assert mean_error(alone) == mean_error(alike)
    assert mean_error(quarter).high - mean_error(quarter).low > 1.5 * (mean_error(alone).high - mean_error(alone).low)


def test_a_parameter_without_a_number_lowers_the_share_given_and_nothing_else() -> None:
    lost = Trial("oren-nayar", 7, (Figure("sigma", 0.5, 0.1, None, None),), None, "fisher", "vase")
    found = measured([*trials(10), lost])
    assert found["parameters"].value == 21
    assert found["given"].value == pytest.approx(20 / 21)
    assert found["rms error"].value == measured(trials(10))["rms error"].value


def test_a_failure_names_its_capture_and_how_to_see_it_again() -> None:
    found = trials(20)
    bad = Trial("oren-nayar", 77, (Figure("sigma", 0.5, 0.1, 5.5, (5.3, 5.7)),), 9.0, "fisher", "vase, 1 light")
    for metric in ("rms error", "optimum missed"):
        note = measured([*found, bad])[metric].note
        assert "seed 77 (vase, 1 light): sigma 5.5 (0.5), +50.0 outside" in note
        assert "efficiency.again('oren-nayar', 77)" in note
