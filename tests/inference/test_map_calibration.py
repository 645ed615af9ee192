"""Stated errors of the calibration widen the error bars of maps by what they do to them."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

import matest
from matest.benchmark.instruments import miscalibration as off
from matest.estimation.result import Estimate
from tests.estimation.test_diagnosis import capture_of

DEGREE = math.radians(1)
TRUTH = torch.tensor([[0.7, 0.5, 0.3]])


def deviations(estimate: Estimate) -> torch.Tensor:
    """Errors of the albedo in standard errors, where there is a value."""
    each = estimate.maps["albedo"]
    errors = (each.value - TRUTH) / each.std
    return errors[errors.isfinite()]


@pytest.mark.parametrize(
    ("error", "stated"),
    [
        (off.directions(DEGREE), {"direction": DEGREE}),
        (off.intensities(0.03), {"intensity": 0.03}),
        (off.constant(ambient=0.01), {"ambient": 0.01}),
    ],
)
def test_intervals_hold_the_truth_where_the_error_is_stated(error: off.Error, stated: dict[str, float]) -> None:
    share, without, sigmas = [], [], []
    for seed in range(3):
        capture = capture_of(error, seed)
        told, plain = (matest.estimate(capture, "oren-nayar", maps="albedo", uncertainty=each) for each in (stated, {}))
        share.append(float((deviations(told).abs() < 1.96).double().mean()))
        without.append(float((deviations(plain).abs() < 1.96).double().mean()))
        sigma = told.parameters["sigma"]
        sigmas.append((sigma.value - 0.4) / sigma.std)
        assert sigma.std > 2 * plain.parameters["sigma"].std
    assert np.mean(share) > 0.92
    assert np.mean(share) > np.mean(without)
    assert max(abs(z) for z in sigmas) < 3


def test_the_mean_of_a_map_errs_as_the_calibration_does_however_many_pixels_there_are() -> None:
    capture = capture_of(off.together(), 1)
    told, plain = (
        matest.estimate(capture, "oren-nayar", maps="albedo", uncertainty=each) for each in ({"scale": 0.05}, {})
    )
    mean, noise_alone = told.parameters["albedo"], plain.parameters["albedo"]
    assert mean.std[0] / mean.value[0] == pytest.approx(0.05, rel=0.2)
    assert noise_alone.std[0] < 0.1 * mean.std[0]
