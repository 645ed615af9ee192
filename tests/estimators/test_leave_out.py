"""The error at samples left out of a fit, from the sums of a single one."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from matest.brdf import Brdf, CookTorrance, OrenNayar
from matest.estimation.options import Options
from matest.estimation.specification import specify_unknowns
from matest.estimators import Problem
from matest.estimators.leave_out import LeftOut, leave_out
from matest.estimators.levenberg_marquardt import minimise
from matest.estimators.passes import passes_over, radiance_model
from matest.samples import Batch, Tile
from matest.samples.batch import join
from matest.samples.residual_scale import NOISE_ALONE, ResidualScale
from matest.samples.tiles import in_memory
from tests.simulated import Studio

TRUTH: dict[str, Brdf] = {"oren-nayar": OrenNayar(0.7, 0.5), "cook-torrance": CookTorrance(0.3, 0.8, 0.25)}


def parts_of(material: Brdf) -> list[Batch]:
    parts = Studio(size=48).photograph(material, seed=1).samples().pilot(3000, 0)
    return [replace(part, groups=torch.full((len(part),), k)) for k, part in enumerate(parts)]


def fitted(
    expression: str, parts: list[Batch], residual_scale: ResidualScale = NOISE_ALONE
) -> tuple[Problem, Tile, LeftOut]:
    problem = specify_unknowns(expression, Options(), channels=1, relative=False).problem
    tile = Tile(join(parts), cache={})
    truth = problem.unknowns_at(TRUTH[expression].parameters)
    reference = radiance_model(problem, truth)(tile)
    tile = replace(tile, least_squares=tile.about(reference, residual_scale))
    return problem, tile, leave_out(problem, tile, 1.05 * truth, residual_scale, len(parts))


@pytest.mark.parametrize("expression", TRUTH)
def test_leaving_out_by_subtraction_is_leaving_out_by_a_fit(expression: str) -> None:
    parts = parts_of(TRUTH[expression])
    problem, tile, left_out = fitted(expression, parts)
    assert tile.least_squares is not None
    start = 0
    for k, part in enumerate(parts):
        rows = slice(start, start + len(part))
        start += len(part)
        others = torch.ones(len(tile), dtype=torch.bool)
        others[rows] = False
        squares = tile.least_squares._replace(weight=tile.least_squares.weight * others[:, None])
        remaining = replace(tile, least_squares=squares, cache=None)
        evaluate = passes_over(problem, in_memory([remaining]), left_out.unknowns, None, NOISE_ALONE)
        unknowns = minimise(problem, left_out.unknowns, evaluate, passes=30, tolerance=1e-3).unknowns
        residual = tile.least_squares.response[rows] - radiance_model(problem, unknowns)(Tile(part)).detach()
        expected = float((tile.least_squares.weight[rows] * residual.square()).sum())
        assert float(left_out.costs[k]) == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("expression", TRUTH)
def test_parts_left_out_of_a_model_that_holds_are_met_to_the_noise(expression: str) -> None:
    parts = parts_of(TRUTH[expression])
    _, tile, left_out = fitted(expression, parts)
    assert float(left_out.costs.sum()) > left_out.cost
    assert float(left_out.costs.sum()) / tile.batch.radiance.numel() == pytest.approx(1, abs=0.1)


def test_the_relative_error_is_that_of_each_part_without_it() -> None:
    parts = parts_of(TRUTH["oren-nayar"])
    problem, tile, left_out = fitted("oren-nayar", parts)
    residual, signal = 0.0, 0.0
    for k, part in enumerate(parts):
        radiance = radiance_model(problem, left_out.unknowns + left_out.moves[k])(Tile(part)).detach()
        residual += float((part.radiance - radiance).double().square().sum())
        signal += float(part.radiance.double().square().sum())
    assert left_out.relative_rmse(tile.batch) == pytest.approx((residual / signal) ** 0.5, rel=1e-4)


def test_without_refinement_the_fit_stays_at_its_start() -> None:
    parts = parts_of(TRUTH["oren-nayar"])
    problem, tile, left_out = fitted("oren-nayar", parts)
    rough = leave_out(problem, tile, 1.05 * left_out.unknowns, NOISE_ALONE, len(parts), refine=False)
    torch.testing.assert_close(rough.unknowns, 1.05 * left_out.unknowns)
    assert rough.cost > left_out.cost


def test_a_fit_that_misses_by_far_ends_within_a_tenth_of_a_per_cent_of_its_least_cost() -> None:
    parts = parts_of(TRUTH["cook-torrance"])
    # Twice the light that is stated, in one image.
    parts[0] = replace(parts[0], radiance=2 * parts[0].radiance)
    problem, tile, left_out = fitted("cook-torrance", parts, residual_scale=ResidualScale.uniform(100.0))
    evaluate = passes_over(problem, in_memory([tile]), left_out.unknowns, None, ResidualScale.uniform(100.0))
    least = minimise(problem, left_out.unknowns, evaluate, passes=60, tolerance=1e-3).statistics.cost
    assert left_out.reduced_chi2 > 10
    assert least <= left_out.cost < 1.001 * least


def test_a_fit_that_holds_ends_closer_to_its_least_cost_than_noise_shows() -> None:
    parts = parts_of(TRUTH["cook-torrance"])
    problem, tile, left_out = fitted("cook-torrance", parts)
    evaluate = passes_over(problem, in_memory([tile]), left_out.unknowns, None, NOISE_ALONE)
    least = minimise(problem, left_out.unknowns, evaluate, passes=60, tolerance=1e-4).statistics.cost
    assert left_out.cost < least + 0.05
