"""Error bars: which kind, and what is left out of them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

import matest
from matest.brdf import CookTorrance, Lambert
from matest.estimators import Solution, Statistics
from matest.estimators.moments import scores
from matest.inference.error_bars import error_bars, expected_error_bars
from matest.inference.expansion import Expansion
from matest.samples import Groups
from tests.inference.judged import Source, judged, solved, source
from tests.problems import problem
from tests.simulated import Studio, coloured


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


def test_after_a_cost_that_is_no_likelihood_error_bars_come_from_leaving_out_groups() -> None:
    bars = error_bars(solved(balanced(6, 0.5)), source(6), likelihood=False)
    assert bars.kind == "jackknife over images"
    assert bars.covariance.degrees == 5


def test_stated_noise_is_exact_and_estimated_noise_is_not() -> None:
    solution = solved(balanced(6), chi2=1.06)
    assert not error_bars(solution, source(6, noise_stated=True)).holds
    assert error_bars(solution, source(6, noise_stated=False)).holds


@pytest.mark.parametrize(
    ("lights", "repeats", "kind"), [(4, 3, "jackknife over lights"), (2, 3, "jackknife over blocks")]
)
def test_repeated_photographs_do_not_shrink_the_error_bar_of_a_misfit(lights: int, repeats: int, kind: str) -> None:
    misfit = balanced(4 * lights)
    once = error_bars(solved(misfit, chi2=4.0), source(lights, 4))
    groups = Groups(torch.arange(lights * repeats).repeat_interleave(4), torch.arange(lights).repeat(repeats))
    again = error_bars(solved(misfit.repeat(repeats, 1), chi2=4.0), Source(noise_stated=True, groups=groups))
    assert once.kind == kind.replace("lights", "images")
    assert again.kind == kind
    assert again.covariance.std.tolist() == pytest.approx(once.covariance.std.tolist())
    assert again.covariance.degrees == once.covariance.degrees


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


@pytest.mark.parametrize(("distance", "on_bound"), [(0.0, True), (0.04, True), (0.06, False)])
def test_a_value_lies_on_a_bound_within_the_digits_of_its_standard_error(distance: float, on_bound: bool) -> None:
    solution = solved(balanced(6))
    std = float(error_bars(solution, source(6)).covariance.std[0])
    near = replace(solution, unknowns=torch.tensor([1.0 - distance * std, 0.3], dtype=torch.float64))
    bars = error_bars(near, source(6))
    # Nothing pushes it outward: its error bar enters the others' as that of any other value.
    assert not bool(bars.bound.any())
    assert float(bars.covariance.std[0]) == pytest.approx(std)
    assert (float(bars.ends[0]) == 1.0) == on_bound
    assert math.isnan(float(bars.ends[1]))


def test_what_is_expected_of_samples_is_what_samples_that_hold_the_model_give() -> None:
    solution = solved(balanced(6))
    expected, found = expected_error_bars(Expansion.of(solution)), error_bars(solution, source(6))
    assert torch.equal(expected.covariance.matrix, found.covariance.matrix)
    assert (expected.holds, expected.kind, expected.chi2) == (found.holds, found.kind, 1.0)


def gauged(gauge: float, *, pushed: bool = False, weight: float = 1e-4, chi2: float = 4.0) -> Solution:
    """Oren-Nayar's albedo, sigma and gauge, the last one known to 1 / sqrt(6 · weight) and moving with the albedo."""
    columns = torch.tensor([[10.0, 0.0, weight**0.5 * 0.9], [0.0, 5.0, 0.0], [0.0, 0.0, weight**0.5]]).double()
    informations = (columns.T @ columns).expand(6, 3, 3)
    spread = 0.1 * chi2 * torch.tensor([3.0, -3.0, 2.0, -2.0, 1.0, -1.0]).double()
    gradients = spread[:, None] * torch.tensor([10.0, 5.0, 0.0])
    gradients = gradients + (torch.tensor([0.0, 0.0, weight**0.5]) if pushed else 0.0)
    row = scores(cost=chi2 * 1e4, chi2=chi2 * 1e4, values=1e4, samples=1e4, squared_signal=1.0)
    statistics = Statistics(torch.arange(6), informations, gradients, row.expand(6, -1))
    relative = problem("oren-nayar", relative=True).limited(2.0)
    return Solution(relative, torch.tensor([0.5, 0.3, gauge]).double(), statistics, 1, 0.0, True)


