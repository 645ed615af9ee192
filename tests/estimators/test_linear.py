"""Amplitudes in closed form, against other solvers of the same small problems."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import torch
from scipy.optimize import lsq_linear, nnls
from torch import Tensor

from matest.brdf.terms import Factor
from matest.estimators import Problem
from matest.estimators.linear import amplitudes
from tests.problems import problem

# Both solve the same normal equations in double precision; forming them squares the condition number.
AMPLITUDE = 1e-7
# Spacing of the dense grid that a product of amplitudes is compared with.
GRID = 1e-4

THREE = [(Factor(name),) for name in ("lambert.albedo", "torrance-sparrow.specular", "cook-torrance.specular")]
BODY_AND_LOBE = THREE[:2]
FACETS = [(Factor("albedo"),), (Factor("albedo"), Factor("albedo"), Factor("interreflection"))]


def design(columns: int, seed: int, *, positive: bool) -> tuple[np.ndarray, np.ndarray]:
    """Images of unit shapes [40, K], and measurements [40] that may ask for amplitudes outside [0, 1]."""
    rng = np.random.default_rng(seed)
    shapes = rng.random((40, columns)) if positive else rng.standard_normal((40, columns))
    truth = rng.uniform(-0.7, 1.7, columns)
    return shapes, shapes @ truth + 0.05 * rng.standard_normal(40)


def normal_equations(shapes: np.ndarray, measured: np.ndarray) -> tuple[Tensor, Tensor]:
    return torch.from_numpy(shapes.T @ shapes)[None, None], torch.from_numpy(shapes.T @ measured)[None, None]


def squares(shapes: np.ndarray, measured: np.ndarray, coefficients: np.ndarray) -> float:
    """Cost up to the constant that `amplitudes` leaves out."""
    return float(np.sum((measured - shapes @ coefficients) ** 2) - measured @ measured)


def sum_of_three(*, relative: bool) -> Problem:
    return problem("lambert+torrance-sparrow+cook-torrance", relative=relative)


@pytest.mark.parametrize("positive", [True, False])
@pytest.mark.parametrize("seed", range(30))
def test_two_amplitudes_are_the_bounded_least_squares_solution(seed: int, positive: bool) -> None:
    shapes, measured = design(2, seed, positive=positive)
    chosen = problem("lambert+torrance-sparrow")
    found, cost = amplitudes(chosen, BODY_AND_LOBE, *normal_equations(shapes, measured), {})
    expected = lsq_linear(shapes, measured, (0, 1), tol=1e-14).x
    np.testing.assert_allclose(found[0, 0], expected, atol=AMPLITUDE)
    assert float(cost[0]) == pytest.approx(squares(shapes, measured, expected), abs=AMPLITUDE)


@pytest.mark.parametrize("positive", [True, False])
@pytest.mark.parametrize("seed", range(30))
def test_three_amplitudes_are_the_bounded_least_squares_solution(seed: int, positive: bool) -> None:
    shapes, measured = design(3, seed, positive=positive)
    found, _ = amplitudes(sum_of_three(relative=False), THREE, *normal_equations(shapes, measured), {})
    np.testing.assert_allclose(found[0, 0], lsq_linear(shapes, measured, (0, 1), tol=1e-14).x, atol=AMPLITUDE)


@pytest.mark.parametrize("seed", range(30))
def test_amplitudes_under_relative_radiometry_are_the_non_negative_solution(seed: int) -> None:
    shapes, measured = design(3, seed, positive=True)
    found, _ = amplitudes(sum_of_three(relative=True), THREE, *normal_equations(shapes, 5 * measured), {})
    np.testing.assert_allclose(found[0, 0], nnls(shapes, 5 * measured)[0], atol=5 * AMPLITUDE)


@pytest.mark.parametrize("seed", range(10))
def test_amplitudes_of_nearly_equal_shapes_fit_as_well_as_any(seed: int) -> None:
    shapes, measured = design(2, seed, positive=True)
    shapes[:, 1] = shapes[:, 0] + 1e-4 * shapes[:, 1]
    found, cost = amplitudes(
        problem("lambert+torrance-sparrow"), BODY_AND_LOBE, *normal_equations(shapes, measured), {}
    )
    best = squares(shapes, measured, lsq_linear(shapes, measured, (0, 1), tol=1e-14).x)
    assert bool(((found >= 0) & (found <= 1)).all())
    assert float(cost[0]) == pytest.approx(best, abs=1e-6)


@pytest.mark.parametrize("share", [0.02, 0.2, 1.0])
@pytest.mark.parametrize("truth", [0.0, 0.05, 0.4, 0.9, 1.0, 1.3])
def test_an_albedo_and_its_square_are_solved_as_a_dense_grid_does(truth: float, share: float) -> None:
    rng = np.random.default_rng(7)
    shapes = rng.random((40, 2)) * [1, share]
    measured = shapes @ [truth, truth**2] + 0.02 * rng.standard_normal(40)
    chosen = problem("oren-nayar")
    found, cost = amplitudes(chosen, FACETS, *normal_equations(shapes, measured), {})
    grid = np.arange(0, 1 + GRID / 2, GRID)
    costs = [squares(shapes, measured, np.array([rho, rho**2])) for rho in grid]
    assert float(found[0, 0, 0]) == pytest.approx(grid[int(np.argmin(costs))], abs=GRID)
    assert float(cost[0]) <= min(costs) + 1e-12


def test_the_strength_of_the_square_is_respected() -> None:
    shapes, _ = design(2, 3, positive=True)
    for strength in (0.0, 0.5, 2.0):
        measured = shapes @ [0.4, strength * 0.4**2]
        chosen = problem("oren-nayar", fix={"interreflection": strength})
        found, _ = amplitudes(chosen, FACETS, *normal_equations(shapes, measured), {})
        assert float(found) == pytest.approx(0.4, abs=AMPLITUDE)


def test_a_gauge_is_taken_as_given_and_not_solved_for() -> None:
    shapes, _ = design(2, 4, positive=True)
    measured = shapes @ [3.0, 0.2 * 9.0]
    chosen = problem("oren-nayar", relative=True)
    gauges = {"interreflection": torch.tensor([[0.2], [0.0]], dtype=torch.float64)}
    gram, moment = (part.expand(2, *part.shape[1:]) for part in normal_equations(shapes, measured))
    found, cost = amplitudes(chosen, FACETS, gram, moment, gauges)
    assert found.shape == (2, 1, 1)
    assert float(found[0]) == pytest.approx(3.0, abs=AMPLITUDE)
    assert float(found[1]) == pytest.approx(float(shapes[:, 0] @ measured / (shapes[:, 0] @ shapes[:, 0])))
    assert cost[0] < cost[1]


def test_a_fixed_amplitude_keeps_its_value_while_the_other_is_solved() -> None:
    shapes, _ = design(2, 5, positive=True)
    measured = shapes @ [0.3, 0.6]
    chosen = problem("lambert+torrance-sparrow", fix={"specular": 0.6})
    found, _ = amplitudes(chosen, BODY_AND_LOBE, *normal_equations(shapes, measured), {})
    assert found[0, 0].tolist() == pytest.approx([0.3], abs=AMPLITUDE)


def test_tied_amplitudes_are_one_unknown() -> None:
    shapes, measured = design(2, 6, positive=True)
    chosen = problem("lambert+torrance-sparrow", tie={"torrance-sparrow.specular": "lambert.albedo"})
    found, _ = amplitudes(chosen, BODY_AND_LOBE, *normal_equations(shapes, measured), {})
    expected = lsq_linear(shapes.sum(1, keepdims=True), measured, (0, 1), tol=1e-14).x
    np.testing.assert_allclose(found[0, 0], expected, atol=AMPLITUDE)


def test_many_problems_and_channels_at_once_are_solved_like_one_at_a_time() -> None:
    chosen = problem("lambert+torrance-sparrow", channels=2)
    parts = {
        (node, channel): normal_equations(*design(2, 10 * node + channel, positive=False))
        for node, channel in itertools.product(range(5), range(2))
    }
    gram = torch.stack([torch.cat([parts[node, channel][0][0] for channel in range(2)]) for node in range(5)])
    moment = torch.stack([torch.cat([parts[node, channel][1][0] for channel in range(2)]) for node in range(5)])
    found, cost = amplitudes(chosen, BODY_AND_LOBE, gram, moment, {})
    assert found.shape == (5, 2, 2)
    for node in range(5):
        alone = [amplitudes(chosen, BODY_AND_LOBE, *parts[node, channel], {}) for channel in range(2)]
        torch.testing.assert_close(found[node], torch.cat([a[0] for a, _ in alone]), rtol=0, atol=AMPLITUDE)
        torch.testing.assert_close(cost[node], sum(c[0] for _, c in alone), rtol=1e-9, atol=AMPLITUDE)


def test_a_shape_that_no_sample_sees_leaves_finite_amplitudes() -> None:
    shapes, _ = design(2, 8, positive=True)
    shapes[:, 1] = 0
    measured = 0.4 * shapes[:, 0]
    found, cost = amplitudes(
        problem("lambert+torrance-sparrow"), BODY_AND_LOBE, *normal_equations(shapes, measured), {}
    )
    assert bool(torch.isfinite(found).all())
    assert bool(torch.isfinite(cost).all())
    assert float(found[0, 0, 0]) == pytest.approx(0.4, abs=AMPLITUDE)


def test_without_amplitudes_the_cost_is_that_of_the_fixed_model() -> None:
    shapes, measured = design(1, 9, positive=True)
    found, cost = amplitudes(
        problem("lambert", fix={"albedo": 0.3}), FACETS[:1], *normal_equations(shapes, measured), {}
    )
    assert found.shape == (1, 1, 0)
    assert float(cost[0]) == pytest.approx(squares(shapes, measured, np.array([0.3])))
