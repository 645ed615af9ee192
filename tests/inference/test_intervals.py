"""Which unknowns get an interval by the profile of the likelihood, and what it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from matest.estimators import Statistics
from matest.inference.error_bars import ErrorBars, error_bars
from matest.inference.expansion import Expansion
from matest.inference.intervals import Intervals, profile_intervals
from matest.inference.lobes import LobesNotSeen
from matest.inference.profiles import Surroundings
from matest.inference.valleys import Valleys
from tests.inference.judged import solved, source


def profiled(
    at: tuple[float, float],
    valleys: Valleys,
    *,
    not_determined: tuple[int, ...] = (),
    lobes: LobesNotSeen = LobesNotSeen(),  # noqa: B008
) -> tuple[Intervals, ErrorBars]:
    """Of albedo and sigma with standard errors of 0.041 and 0.082, χ² exactly quadratic about `at`."""
    solution = solved(torch.zeros(6, 2), at=at)

    def evaluate(unknowns: Tensor) -> Statistics:
        change, best = unknowns - solution.unknowns, solution.statistics
        scores = best.scores.clone()
        scores[:, :2] += (change @ best.information @ change) / 6
        return replace(best, gradients=-(best.informations @ change), scores=scores)

    bars = error_bars(solution, source(6))
    around = lambda: Surroundings(solution, evaluate)  # noqa: E731
    return profile_intervals(Expansion.of(solution), bars, lobes, valleys, around, not_determined), bars


def ends(of: Mapping[int, tuple[float, float]], position: int) -> list[float]:
    return list(of[position])


def test_far_from_bounds_and_valleys_no_interval_is_by_profile() -> None:
    assert profiled((0.5, 0.5), Valleys())[0] == Intervals()


def test_near_a_bound_the_interval_of_a_quadratic_is_cut_there() -> None:
    found, bars = profiled((0.5, 0.1), Valleys())
    assert {*found.ends} == {1}
    low, high = found.ends[1]
    assert low == 0
    assert high == pytest.approx(0.1 + 1.96 * float(bars.open.std[1]), rel=0.05)


def test_along_a_bent_valley_every_unknown_has_one() -> None:
    found, bars = profiled((0.5, 0.5), Valleys(bent=frozenset({0, 1})))
    assert found.bent == frozenset({0, 1})
    reach = 1.96 * float(bars.open.std[0])
    assert ends(found.ends, 0) == pytest.approx([0.5 - reach, 0.5 + reach], rel=0.05)


def test_what_is_lost_to_first_order_has_none_unless_its_valley_bends() -> None:
    assert profiled((0.5, 0.1), Valleys(), not_determined=(1,))[0].ends == {}
    bent = Valleys(bent=frozenset({1}))
    assert {*profiled((0.5, 0.1), bent, not_determined=(1,))[0].ends} == {1}
    assert profiled((0.5, 0.1), replace(bent, locked=frozenset({1})), not_determined=(1,))[0].ends == {}


def test_the_interval_of_a_lobe_that_is_not_seen_begins_at_its_lower_bound() -> None:
    lobes = LobesNotSeen(amplitudes=frozenset({"albedo"}))
    found, _ = profiled((0.1, 0.5), Valleys(bent=frozenset({0})), lobes=lobes)
    assert found.ends[0][0] == 0