@pytest.mark.parametrize("chi2", [1.0, 4.0])
def test_a_gauge_enters_error_bars_alike_at_its_bound_and_near_it(chi2: float) -> None:
    at, near = (
        error_bars(gauged(2.0, pushed=True, chi2=chi2), source(6)),
        error_bars(gauged(1.99, chi2=chi2), source(6)),
    )
    assert at.kind == near.kind
    assert at.bound.tolist() == [False, False, True]
    torch.testing.assert_close(at.covariance.std[:2], near.covariance.std[:2], rtol=0.02, atol=0)


@pytest.mark.parametrize("chi2", [1.0, 4.0])
def test_what_is_not_known_of_a_gauge_is_no_more_than_its_domain(chi2: float) -> None:
    known, unknown = (error_bars(gauged(1.0, weight=w, chi2=chi2), source(6)).covariance.std for w in (1e-4, 1e-12))
    # In the middle of a domain of width 2.
    assert float(unknown[2]) == pytest.approx(2 / math.sqrt(12), rel=1e-6)
    # Nothing hangs on a gauge without effect.
    without = error_bars(gauged(1.0, weight=0.0, chi2=chi2), source(6))
    torch.testing.assert_close(unknown[:2], without.covariance.std[:2], rtol=1e-4, atol=0)
    assert without.covariance.undetermined.tolist() == [False, False, False]
    assert float(known[0]) < 1.01 * float(unknown[0])


def test_a_gauge_that_the_data_tell_enters_with_what_they_tell() -> None:
    bars = error_bars(gauged(1.0, weight=1e6, chi2=1.0), source(6))
    matrix = torch.linalg.inv(gauged(1.0, weight=1e6, chi2=1.0).statistics.information)
    torch.testing.assert_close(bars.covariance.matrix, matrix, rtol=1e-5, atol=1e-15)


def test_the_domain_of_a_gauge_does_not_hide_how_little_samples_are_to_be_trusted() -> None:
    # By their information they tell the gauge to 0.04, by how much single images move it to more than its domain.
    solution = gauged(2.0, weight=400.0)
    spread = 300.0 * torch.tensor([3.0, -3.0, 2.0, -2.0, 1.0, -1.0]).double()
    statistics = replace(solution.statistics, gradients=spread[:, None] * torch.tensor([10.0, 0.0, 20.0]))
    bars = error_bars(replace(solution, statistics=statistics), source(6))
    assert bars.kind == "jackknife over images"
    assert float(bars.open.std[2]) < 2 / math.sqrt(3)
    assert float(bars.widening[2]) * (4 / 6 / 400) ** 0.5 > 2 / math.sqrt(3)


def test_what_parts_of_the_object_have_in_common_in_all_images_widens_error_bars() -> None:
    """An albedo that varies is in every image alike: images left out do not show it."""
    material, studio = Lambert([0.7, 0.5, 0.3]), Studio(size=64, lights=coloured())
    radiance = studio.clean(material)
    columns = studio.scene.surface.pixels % studio.size
    halves = np.where(columns < studio.size / 2, 0.9, 1.1)[None, :, None]
    albedo = matest.estimate(studio.expose(radiance * halves, 1), "lambert").parameters["albedo"]
    # Four columns of blocks whose factors are 0.9 or 1.1: their mean has a standard error of 0.1 / √4, of which what
    # chance may bring is left away.
    relative = [std / value for std, value in zip(albedo.std, [0.7, 0.5, 0.3], strict=True)]
    assert all(0.025 < std < 0.08 for std in relative)
    assert all(low < value < high for value, (low, high) in zip([0.7, 0.5, 0.3], albedo.interval95, strict=True))
