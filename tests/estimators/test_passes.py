"""One walk over the samples of a separable model gives what a pass at every parameter value would."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from matest.estimators.passes import accumulate, compress, statistics_at
from matest.estimators.search import _from_samples, normal_equations
from matest.estimators.unknowns import Problem
from matest.samples import Batch
from matest.samples.likelihood import MeasurementNoise, Readout
from matest.samples.tiles import in_memory
from matest.scene import Points
from matest.shading import lit_directions
from tests.estimators.test_basis import assert_same, samples, tiled, whole
from tests.problems import ordinary, problem
from tests.sampling import random_pairs

COMMON_SIGMA = {"fujii.sigma": "oren-nayar.sigma"}
SEPARABLE = [
    problem("lambert", channels=3),
    problem("oren-nayar", channels=3),
    problem("oren-nayar", channels=3, relative=True),
    problem("oren-nayar", channels=3, fix={"sigma": 0.4}),
    problem("oren-nayar-qualitative", channels=3),
    problem("fujii", channels=3),
    problem("oren-nayar+fujii", channels=3, tie=COMMON_SIGMA),
    problem("lambert+oren-nayar", channels=3),
    problem("cook-torrance", channels=3, fix={"slope": 0.2}),
]
NAMES = [chosen.brdf.expression + f" of {','.join(chosen.free)}" for chosen in SEPARABLE]


def moved(unknowns: torch.Tensor) -> torch.Tensor:
    return unknowns * 1.05


@pytest.mark.parametrize("ambient", [0.0, 0.3])
@pytest.mark.parametrize("chosen", SEPARABLE, ids=NAMES)
def test_statistics_are_those_of_a_pass(chosen: Problem, ambient: float) -> None:
    assert chosen.separates
    unknowns, reference = ordinary(chosen, seed=1), ordinary(chosen, seed=2)
    tiles = tiled(samples(ambient), 100)
    compressed = compress(chosen, tiles, unknowns, reference)
    for at in (unknowns, moved(unknowns)):
        assert_same(
            statistics_at(chosen, compressed, at), accumulate(chosen, at, tiles, reference), residual=at is unknowns
        )


def test_the_integral_separates_into_its_slope_nodes() -> None:
    chosen = problem("oren-nayar-exact(nodes=16x16)", channels=3)
    assert chosen.separates
    unknowns = ordinary(chosen, seed=3)
    tiles = tiled(samples(), 1000)
    compressed = compress(chosen, tiles, unknowns, None)
    assert compressed.origin.shape == (3, 16 + 12)
    for at in (unknowns, moved(unknowns)):
        assert_same(statistics_at(chosen, compressed, at), accumulate(chosen, at, tiles, None), residual=at is unknowns)


def test_residuals_from_the_measured_radiance_give_the_same_statistics() -> None:
    chosen = problem("fujii", channels=3)
    unknowns = ordinary(chosen, seed=4)
    tiles = tiled(samples(), 1000)
    found = statistics_at(chosen, compress(chosen, tiles, None, None), unknowns)
    assert_same(found, accumulate(chosen, unknowns, tiles, None), residual=False)


def test_light_whose_fitted_reflectance_is_negative_gives_nothing() -> None:
    # Mirror directions up to 89 degrees: there eq. 14 turns negative.
    wi, wo = random_pairs(400, seed=5)
    one = torch.ones(1, 1, dtype=torch.float64)
    batch = Batch(Points(wi[:, None], wo, one[None]), 0.1 * wi[:, 2:], MeasurementNoise(Readout(1e-4 * one, 0 * one)))
    chosen = problem("oren-nayar")
    unknowns = torch.tensor([0.02, 1.3], dtype=torch.float64)
    terms = chosen.material(unknowns).terms(lit_directions(batch.points))
    assert (0.02 * terms[0].shape + 0.02**2 * terms[1].shape < 0).any()
    found = statistics_at(chosen, compress(chosen, in_memory([batch]), unknowns, None), unknowns)
    assert_same(found, accumulate(chosen, unknowns, in_memory([batch]), None))


@pytest.mark.parametrize(
    "expression", ["cook-torrance", "oren-nayar+torrance-sparrow", "eon", "oren-nayar-single-slope"]
)
def test_models_with_lobes_of_estimated_width_do_not_separate(expression: str) -> None:
    assert not problem(expression, channels=3).separates


def test_a_fixed_shape_with_a_value_per_channel_does_not_separate() -> None:
    chosen = problem("cook-torrance", channels=3, fix={"slope": 0.2, "f0": (0.3, 0.4, 0.5)})
    assert not chosen.separates


@pytest.mark.parametrize("expression", ["oren-nayar", "fujii", "lambert"])
def test_the_grid_of_the_search_is_the_same_either_way(expression: str) -> None:
    chosen = problem(expression, channels=3)
    points = [ordinary(chosen, seed) for seed in range(4)]
    batches = [whole(samples(0.2))]
    both = (grid(chosen, batches, points, None) for grid in (normal_equations, _from_samples))
    for found, expected in zip(*both, strict=True):
        if isinstance(found, torch.Tensor):
            torch.testing.assert_close(found, expected, rtol=1e-10, atol=1e-10 * float(expected.abs().max()))
        else:
            assert found == expected


@pytest.mark.parametrize("expression", ["oren-nayar", "cook-torrance"])
def test_a_tile_without_samples_adds_nothing(expression: str) -> None:
    chosen = problem(expression, channels=3)
    unknowns, batch = ordinary(chosen, seed=1), whole(samples())
    both, alone = (accumulate(chosen, unknowns, in_memory(some), unknowns) for some in ([batch, batch[:0]], [batch]))
    assert_same(both, alone)
    nothing = accumulate(chosen, unknowns, in_memory([batch[:0]]), unknowns)
    assert nothing.total("samples") == 0


@pytest.mark.parametrize("expression", ["oren-nayar", "cook-torrance"])
def test_samples_under_the_sky_alone_are_those_of_a_light_without_power(expression: str) -> None:
    chosen = problem(expression, channels=3)
    unknowns, batch = ordinary(chosen, seed=1), whole(samples(0.3))
    points = batch.points
    dark = replace(batch, points=replace(points, irradiance=torch.zeros_like(points.irradiance)))
    sky = replace(batch, points=replace(points, wi=points.wi[:, :0], irradiance=points.irradiance[:, :0]))
    found, expected = (accumulate(chosen, unknowns, in_memory([one]), unknowns) for one in (sky, dark))
    assert_same(found, expected)
