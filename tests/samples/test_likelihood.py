"""What a value says of the true radiance: measured, clipped, or an outlier."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from matest.samples import Batch, Tile
from matest.samples.batch import join
from matest.samples.likelihood import Comparison, Limits, MeasurementNoise, Readout, about, deviations
from matest.samples.residual_scale import ResidualScale
from matest.scene import Points

READ, GAIN = 0.02, 0.01
DOUBLE = torch.float64


def tile(radiance: Tensor, clipped: Tensor | None = None) -> Tile:
    up = torch.tensor([0.0, 0.0, 1.0], dtype=DOUBLE).expand(len(radiance), 3)
    points = Points(up[:, None], up, torch.ones(len(radiance), 1, 1, dtype=DOUBLE))
    noise = Readout(*(torch.tensor([[value]], dtype=DOUBLE) for value in (READ**2, GAIN)))
    limits = Limits(*(torch.tensor([[value]], dtype=DOUBLE) for value in (0.0, 1.0)))
    return Tile(Batch(points, radiance, MeasurementNoise(noise, limits, clipped)))


@pytest.mark.parametrize(("side", "limit"), [(-1, 0.0), (1, 1.0)])
def test_a_clipped_value_has_the_score_and_curvature_of_its_likelihood(side: int, limit: float) -> None:
    reference = limit + torch.linspace(-0.5, 0.5, 41, dtype=DOUBLE)[:, None]
    clipped = tile(torch.full_like(reference, limit), torch.full_like(reference, side, dtype=torch.int8))
    # The noise is that at the reference.
    std = clipped.batch.variance(reference).sqrt()
    believed = (side * (reference - limit) / std > -4)[:, 0]
    assert 0 < believed.sum() < len(believed)
    mean = reference.clone().requires_grad_()
    log_likelihood = torch.special.log_ndtr(side * (mean - limit) / std)
    (score,) = torch.autograd.grad(log_likelihood.sum(), mean, create_graph=True)
    (curvature,) = torch.autograd.grad(score.sum(), mean)
    response, weight, plain, *_ = clipped.about(reference)
    torch.testing.assert_close(weight[believed], -curvature[believed], rtol=1e-6, atol=1e-9)
    torch.testing.assert_close((weight * (response - reference))[believed], score.detach()[believed])
    rejected = (side * (reference - limit) / std < -6)[:, 0]
    assert rejected.any()
    assert (weight[rejected] == 0).all()
    # Only an outlier says how well the model fits.
    assert torch.equal(plain[:, 0], rejected)


@pytest.mark.parametrize(("side", "reference"), [(1, -1e4), (-1, 1e6), (1, 1e6), (-1, -1e4)])
def test_a_clipped_value_however_far_from_the_reference_is_a_finite_problem(side: int, reference: float) -> None:
    about = torch.tensor([[reference]])
    limits = Limits(torch.zeros(1, 1), torch.ones(1, 1))
    values = tile(torch.full((1, 1), 0.5 + 0.5 * side), torch.full((1, 1), side, dtype=torch.int8))
    noise = replace(values.batch.noise, readout=Readout(torch.full((1, 1), 1e-6), torch.zeros(1, 1)), limits=limits)
    response, weight, *_ = Tile(replace(values.batch, noise=noise)).about(about)
    assert bool(torch.isfinite(response).all())
    assert float(weight * (response - about)) == 0


def test_outliers_have_no_weight_and_ordinary_noise_all_of_it() -> None:
    reference = torch.full((5, 1), 0.5, dtype=DOUBLE)
    std = float(tile(reference).batch.variance(reference[:1]).sqrt())
    offsets = torch.tensor([[0.0], [3.9], [5.0], [6.1], [-40.0]], dtype=DOUBLE)
    values = tile(reference + std * offsets)
    response, weight, plain, *_ = values.about(reference)
    torch.testing.assert_close(response, values.batch.radiance)
    torch.testing.assert_close(weight[:, 0] * std**2, torch.tensor([1, 1, 0.5, 0, 0], dtype=DOUBLE))
    assert plain.all()
    # Where the model misses everything by as much, these are no outliers.
    torch.testing.assert_close(
        values.about(reference, ResidualScale.uniform(12.0)).weight * std**2, torch.ones(5, 1, dtype=DOUBLE)
    )


def test_values_that_might_have_been_clipped_do_not_judge_the_fit() -> None:
    reference = torch.tensor([[0.01], [0.5], [0.9], [1.2]], dtype=DOUBLE)
    assert tile(reference).about(reference).plain[:, 0].tolist() == [False, True, False, False]


def test_a_first_guess_takes_clipped_values_as_measured() -> None:
    radiance = torch.tensor([[0.0, 0.5, 1.0]], dtype=DOUBLE)
    response, weight, plain, *_ = tile(radiance, torch.tensor([[-1, 0, 1]])).first_guess()
    torch.testing.assert_close(response, radiance)
    torch.testing.assert_close(weight, 1 / (READ**2 + GAIN * radiance))
    assert plain.all()


@pytest.mark.parametrize("wild", [1e3, -1e3, 1e15])
def test_a_first_guess_leaves_wild_values_out_and_no_others(wild: float) -> None:
    radiance = torch.linspace(0.01, 0.6, 50, dtype=DOUBLE)[:, None]
    assert bool((tile(radiance).first_guess().weight > 0).all())
    radiance[7] = wild
    assert (tile(radiance).first_guess().weight == 0).nonzero()[:, 0].tolist() == [7]


def test_deviations_of_clipped_values_are_those_of_the_nearest_radiance_that_they_may_have() -> None:
    reference = torch.tensor([[0.5], [0.5], [1.5], [0.9]], dtype=DOUBLE)
    clipped = torch.tensor([[0], [1], [1], [0]], dtype=torch.int8)
    batch = tile(torch.tensor([[0.6], [1.0], [1.0], [0.9]], dtype=DOUBLE), clipped).batch
    std = batch.variance(reference[:1]).sqrt().item()
    size, clear = deviations(reference, batch.radiance, batch.noise)
    assert size[:, 0].tolist() == pytest.approx([0.1 / std, 0.5 / std, 0.0, 0.0])
    assert clear[:, 0].tolist() == [True, False, False, False]


def test_a_comparison_has_the_score_of_its_cost_and_no_outliers() -> None:
    comparison = Comparison(torch.log1p, lambda y: 1 / (1 + y))
    noise = MeasurementNoise(
        Readout(torch.full((1, 1), READ**2, dtype=DOUBLE), torch.zeros(1, 1)), None, None, comparison
    )
    measured = torch.tensor([[0.1], [0.5], [40.0]], dtype=DOUBLE)
    reference = torch.full_like(measured, 0.3).requires_grad_()
    cost = 0.5 * (torch.log1p(measured) - torch.log1p(reference)).square().sum() / READ**2
    (slope,) = torch.autograd.grad(cost, reference)
    problem = about(reference.detach(), measured, noise)
    torch.testing.assert_close(problem.weight * (problem.response - reference.detach()), -slope)
    assert bool(problem.plain.all())
    assert problem.errors is not None
    assert torch.equal(problem.errors.measured, measured)


def test_a_comparison_survives_cutting_and_joining() -> None:
    comparison = Comparison(torch.log1p, lambda y: 1 / (1 + y))
    one = tile(torch.rand(5, 1, dtype=DOUBLE)).batch
    batch = replace(one, noise=MeasurementNoise(one.noise.readout, comparison=comparison))
    assert join([batch[:2], batch[2:]]).noise.comparison is comparison
