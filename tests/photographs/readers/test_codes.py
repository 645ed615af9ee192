from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from matest.photographs.images import full_scale
from matest.photographs.readers.codes import raster_of_32_bits, raster_of_codes
from tests.captures import refusal


@pytest.mark.parametrize(
    ("maximum", "dtype"),
    [
        (1, np.uint8),
        (15, np.uint8),
        (255, np.uint8),
        (257, np.uint16),
        (65535, np.uint16),
        (1023, np.float32),
        (4095, np.float32),
        (16383, np.float32),
    ],
)
def test_codes_are_the_fraction_of_their_maximum(maximum: int, dtype: type) -> None:
    codes = np.arange(maximum + 1)
    raster = raster_of_codes(codes, maximum)
    assert raster.pixels.dtype == dtype
    fractions = raster.pixels / full_scale(raster.pixels.dtype)
    np.testing.assert_allclose(fractions, codes / maximum, rtol=1e-7)
    np.testing.assert_array_equal(np.rint(fractions * maximum), codes)
    assert bool(raster.notes) == (dtype == np.float32)


def test_codes_of_full_scale_are_not_copied() -> None:
    codes = np.arange(256, dtype=np.uint8)
    assert raster_of_codes(codes, 255).pixels is codes


def test_stretched_codes_come_back_as_those_that_were_stretched() -> None:
    codes = np.arange(65536, dtype=np.uint16)
    pixels = raster_of_32_bits(Path("a.tif"), codes.astype(np.uint32) * 65537).pixels
    assert pixels.dtype == np.uint16
    np.testing.assert_array_equal(pixels, codes)


def test_32_bit_codes_of_24_digits_are_fractions_that_give_them_back() -> None:
    codes = np.concatenate([np.arange(1000), 2**24 - 1 - np.arange(1000), 256 * (2**24 - 1 - np.arange(1000))])
    codes = codes.astype(np.uint32)
    pixels = raster_of_32_bits(Path("a.tif"), codes).pixels
    assert pixels.dtype == np.float32
    np.testing.assert_allclose(pixels, codes / (2**32 - 1), rtol=1e-7)
    np.testing.assert_array_equal(np.rint(pixels.astype(np.float64) * 2**32), codes)


def test_32_bit_codes_of_more_digits_are_refused() -> None:
    message = refusal(lambda: raster_of_32_bits(Path("a.tif"), np.array([[1, 2**24 + 1]], np.uint32)))
    assert "a.tif" in message
    assert "float32" in message
