"""Arrays as text."""

from __future__ import annotations

import base64
import zlib

import numpy as np
import pytest

from matest.report.packing import data_uri, packed, packed_noise


def unpacked(text: str, row: int, kind: type) -> np.ndarray:
    """As `numbers.js` reads it: planes of bytes, then sums along rows that wrap round."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(text)), dtype=np.uint8).reshape(np.dtype(kind).itemsize, -1)
    differences = sum(plane.astype(kind) << np.array(8 * k, dtype=kind) for k, plane in enumerate(planes))
    return np.cumsum(np.asarray(differences).reshape(-1, row), axis=1, dtype=kind)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_every_code_comes_back(kind: type) -> None:
    codes = np.random.default_rng(1).integers(0, np.iinfo(kind).max, (3, 5, 7), dtype=kind, endpoint=True)
    np.testing.assert_array_equal(unpacked(packed(codes), 7, kind), codes.reshape(-1, 7))


def test_noise_comes_back_in_rows_of_one_and_takes_its_entropy() -> None:
    codes = (128 + 2 * np.random.default_rng(1).standard_normal((100, 100))).round().astype(np.uint8)
    text = packed_noise(codes)
    np.testing.assert_array_equal(unpacked(text, 1, np.uint8).reshape(100, 100), codes)
    shares = np.bincount(codes.ravel()) / codes.size
    bits = -(shares[shares > 0] * np.log2(shares[shares > 0])).sum()
    assert len(base64.b64decode(text)) < 1.05 * bits / 8 * codes.size


def test_smooth_rows_take_little() -> None:
    codes = np.tile(np.arange(0, 20_000, 40, dtype=np.uint16), (20, 1))
    assert len(packed(codes)) < 0.01 * codes.nbytes


def test_a_file_within_a_page_has_its_kind() -> None:
    assert data_uri(b"abc", "image/png") == "data:image/png;base64,YWJj"
