"""The noise of a camera, and rounding to its codes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from matest.photographs.noise import FLOAT_FLOOR, Noise, quantisation, rounding, stated_noise
from matest.photographs.photometry import Encoding

READ, GAIN = 0.004, 0.0006


def test_quantisation_is_the_standard_deviation_of_rounding():
    rng = np.random.default_rng(2)
    values = rng.uniform(0.3, 0.7, 200_000)
    rounded = np.round(values * 255) / 255
    assert quantisation(Encoding(), np.dtype(np.uint8)) == pytest.approx((rounded - values).std(), rel=0.01)
    assert quantisation(Encoding(), np.dtype(np.float32)) == 0
    assert quantisation(Encoding("srgb"), np.dtype(np.uint16)) == pytest.approx(
        1 / 12.92 / 65535 / np.sqrt(12), rel=1e-3
    )
    assert rounding(Encoding(), np.dtype(np.uint8)) == (0, 1)
    assert rounding(Encoding("srgb"), np.dtype(np.float32)) == (0, 1)


@pytest.mark.parametrize("transfer", ["srgb", 2.2])
def test_rounding_grows_with_the_signal_where_the_encoding_is_not_linear(transfer):
    rng = np.random.default_rng(3)
    encoding = Encoding(transfer)
    for level in (0.02, 0.2, 0.8):
        # Whole steps, that every part of them is there.
        codes = np.round(encoding.encoded(np.array([0.9, 1.1]) * level) * 255) + 0.5
        linear = encoding.linear(rng.uniform(*codes, 100_000) / 255)
        stored = np.round(encoding.encoded(linear) * 255).astype(np.uint8)
        measured = np.square(encoding.linear(stored / 255) - linear).mean()
        factor, power = rounding(encoding, stored.dtype)
        assert factor * (linear**power).mean() == pytest.approx(measured, rel=0.03)
        assert quantisation(encoding, stored.dtype) ** 2 < 0.15 * measured


def test_rounding_to_integers_adds_to_the_noise_of_the_sensor():
    noise = Noise(0.002, GAIN).with_rounding(Encoding(), np.dtype(np.uint8))
    assert noise == Noise(pytest.approx(math.hypot(0.002, 1 / 255 / math.sqrt(12))), GAIN)
    assert Noise(0.002, GAIN).with_rounding(Encoding(), np.dtype(np.float32)) == Noise(0.002, GAIN)


def test_floats_stated_to_be_without_noise_are_as_good_as_their_geometry():
    pixels = np.array([[0.2], [0.8]], np.float32)
    nowhere = np.zeros((0, 9), dtype=np.int64)
    assert stated_noise(Noise(0.0, 0.0), Encoding(), pixels, nowhere).read == pytest.approx(FLOAT_FLOOR * 0.8)
    assert stated_noise(Noise(0.0, GAIN), Encoding(), 0 * pixels, nowhere).read > 0
    assert stated_noise(Noise(READ, GAIN), Encoding(), pixels, nowhere) == Noise(READ, GAIN)


def test_one_wild_pixel_is_no_peak_of_floats_without_noise():
    pixels = np.linspace(0.2, 0.8, 100, dtype=np.float32)[:, None]
    everywhere = np.arange(90)[:, None] + np.arange(9)
    clean = stated_noise(Noise(0.0, 0.0), Encoding(), pixels, everywhere).read
    pixels[50] = 1e9
    assert stated_noise(Noise(0.0, 0.0), Encoding(), pixels, everywhere).read == pytest.approx(clean, rel=0.1)
