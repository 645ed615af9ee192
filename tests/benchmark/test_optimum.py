"""A dense grid tells the global optimum from any other."""

from __future__ import annotations

import pytest

from matest.benchmark.instruments.optimum import excess
from matest.benchmark.instruments.trial import draw


@pytest.mark.parametrize("expression", ["oren-nayar", "cook-torrance"])
def test_the_grid_finds_what_a_fit_stuck_elsewhere_has_missed(expression: str) -> None:
    drawn = draw(expression, 1)
    capture = drawn.photograph()
    held = {"f0": 0.04} if expression == "cook-torrance" else {}
    problem = drawn.problem(held)
    truth = problem.unknowns_at(drawn.material.parameters)
    stuck = truth.clone()
    stuck[problem.where[problem.shapes[0]]] *= 2
    assert excess(problem, stuck, capture.samples()) > 100
    # The truth itself is about one unit a parameter above the optimum, and the grid only near it.
    assert excess(problem, truth, capture.samples()) < 20
