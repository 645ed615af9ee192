"""Where the model does not hold the photographs say how far maps can be trusted."""

from __future__ import annotations

import math

import numpy as np

import matest
from matest.benchmark.instruments import miscalibration as off
from tests.estimation.test_diagnosis import capture_of
from tests.inference.test_map_calibration import deviations


def test_lights_that_are_off_widen_the_error_bars_though_nobody_states_it() -> None:
    shares, sigmas = [], []
    for seed in range(3):
        capture = capture_of(off.together(off.directions(math.radians(2)), off.intensities(0.03)), seed)
        estimate = matest.estimate(capture, "oren-nayar", maps="albedo")
        assert estimate.fit.reduced_chi2 > 1.5
        shares.append(float((deviations(estimate).abs() < 1.96).double().mean()))
        sigma = estimate.parameters["sigma"]
        sigmas.append((sigma.value - 0.4) / sigma.std)
    assert np.mean(shares) > 0.8
    assert max(abs(z) for z in sigmas) < 4


def test_a_capture_that_holds_is_left_alone() -> None:
    capture = capture_of(off.together(), 1)
    estimate = matest.estimate(capture, "oren-nayar", maps="albedo")
    assert estimate.fit.reduced_chi2 < 1.1
    assert estimate.parameters["sigma"].std < 0.01
