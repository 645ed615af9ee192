"""Error against time: who is how good when."""

from __future__ import annotations

import math

import pytest
import torch

from matest.benchmark.instruments.curves import POINTS, Curve, Step, Yardstick, in_order
from matest.benchmark.instruments.task import Trace


def values(**numbers: object) -> dict[str, torch.Tensor]:
    return {name: torch.as_tensor(number, dtype=torch.float64) for name, number in numbers.items()}


def test_error_is_in_units_of_the_bound_and_distance_is_from_the_optimum() -> None:
    yardstick = Yardstick(
        truth=values(albedo=[0.5, 0.4], sigma=0.6, f0=0.04),
        bound=values(albedo=[0.1, 0.1], sigma=[0.2]),
        optimum=values(albedo=[0.5, 0.5], sigma=0.5),
    )
    step = yardstick.step(3.0, values(albedo=[0.6, 0.6], sigma=1.0))
    assert step.seconds == 3.0
    assert step.error == pytest.approx(math.sqrt((1**2 + 2**2 + 2**2) / 3))
    assert step.off == pytest.approx(1.0)
    both = yardstick.step(3.0, values(albedo=[0.6, 0.6], sigma=1.0), values(albedo=[0.5, 0.4], sigma=0.6))
    assert both.error == pytest.approx(step.error / math.sqrt(2))
    assert both.off == step.off


def test_a_solver_that_is_lost_has_no_error_to_speak_of() -> None:
    yardstick = Yardstick(values(sigma=0.6), values(sigma=[0.1]), values(sigma=0.6))
    trace = Trace(seconds=[1.0, 2.0], values=[values(sigma=0.6), values(sigma=math.nan)])
    assert Curve([yardstick.run(trace)]).arrival("error", 2.0) is None


def test_lobes_that_change_places_are_the_same_material() -> None:
    swapped = values(slope=0.4, slope_2=0.2, weight_2=0.4)
    assert {name: float(value) for name, value in in_order(swapped).items()} == {
        "slope": 0.2,
        "slope_2": 0.4,
        "weight_2": pytest.approx(0.6),
    }
    assert in_order(in_order(swapped)) == in_order(swapped)


def test_arrival_is_that_of_the_run_that_comes_to_stay_first() -> None:
    leaves = [Step(1.0, 1.5, 0.0), Step(2.0, 9.0, 0.0), Step(5.0, 1.5, 0.0)]
    stays = [Step(1.5, 9.0, 0.0), Step(4.0, 1.9, 0.0)]
    assert Curve([leaves]).arrival("error", 2.0) == 5.0
    assert Curve([leaves, stays]).arrival("error", 2.0) == 4.0
    assert Curve([leaves, stays]).arrival("error", 1.0) is None
    assert Curve([leaves]).arrival("off", 0.01) == 1.0
    assert Curve().arrival("error", 2.0) is None


def test_points_are_the_best_of_the_runs_at_every_time() -> None:
    slow, quick = [Step(2.0, 8.0, 0.0), Step(6.0, 1.0, 0.0)], [Step(1.0, 4.0, 0.0), Step(3.0, 3.0, 0.0)]
    assert Curve([slow, quick]).points() == [(1.0, 4.0), (2.0, 4.0), (3.0, 3.0), (6.0, 1.0)]
    assert Curve([slow, quick]).end == 1.0
    assert Curve().points() == []


def test_many_points_are_thinned_and_keep_both_ends() -> None:
    run = [Step(0.01 * (k + 1), 1000.0 - k, 0.0) for k in range(1000)]
    points = Curve([run]).points()
    assert 10 < len(points) <= POINTS
    assert points[0] == (0.01, 1000.0)
    assert points[-1] == (10.0, 1.0)
    assert points == sorted(points)
