from __future__ import annotations

import numpy as np
import pytest
from skimage.color import gray2rgb, rgb2xyz

from matest.photographs.photometry import Encoding, srgb

EVERYTHING = slice(None)


def test_srgb_is_the_published_curve():
    codes = np.linspace(0, 1, 400)
    # Luminance of a grey colour is its linear value.
    expected = rgb2xyz(gray2rgb(codes))[..., 1]
    np.testing.assert_allclose(Encoding("srgb").linear(codes), expected, atol=1e-6)
    assert float(Encoding("srgb").linear(np.array(0.5))) == pytest.approx(0.2140411, abs=1e-7)


def test_gamma_is_the_exponent_from_codes_to_light():
    np.testing.assert_allclose(Encoding(2.2).linear(np.array([0.0, 0.5, 1.0])), [0, 0.5**2.2, 1], rtol=1e-15)


@pytest.mark.parametrize("transfer", ["linear", "srgb", 2.2, 1.8])
def test_encoding_and_decoding_are_inverse(transfer):
    codes = np.concatenate([np.linspace(0, 1, 1001), np.linspace(0.03, 0.05, 101)])
    encoding = Encoding(transfer)
    np.testing.assert_allclose(encoding.encoded(encoding.linear(codes)), codes, atol=1e-7)
    assert (np.diff(encoding.linear(np.linspace(0, 1, 1001))) > 0).all()


@pytest.mark.parametrize("transfer", ["linear", "srgb", 2.2])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_integer_codes_are_fractions_of_full_scale(transfer, dtype):
    full = np.iinfo(dtype).max
    codes = np.array([[0], [1], [full // 3], [full]], dtype=dtype)
    encoding = Encoding(transfer)
    signal = encoding.signal(codes, EVERYTHING)
    assert signal.dtype == np.float32
    np.testing.assert_allclose(signal, encoding.linear(codes / full), rtol=1e-6)


@pytest.mark.parametrize("transfer", ["linear", "srgb", 2.2])
def test_float_pixels_are_taken_as_stored(transfer):
    stored = np.array([[0.0, 0.02, 0.5], [1.0, 1.5, 0.3]], np.float32)
    encoding = Encoding(transfer)
    np.testing.assert_allclose(encoding.signal(stored, EVERYTHING), encoding.linear(stored.astype(float)), rtol=1e-6)


def test_black_is_subtracted_and_flat_field_divided_out():
    rng = np.random.default_rng(1)
    truth, flat = rng.uniform(0.1, 0.5, (20, 3)), rng.uniform(0.6, 1.0, (20, 3))
    black = rng.uniform(0.01, 0.05, (20, 3))
    encoding = Encoding(black=black, flat=flat)
    chosen = np.array([3, 7, 19])
    np.testing.assert_allclose(encoding.signal((truth * flat + black)[chosen], chosen), truth[chosen], rtol=1e-6)
    np.testing.assert_allclose(Encoding(black=0.1).signal(truth, EVERYTHING), truth - 0.1, rtol=1e-6)


def test_signal_below_black_stays_negative():
    assert Encoding(black=0.25).signal(np.array([[0]], np.uint8), EVERYTHING)[0, 0] == -0.25


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_integers_from_the_given_fraction_of_full_scale_on_are_saturated(dtype):
    full = np.iinfo(dtype).max
    codes = np.array([[0, int(0.9 * full), full]], dtype=dtype)
    assert Encoding(saturation=0.95).saturated(codes).tolist() == [[False, False, True]]
    assert Encoding(saturation=0.5).saturated(codes).tolist() == [[False, True, True]]
    assert Encoding(saturation=1.0).saturated(codes).tolist() == [[False, False, True]]
    assert Encoding().saturated(codes).tolist() == [[False, False, False]]


def test_floats_above_the_given_value_are_saturated():
    stored = np.array([[0.5, 4.0, 4.5]], np.float32)
    assert Encoding(saturation=4.0).saturated(stored).tolist() == [[False, False, True]]
    assert Encoding().saturated(stored).tolist() == [[False, False, False]]


def test_srgb_pictures_round_to_the_nearest_code():
    assert srgb(np.array([-1.0, 0.0, 0.2158605, 1.0, 7.0])).tolist() == [0, 0, 128, 255, 255]
