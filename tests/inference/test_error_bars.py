"""Error bars: which kind, and what is left out of them."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from matest.brdf import CookTorrance
from matest.inference.error_bars import error_bars, expected_error_bars
from matest.inference.expansion import Expansion
from tests.inference.judged import judged, solved, source
from tests.simulated import Studio


def balanced(groups: int, spread: float = 0.0) -> Tensor:
    """Gradients of so many groups that add up to nothing, alternately plus and minus `spread` standard errors."""
    sign = torch.tensor([1.0, -1.0]).repeat(groups // 2)
    return spread * sign[:, None] * torch.tensor([10.0, 5.0])


def test_where_the_model_holds_error_bars_are_fishers() -> None:
    bars = error_bars(solved(balanced(6)), source(6))
    assert bars.holds
    assert bars.kind == "fisher"
    assert bars.covariance.std.tolist() == pytest.approx([600**-0.5, 150**-0.5])
    assert math.isinf(bars.covariance.degrees)
    assert not bool(bars.bound.any())


def test_a_misfit_within_what_is_allowed_widens_them_by_its_root() -> None:
    bars = error_bars(solved(balanced(6), chi2=1.02), source(6))
    assert bars.holds
    assert bars.covariance.std.tolist() == pytest.approx([(1.02 / 600) ** 0.5, (1.02 / 150) ** 0.5])


def test_degrees_of_freedom_are_the_values_less_the_unknowns() -> None:
    assert error_bars(solved(balanced(6), values=102), source(6)).chi2 == pytest.approx(1.02)


def test_stated_noise_is_exact_and_estimated_noise_is_not() -> None:
    solution = solved(balanced(6), chi2=1.06)
    assert not error_bars(solution, source(6, noise_stated=True)).holds
    assert error_bars(solution, source(6, noise_stated=False)).holds


def test_few_values_miss_by_chance() -> None:
    assert error_bars(solved(balanced(6), chi2=1.2, values=1000), source(6)).holds


@pytest.mark.parametrize(
    ("images", "blocks", "kind", "degrees"),
    [
        (4, 1, "jackknife over images", 3),
        (2, 8, "jackknife over blocks", 15),
        (3, 1, "fisher", math.inf),
    ],
)
def test_where_the_model_does_not_hold_what_is_left_out_depends_on_what_there_is(
    images: int, blocks: int, kind: str, degrees: float
) -> None:
    bars = error_bars(solved(torch.zeros(images * blocks, 2), chi2=4.0), source(images, blocks))
    assert not bars.holds
    assert bars.kind == kind
    assert bars.covariance.degrees == degrees
    assert "2 times as large" in bars.reason


def test_residuals_that_lean_the_same_way_over_blocks_contradict_the_model() -> None:
    bars = error_bars(solved(balanced(40, spread=3.0)), source(10, 4))
    assert bars.correlation == pytest.approx(9)
    assert not bars.holds
    assert "lean the same way" in bars.reason
    assert "3 times as much as by chance" in bars.reason


def test_an_unknown_that_the_data_push_against_its_bound_is_left_out() -> None:
    pushing = torch.tensor([[0.0, -5.0]]).expand(6, 2)
    bars = error_bars(solved(pushing, at=(0.5, 0.0)), source(6))
    assert bars.bound.tolist() == [False, True]
    assert bars.covariance.std.tolist() == pytest.approx([600**-0.5, 0.0])
    # How far inside the truth may lie is known all the same.
    assert bars.open.std.tolist() == pytest.approx([600**-0.5, 150**-0.5])


def test_an_unknown_at_a_bound_that_the_data_do_not_push_counts_as_free() -> None:
    bars = error_bars(solved(balanced(6), at=(0.5, 0.0)), source(6))
    assert bars.bound.tolist() == [False, False]


def test_a_jackknife_respects_bounds_and_its_open_twin_does_not() -> None:
    gradients = balanced(6, spread=2.0) + torch.tensor([0.0, -5.0])
    bars = error_bars(solved(gradients, chi2=4.0, at=(0.5, 0.0)), source(6))
    assert bars.kind == "jackknife over images"
    assert float(bars.covariance.std[1]) == 0
    assert float(bars.open.std[1]) > 0


def test_error_bars_of_noise_alone_are_not_widened_and_jackknifed_ones_are() -> None:
    assert error_bars(solved(balanced(6)), source(6)).largest_widening == 1
    missed = judged(Studio(size=24).photograph(CookTorrance(0.4, 0.8, 0.2), 0), "lambert").posterior.bars
    assert missed.kind == "jackknife over images"
    assert missed.largest_widening > 1.2


def test_what_is_expected_of_samples_is_what_samples_that_hold_the_model_give() -> None:
    solution = solved(balanced(6))
    expected, found = expected_error_bars(Expansion.of(solution)), error_bars(solution, source(6))
    assert torch.equal(expected.covariance.matrix, found.covariance.matrix)
    assert (expected.holds, expected.kind, expected.chi2) == (found.holds, found.kind, 1.0)
