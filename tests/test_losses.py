from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from matest.losses import likelihood, photometric, structural
from matest.samples import Batch
from matest.samples.likelihood import Limits, MeasurementNoise, Readout
from matest.scene import Points

READ, GAIN = 0.01**2, 0.004


def batch_of(radiance: torch.Tensor) -> Batch:
    points = Points(torch.zeros(1, 1, 3), torch.zeros(1, 3), torch.zeros(1, 1, 1))
    readout = Readout(*(torch.full((1, 1), v, dtype=radiance.dtype) for v in (READ, GAIN)))
    return Batch(points, radiance, MeasurementNoise(readout))


def random(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def test_photometric_is_the_mean_squared_error():
    rendered, measured = torch.tensor([[1.0, 2.0], [3.0, 4.0]]), torch.tensor([[1.0, 1.0], [5.0, 4.0]])
    assert float(photometric(rendered, measured)) == (0 + 1 + 4 + 0) / 4


def test_photometric_divides_by_the_mean_weight():
    rendered, measured = torch.tensor([[1.0, 2.0], [3.0, 4.0]]), torch.tensor([[1.0, 1.0], [5.0, 4.0]])
    weight = torch.tensor([[1.0, 3.0], [2.0, 2.0]])
    assert float(photometric(rendered, measured, weight)) == pytest.approx((3 * 1 + 2 * 4) / 8)
    per_sample = torch.tensor([[1.0], [3.0]])
    assert float(photometric(rendered, measured, per_sample)) == pytest.approx((1 * 1 + 3 * 4) / 8)


def test_even_weights_change_nothing():
    rendered, measured = random(20, 3), random(20, 3, seed=1)
    torch.testing.assert_close(
        photometric(rendered, measured, torch.full((20, 1), 7.0)), photometric(rendered, measured)
    )


def test_likelihood_is_that_of_a_normal_distribution_of_the_camera_noise():
    rendered, measured = random(50, 3), random(50, 3, seed=1)
    deviation = (READ + GAIN * rendered).sqrt()
    expected = -torch.distributions.Normal(rendered, deviation).log_prob(measured).mean() - 0.5 * math.log(2 * math.pi)
    torch.testing.assert_close(likelihood(rendered, batch_of(measured)), expected)


def test_likelihood_prefers_the_true_radiance():
    truth = 0.1 + random(200, 200)
    noise = torch.randn(truth.shape, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    batch = batch_of(truth + noise * (READ + GAIN * truth).sqrt())
    scale = torch.tensor(1.0, dtype=torch.float64, requires_grad=True)
    loss = likelihood(scale * truth, batch)
    (slope,) = torch.autograd.grad(loss, scale, create_graph=True)
    (curvature,) = torch.autograd.grad(slope, scale)
    # Newton's step leads to the optimum, whose standard error is 1 / √(N · curvature).
    newton_step, information = float((slope / curvature).detach()), truth.numel() * float(curvature.detach())
    assert abs(newton_step) < 4 / math.sqrt(information)


def test_students_likelihood_is_that_of_his_distribution():
    rendered, measured = random(50, 3), random(50, 3, seed=1)
    deviation = (READ + GAIN * rendered).sqrt()
    student = torch.distributions.StudentT(torch.tensor(4.0, dtype=torch.float64), rendered, deviation)
    constant = student.log_prob(rendered).mean() + deviation.log().mean()
    expected = -student.log_prob(measured).mean() + constant
    torch.testing.assert_close(likelihood(rendered, batch_of(measured), degrees_of_freedom=4), expected)


def test_many_degrees_of_freedom_are_gaussian():
    rendered, measured = random(50, 3), random(50, 3, seed=1)
    batch = batch_of(measured)
    torch.testing.assert_close(
        likelihood(rendered, batch, degrees_of_freedom=1e9), likelihood(rendered, batch), rtol=1e-5, atol=0
    )


def test_students_likelihood_is_pulled_less_by_an_outlier_the_further_out_it_is():
    pulls = []
    for outlier in (0.6, 5.0):
        rendered = torch.full((1, 1), 0.5, dtype=torch.float64, requires_grad=True)
        batch = batch_of(torch.full((1, 1), outlier, dtype=torch.float64))
        likelihood(rendered, batch, degrees_of_freedom=4).backward()
        pulls.append(abs(rendered.grad.item()))
    assert pulls[1] < 0.2 * pulls[0]


def test_a_clipped_value_counts_with_the_probability_of_being_clipped():
    rendered = torch.tensor([[0.02, 0.4, 0.97]], dtype=torch.float64)
    measured = torch.tensor([[0.0, 0.5, 1.0]], dtype=torch.float64)
    ends = Limits(*(torch.tensor([[end]], dtype=torch.float64) for end in (0.01, 0.95)))
    batch = batch_of(measured)
    batch = replace(batch, noise=replace(batch.noise, limits=ends, clipped=torch.tensor([[-1, 0, 1]])))
    std = (READ + GAIN * rendered).sqrt()
    normal = torch.distributions.Normal(rendered, std)
    below, above = normal.cdf(torch.tensor(0.01))[:, 0], 1 - normal.cdf(torch.tensor(0.95))[:, 2]
    inside = -normal.log_prob(measured)[:, 1] - 0.5 * math.log(2 * math.pi)
    expected = (inside - below.log() - above.log()) / 3
    torch.testing.assert_close(likelihood(rendered, batch), expected[0])


def test_the_optimum_weighs_samples_by_their_inverse_variance():
    truth = torch.tensor([[0.1], [0.9]], dtype=torch.float64)
    batch = batch_of(truth)
    weight = batch.weight(truth)
    torch.testing.assert_close(weight, 1 / (READ + GAIN * truth))
    offsets = torch.zeros_like(truth, requires_grad=True)
    step = 1e-4
    (slope,) = torch.autograd.grad(photometric(truth + offsets + step, truth, weight), offsets)
    torch.testing.assert_close(slope, 2 * step * weight / weight.sum(), rtol=1e-9, atol=0)


def test_gradients_are_finite_where_the_model_is_dark():
    rendered = torch.tensor([[-0.1, 0.0, 0.2]], requires_grad=True)
    likelihood(rendered, batch_of(torch.ones(1, 3))).backward()
    assert torch.isfinite(rendered.grad).all()


def test_gradients_are_finite_where_only_the_upper_end_clips():
    # Float images with a saturation have no lower end.
    rendered = torch.tensor([[0.2, 0.5, 2.0]], dtype=torch.float64, requires_grad=True)
    ends = Limits(*(torch.tensor([[end]], dtype=torch.float64) for end in (-math.inf, 0.95)))
    batch = batch_of(torch.tensor([[0.3, 1.0, 1.0]], dtype=torch.float64))
    noise = replace(batch.noise, limits=ends, clipped=torch.tensor([[0, 1, 1]]))
    likelihood(rendered, replace(batch, noise=noise)).backward()
    assert torch.isfinite(rendered.grad).all()
    assert rendered.grad[0, 1] < 0


def test_equal_images_have_no_structural_loss():
    images = random(2, 24, 20, 3).float()
    assert float(structural(images, images)) == pytest.approx(0, abs=1e-6)


def test_structural_loss_of_flat_images_is_that_of_their_means():
    dark, bright = 0.3, 0.8
    stabiliser = (0.01 * bright) ** 2
    similarity = (2 * dark * bright + stabiliser) / (dark**2 + bright**2 + stabiliser)
    loss = structural(torch.full((1, 20, 24, 1), dark), torch.full((1, 20, 24, 1), bright))
    assert float(loss) == pytest.approx(1 - similarity, rel=1e-3)


def test_structural_loss_sees_structure_that_the_mean_squared_error_does_not():
    measured = random(1, 32, 32, 1).float()
    noise = 0.1 * torch.sign(random(1, 32, 32, 1, seed=3) - 0.5).float()
    brighter, noisier = measured + 0.1, measured + noise
    torch.testing.assert_close(photometric(brighter, measured), photometric(noisier, measured))
    assert structural(brighter, measured) < 0.5 * structural(noisier, measured)


def test_structural_loss_is_differentiable():
    rendered = random(1, 16, 16, 3).float().requires_grad_()
    structural(rendered, random(1, 16, 16, 3, seed=1).float()).backward()
    assert torch.isfinite(rendered.grad).all()
    assert rendered.grad.abs().max() > 0
