"""Error bars: against linear algebra, textbook formulas and repeated experiments."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.stats import t
from torch import Tensor

from matest.brdf import Lambert, OrenNayar
from matest.estimation.estimate import estimate
from matest.estimators.covariance import (
    Covariance,
    correlation_of_residuals,
    error_of,
    fisher,
    jackknife,
    quantile95,
    weak_directions,
)
from matest.estimators.moments import SCORES
from matest.estimators.statistics import Statistics
from tests.captures import directional
from tests.inference.judged import judged
from tests.problems import information
from tests.simulated import DIRECTIONS, Studio

DOUBLE = torch.float64


def everything(size: int) -> Tensor:
    return torch.ones(size, dtype=torch.bool)


def unbounded(matrix: Tensor, gradient: Tensor) -> Tensor:
    return torch.linalg.solve(matrix, gradient)


@pytest.mark.parametrize("seed", range(5))
def test_fisher_is_the_inverse(seed: int) -> None:
    matrix = information(6, seed)
    covariance = fisher(matrix, everything(6))
    expected = np.linalg.inv(matrix.numpy())
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        covariance.matrix.numpy() / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-10
    )
    np.testing.assert_allclose(covariance.std.numpy(), scale, rtol=1e-9)
    assert not bool(covariance.undetermined.any())
    assert math.isinf(covariance.degrees)


def test_weak_directions_name_who_takes_part() -> None:
    # Of the first two unknowns only the difference is well known.
    matrix = torch.tensor([[1.0, -0.9999, 0.0], [-0.9999, 1.0, 0.0], [0.0, 0.0, 4.0]], dtype=DOUBLE)
    (shares,) = weak_directions(matrix)
    assert shares.tolist() == pytest.approx([math.sqrt(0.5), math.sqrt(0.5), 0.0], abs=1e-9)


def test_parameters_at_a_bound_are_left_out_of_the_inverse() -> None:
    matrix = information(4, 1)
    free = torch.tensor([True, False, True, True])
    covariance = fisher(matrix, free)
    inside = [0, 2, 3]
    expected = np.linalg.inv(matrix.numpy()[np.ix_(inside, inside)])
    np.testing.assert_allclose(covariance.matrix.numpy()[np.ix_(inside, inside)], expected, rtol=1e-8)
    assert not bool(covariance.matrix[1].any())
    assert not bool(covariance.matrix[:, 1].any())
    assert not bool(covariance.undetermined.any())


def test_correlation_has_ones_on_its_diagonal() -> None:
    covariance = fisher(information(4, 2), torch.tensor([True, True, False, True]))
    correlation = covariance.correlation
    assert correlation.diagonal().tolist() == pytest.approx([1, 1, 0, 1])
    expected = covariance.matrix[0, 3] / (covariance.std[0] * covariance.std[3])
    assert float(correlation[0, 3]) == pytest.approx(float(expected))


def test_two_parameters_of_which_only_the_sum_is_seen_are_undetermined() -> None:
    rng = np.random.default_rng(3)
    columns = rng.standard_normal((50, 2))
    jacobian = torch.from_numpy(np.stack([columns[:, 0], columns[:, 0], columns[:, 1]], axis=1))
    covariance = fisher(jacobian.T @ jacobian, everything(3))
    assert covariance.undetermined.tolist() == [True, True, False]
    assert not bool(covariance.matrix[:2].any())
    alone = np.linalg.inv(columns.T @ columns)[1, 1]
    assert float(covariance.matrix[2, 2]) == pytest.approx(alone, rel=1e-6)


def test_a_parameter_without_any_influence_is_undetermined() -> None:
    matrix = information(3, 4)
    matrix[1] = matrix[:, 1] = 0
    covariance = fisher(matrix, everything(3))
    assert covariance.undetermined.tolist() == [False, True, False]
    assert bool(torch.isfinite(covariance.matrix).all())


@pytest.mark.parametrize("rest", [1e-18, -1e-18])
def test_what_rounding_leaves_of_a_parameter_without_influence_hides_nothing(rest: float) -> None:
    # Two such parameters, whose common element would count as ±∞ in units of their own.
    matrix = torch.diag(torch.tensor([3e7, 0.0, 0.0], dtype=DOUBLE))
    matrix[1, 2] = matrix[2, 1] = rest
    covariance = fisher(matrix, everything(3))
    assert covariance.undetermined.tolist() == [False, True, True]
    assert float(covariance.std[0]) == pytest.approx(3e7**-0.5)
    direction = torch.tensor([1.0, 0.0, 0.0], dtype=DOUBLE)
    assert error_of(matrix, direction) == pytest.approx(3e7**-0.5)
    assert error_of(matrix, torch.tensor([0.0, 1.0, 0.0], dtype=DOUBLE)) is None
    # Whatever the units of the rest.
    assert fisher(torch.diag(torch.tensor([1e24, 1e-7], dtype=DOUBLE)), everything(2)).undetermined.tolist() == [
        False,
        True,
    ]


def test_an_undetermined_direction_hides_nothing_that_is_determined() -> None:
    # Only the sum of the first two is seen; the third is measured beside it.
    matrix = torch.tensor([[2.0, 2.0, 0.3], [2.0, 2.0, 0.3], [0.3, 0.3, 1.0]], dtype=DOUBLE)
    covariance = fisher(matrix, everything(3))
    assert covariance.undetermined.tolist() == [True, True, False]
    assert float(covariance.matrix[2, 2]) == pytest.approx(1 / (1 - 0.09 / 2), rel=1e-9)


def test_nothing_free_has_no_covariance() -> None:
    covariance = fisher(information(3, 5), ~everything(3))
    assert not bool(covariance.matrix.any())
    assert not bool(covariance.undetermined.any())


def groups(informations: Tensor, gradients: Tensor) -> Statistics:
    count = len(informations)
    return Statistics(torch.arange(count), informations, gradients, torch.zeros(count, len(SCORES), dtype=DOUBLE))


def test_jackknife_of_a_mean_is_the_textbook_formula() -> None:
    values = torch.from_numpy(np.random.default_rng(6).normal(3.0, 2.0, 9))
    offsets = values - values.mean()
    covariance = jackknife(groups(torch.ones(9, 1, 1, dtype=DOUBLE), offsets[:, None]), everything(1), unbounded)
    assert float(covariance.std) == pytest.approx(float(values.std(unbiased=True)) / 3)
    assert covariance.degrees == 8


def test_jackknife_of_a_regression_leaves_out_one_cluster_at_a_time() -> None:
    rng = np.random.default_rng(7)
    designs = rng.standard_normal((6, 20, 2))
    targets = designs @ [1.0, -2.0] + rng.standard_normal((6, 20)) + rng.standard_normal((6, 1))
    solve = [
        np.linalg.lstsq(np.concatenate(np.delete(designs, k, 0)), np.concatenate(np.delete(targets, k, 0)))[0]
        for k in range(6)
    ]
    whole = np.linalg.lstsq(np.concatenate(designs), np.concatenate(targets))[0]
    informations = torch.stack([torch.from_numpy(x.T @ x) for x in designs])
    gradients = torch.stack([torch.from_numpy(x.T @ (y - x @ whole)) for x, y in zip(designs, targets, strict=True)])
    covariance = jackknife(groups(informations, gradients), everything(2), unbounded)
    moved = np.array(solve) - np.mean(solve, axis=0)
    np.testing.assert_allclose(covariance.matrix.numpy(), 5 / 6 * moved.T @ moved, rtol=1e-9)


def test_jackknife_keeps_parameters_at_a_bound_and_undetermined_ones_out() -> None:
    rng = np.random.default_rng(8)
    informations, gradients = [], []
    for _ in range(5):
        x = torch.from_numpy(rng.standard_normal((10, 4)))
        x[:, 2] = x[:, 1]
        informations.append(x.T @ x)
        gradients.append(torch.from_numpy(rng.standard_normal(4)))
    free = torch.tensor([True, True, True, False])
    covariance = jackknife(
        groups(torch.stack(informations), torch.stack(gradients)),
        free,
        lambda m, g: torch.linalg.lstsq(m, g[:, None]).solution[:, 0],
    )
    assert covariance.undetermined.tolist() == [False, True, True, False]
    assert (covariance.std > 0).tolist() == [True, False, False, False]


def test_independent_residuals_have_correlation_one() -> None:
    rng = np.random.default_rng(9)
    scores, informations = [], []
    for _ in range(400):
        x = rng.standard_normal((50, 3))
        scores.append(torch.from_numpy(x.T @ rng.standard_normal(50)))
        informations.append(torch.from_numpy(x.T @ x))
    found, by_chance = correlation_of_residuals(
        groups(torch.stack(informations), torch.stack(scores)), fisher(sum(informations), everything(3))
    )
    assert by_chance == pytest.approx(math.sqrt(2 / (400 * 3)), rel=0.05)
    assert found == pytest.approx(1, abs=3 * by_chance)


def test_the_correlation_of_few_blocks_scatters_as_much_as_it_says() -> None:
    rng = np.random.default_rng(12)
    blocks = [rng.standard_normal((size, 2)) for size in (400, 100, 30, 10)]
    informations = torch.stack([torch.from_numpy(x.T @ x) for x in blocks])
    covariance = fisher(informations.sum(0), everything(2))
    trials = []
    for _ in range(2000):
        scores = torch.stack([torch.from_numpy(x.T @ rng.standard_normal(len(x))) for x in blocks])
        found, by_chance = correlation_of_residuals(groups(informations, scores), covariance)
        trials.append(found)
    assert np.mean(trials) == pytest.approx(1, abs=0.08)
    assert np.std(trials) == pytest.approx(by_chance, rel=0.1)


def test_residuals_that_lean_one_way_over_a_cluster_have_a_large_correlation() -> None:
    rng = np.random.default_rng(10)
    scores, total = [], torch.zeros(1, 1, dtype=DOUBLE)
    for _ in range(100):
        # Half of the variance is common to the 50 values of a cluster: scores scatter (1 + 49/2) times as much.
        residuals = math.sqrt(0.5) * (rng.standard_normal(50) + rng.standard_normal())
        scores.append(torch.tensor([residuals.sum()]))
        total += 50
    informations = torch.full((100, 1, 1), 50.0, dtype=DOUBLE)
    found, by_chance = correlation_of_residuals(groups(informations, torch.stack(scores)), fisher(total, everything(1)))
    assert found == pytest.approx(25.5, rel=0.5)
    assert by_chance < 0.2


@pytest.mark.parametrize("seed", range(3))
def test_an_estimate_reports_what_is_judged(seed: int) -> None:
    """Of a capture that is right: so experiments repeated without a diagnosis tell of its error bars too."""
    capture = Studio(size=48, lights=((directional(DIRECTIONS[1], 3.0),),)).photograph(OrenNayar(0.6, 0.6), seed)
    expected = judged(capture, "oren-nayar").posterior.estimates
    for name, found in estimate(capture, "oren-nayar").parameters.items():
        assert (found.value, found.std, found.interval95) == (
            expected[name].value, expected[name].std, expected[name].interval95,
        ), name  # fmt: skip


def test_intervals_of_known_noise_are_normal() -> None:
    assert quantile95(math.inf) == pytest.approx(1.96, abs=1e-3)


@pytest.mark.parametrize("degrees", [1, 3, 11, 200])
def test_intervals_of_few_clusters_are_students(degrees: int) -> None:
    assert quantile95(degrees) == pytest.approx(t.ppf(0.975, degrees))


def test_std_of_a_rounded_negative_variance_is_zero() -> None:
    assert Covariance(torch.tensor([[-1e-20]]), torch.zeros(1, dtype=torch.bool)).std.tolist() == [0.0]


REPEATS = 201
# Channels whose noise is independent, as many experiments in one. A sigma is one for all channels.
CHANNELS = {"lambert": 3, "oren-nayar": 1}


def repeated(expression: str) -> tuple[dict[str, float], dict[str, np.ndarray]]:
    """True values, and per parameter an array [repeats, 4] of value, std and interval."""
    channels = CHANNELS[expression]
    material, direction = {
        "lambert": (Lambert(0.6), DIRECTIONS[0]), "oren-nayar": (OrenNayar(0.6, 0.6), DIRECTIONS[1]),
    }[expression]  # fmt: skip
    studio = Studio(size=48, lights=((directional(direction, *[3.0] * channels),),))
    clean = studio.clean(material)
    rows: dict[str, list[np.ndarray]] = {}
    for seed in range(REPEATS // channels):
        capture = studio.expose(clean, seed)
        # An albedo by all that a user gets; a second parameter by what its error bars come from.
        if expression == "lambert":
            found = estimate(capture, expression).parameters
        else:
            found = judged(capture, expression).posterior.estimates
        for name, parameter in found.items():
            assert parameter.status == "determined"
            intervals = np.reshape(parameter.interval95, (channels, 2)).T
            row = [np.ravel(parameter.value), np.ravel(parameter.std), *intervals]
            rows.setdefault(name, []).append(np.stack(row, axis=1))
    truth = {name: float(material.parameters[name]) for name in rows}
    return truth, {name: np.concatenate(row) for name, row in rows.items()}


@pytest.mark.parametrize("expression", CHANNELS)
def test_estimates_scatter_about_the_truth_as_their_error_bars_say(expression: str) -> None:
    truth, found = repeated(expression)
    for name, rows in found.items():
        value, std, low, high = rows.T
        assert len(value) == REPEATS
        ratio = value.std(ddof=1) / np.sqrt(np.mean(std**2))
        assert ratio == pytest.approx(1, abs=3 / math.sqrt(2 * (REPEATS - 1))), name
        standard_error = value.std(ddof=1) / math.sqrt(REPEATS)
        assert value.mean() == pytest.approx(truth[name], abs=3 * standard_error), name
        covered = ((low <= truth[name]) & (truth[name] <= high)).mean()
        assert 0.90 <= covered <= 0.99, name
