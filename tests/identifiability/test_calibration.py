"""What a check says of errors of the calibration, against what they do to estimates."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from scipy.linalg import hadamard

import matest
from matest.brdf import CookTorrance, Lambert, OrenNayar
from matest.capture import Capture
from matest.identifiability import Check, check
from matest.samples.uncertainty import Uncertainty
from matest.scene import Scene
from tests.identifiability.subjects import plate, studio
from tests.miscalibrated import STUDIO, brighter, photographed, under_sky

MATT = OrenNayar([0.7, 0.5, 0.3], 0.4)
GLOSS = CookTorrance([0.4, 0.2, 0.1], 0.8, 0.25, f0=0.04)
AT = {"albedo": [0.7, 0.5, 0.3], "sigma": 0.4}

pytestmark = pytest.mark.usefixtures("without_advice")


def unchanged(scene: Scene) -> Scene:
    return scene


@pytest.fixture(scope="module")
def matt() -> Capture:
    return photographed(MATT, unchanged, 1)


def checked(capture: Capture, **stated: Any) -> Check:
    return check(capture, "oren-nayar", at=AT, uncertainty=stated)


@pytest.mark.parametrize("stated", [
    {"intensity": 0.03}, {"direction": 0.0175}, {"radius": 0.5}, {"ambient": 0.01}, {"pose": (0.5, 0.01)},
    {"radius": 0.3, "black": 0.003, "normals": 0.01, "normal_noise": 0.02, "albedo_noise": 0.1, "blur": 0.7},
], ids=" ".join)  # fmt: skip
def test_error_bars_with_stated_errors_are_those_that_estimate_reports(matt: Capture, stated: dict[str, Any]) -> None:
    found = matest.estimate(matt, "oren-nayar", uncertainty=stated).parameters
    predicted = checked(matt, **stated).parameters
    for name in AT:
        assert np.ravel(predicted[name].std) == pytest.approx(np.ravel(found[name].std), rel=0.03)
        assert predicted[name].noise_std != predicted[name].std


def test_those_of_a_lobe_are_too() -> None:
    capture, fix = photographed(GLOSS, unchanged, 1), {"f0": 0.04}
    at = {"diffuse": [0.4, 0.2, 0.1], "specular": 0.8, "slope": 0.25}
    stated = {"direction": 0.005, "radius": 0.2, "intensity": 0.01}
    found = matest.estimate(capture, "cook-torrance", fix=fix, uncertainty=stated).parameters
    predicted = check(capture, "cook-torrance", fix=fix, at=at, uncertainty=stated).parameters
    for name in at:
        assert np.ravel(predicted[name].std) == pytest.approx(np.ravel(found[name].std), rel=0.03)


def test_they_are_the_scatter_of_estimates_under_such_errors(matt: Capture) -> None:
    size = 0.02
    predicted = checked(matt, intensity=size).parameters["sigma"]
    # Signs of a Hadamard matrix: the covariance of these errors is that of independent ones, without chance.
    errors = size * torch.from_numpy(hadamard(8)).double()
    deviations = [
        matest.estimate(photographed(MATT, brighter(errors[k]), k), "oren-nayar").parameters["sigma"].value - 0.4
        for k in range(8)
    ]
    assert math.sqrt(np.mean(np.square(deviations))) == pytest.approx(predicted.std, rel=0.15)


def test_what_an_error_would_do_is_how_far_it_moves_an_estimate(matt: Capture) -> None:
    # A percent of ambient light is a large error, of which a fifth still is small.
    plain = matest.estimate(matt, "oren-nayar").parameters["sigma"].value
    moved = matest.estimate(photographed(MATT, under_sky(0.002), 1), "oren-nayar").parameters["sigma"].value - plain
    ambient = checked(matt).calibration["ambient"]
    assert (ambient.size, ambient.stated) == (0.01, False)
    assert ambient.adds["sigma"] == pytest.approx(5 * abs(moved), rel=0.25)
    assert ambient.relative["sigma"] == pytest.approx(ambient.adds["sigma"] / 0.4)


def test_nothing_stated_leaves_the_errors_of_the_noise_and_still_says_what_errors_would_do(matt: Capture) -> None:
    found = checked(matt)
    assert found.limits == []
    assert all(parameter.noise_std == parameter.std for parameter in found.parameters.values())
    largest = [error.most for error in found.calibration.values()]
    assert largest == sorted(largest, reverse=True)
    assert largest[0] > 0.05
    # With one light an image exposures are intensities, and a ball looks the same from all sides.
    assert not {"exposure", "tilt"} & {*found.calibration}
    assert {"intensity", "direction", "radius", "shift", "ambient", "black", "normal_noise"} <= {*found.calibration}


def test_what_is_stated_takes_the_place_of_what_is_supposed(matt: Capture) -> None:
    supposed, stated = checked(matt).calibration["radius"], checked(matt, radius=0.5, exposure=0.02).calibration
    assert stated["radius"].stated
    assert stated["radius"].relative["sigma"] == pytest.approx(supposed.relative["sigma"] / 2, rel=0.05)
    assert "exposure" in stated


def test_the_sentence_on_what_limits_a_parameter_comes_true(matt: Capture) -> None:
    found = checked(matt, radius=0.5, ambient=0.001)
    limit = next(limit for limit in found.limits if limit.parameter == "sigma")
    assert (limit.family, limit.size, limit.unit) == ("radius", 0.5, "px")
    assert limit.relative == pytest.approx(found.parameters["sigma"].relative)
    assert limit.part < limit.relative
    assert limit.better == pytest.approx(0.05)
    known_better = checked(matt, radius=limit.better, ambient=0.001).parameters["sigma"]
    assert known_better.relative == pytest.approx(limit.then, rel=1e-6)


def test_a_blur_is_limited_by_its_width_though_its_unknown_is_a_variance(matt: Capture) -> None:
    limit = next(limit for limit in checked(matt, blur=1.5).limits if limit.parameter == "sigma")
    assert (limit.size, limit.unit) == (1.5, "px")
    assert checked(matt, blur=limit.better).parameters["sigma"].relative == pytest.approx(limit.then, rel=1e-6)


def test_small_stated_errors_limit_nothing(matt: Capture) -> None:
    assert checked(matt, radius=1e-4).limits == []


def test_at_most_three_parameters_are_limited_and_those_most_that_errors_add_most_to() -> None:
    capture = photographed(GLOSS, unchanged, 1)
    limits = check(capture, "oren-nayar+cook-torrance", uncertainty={"direction": 0.05}).limits
    assert len(limits) == 3
    assert [limit.part for limit in limits] == sorted((limit.part for limit in limits), reverse=True)


def test_the_range_holds_stated_errors_too(matt: Capture) -> None:
    by_noise, found = (
        check(matt, "oren-nayar", uncertainty=stated).parameters["sigma"].range for stated in ({}, {"radius": 0.5})
    )
    assert found[0] > 5 * by_noise[0]
    assert found[1] > 5 * by_noise[1]


def test_what_stated_errors_leave_open_is_told_from_what_the_images_do(matt: Capture) -> None:
    sigma = checked(matt, radius=20.0).parameters["sigma"]
    assert sigma.status in ("weak", "not determined")
    assert sigma.reason == "the stated errors of the calibration leave it open"


def test_the_capture_states_errors_and_the_option_comes_before_it(matt: Capture) -> None:
    states = replace(matt, uncertainty=Uncertainty(radius=0.2, blur=0.5))
    found = check(states, "oren-nayar", uncertainty={"radius": 0.4}).calibration
    assert (found["radius"].size, found["blur"].size) == (0.4, 0.25)


def test_the_strength_of_lights_that_nobody_states_has_no_error() -> None:
    relative = photographed(Lambert([0.5, 0.4, 0.3]), unchanged, 1, replace(STUDIO, relative=True))
    assert "scale" not in check(relative, "lambert").calibration


def test_without_a_usable_sample_nothing_is_said_of_the_calibration() -> None:
    behind = studio([(0.0, 0.0, -1.0)]).photograph(Lambert(0.5), 1)
    found = check(behind, "lambert", uncertainty={"radius": 0.5})
    assert (found.samples, found.calibration, found.limits) == (0, {}, [])


def test_parameters_seen_only_together_are_not_in_the_table() -> None:
    found = check(plate(0.0), "oren-nayar", uncertainty={"radius": 0.5})
    assert found.parameters["sigma"].status == "not determined"
    assert all("sigma" not in error.relative for error in found.calibration.values())
