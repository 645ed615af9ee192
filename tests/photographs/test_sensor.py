"""A sensor as stated, or as it shows in its photographs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from matest import load_capture
from matest.estimation.estimate import estimate
from matest.photographs.noise import Noise
from matest.photographs.photometry import Encoding
from matest.photographs.sensor import sensor_of
from tests.captures import sphere_surface
from tests.photographs.test_codes import NOISE, codes, signals
from tests.shared_data import shared

SURFACE = sphere_surface(96)


def test_what_is_stated_stands() -> None:
    stored = [image.clip(0, 30_000) for image in codes(signals())]
    sensor = sensor_of(stored, Encoding(saturation=0.9), SURFACE, NOISE, clips_as_stated=True)
    assert (sensor.encoding.saturation, sensor.clipping) == (0.9, None)
    assert sensor.noise.read == pytest.approx(NOISE.read, rel=1e-4)
    assert sensor.noise.read_std == 0


def test_clipping_that_is_found_is_the_limit_of_censoring() -> None:
    stored = [image.clip(0, 30_000) for image in codes(signals())]
    sensor = sensor_of(stored, Encoding(saturation=0.98), SURFACE, None, clips_as_stated=False)
    assert sensor.clipping is not None
    for image in stored:
        np.testing.assert_array_equal(sensor.encoding.saturated(image), image >= 30_000)
    # The clipped values do not make the noise look small.
    assert sensor.noise.gain == pytest.approx(NOISE.gain, abs=4 * sensor.noise.gain_std)


def test_floats_clip_at_the_very_level_that_is_found() -> None:
    stored = [np.minimum(image, 0.45).astype(np.float32) for image in signals()]
    sensor = sensor_of(stored, Encoding(), SURFACE, None, clips_as_stated=False)
    for image in stored:
        np.testing.assert_array_equal(sensor.encoding.saturated(image), image >= np.float32(0.45))


def test_rounding_to_steps_counts_as_noise() -> None:
    quiet = Noise(2e-4, 0.0)
    stored = [(73 * np.round(image / 73)).astype(np.uint16) for image in codes(signals(quiet))]
    sensor = sensor_of(stored, Encoding(saturation=0.98), SURFACE, None, clips_as_stated=False)
    assert sensor.encoding.step == 73
    assert sensor.noise.read == pytest.approx(math.hypot(2e-4, 73 / 65535 / math.sqrt(12)), rel=0.1)


@pytest.mark.parametrize(
    ("case", "says"),
    [("raw12", "4095"), ("hdr_clipped", "0.5, 0.42, 0.4"), ("codes_in_steps", None), ("grey_with_rgb_light", None)],
)
def test_photographs_as_cameras_make_them_give_the_truth(case: str, says: str | None) -> None:
    folder, truth = shared(case)
    parameters = {name: value for name, value in truth.items() if name in ("albedo", "sigma", "diffuse", "slope")}
    result = estimate(load_capture(folder), truth["model"], fix={"f0": truth["f0"]} if "f0" in truth else {})
    for name, value in parameters.items():
        parameter = result.parameters[name]
        errors = np.abs(np.subtract(parameter.value, value)) / np.array(parameter.std)
        assert (errors < 3).all(), name
    if "specular" in truth:
        # The truth is the end of its domain.
        assert all(low <= truth["specular"] <= high for low, high in result.parameters["specular"].interval95)
    sentences = [warning for warning in result.warnings if "pile up" in warning]
    assert (says is None and not sentences) or (says is not None and says in sentences[0])
    assert any("come in steps of 73:" in warning for warning in result.warnings) == (case == "codes_in_steps")
