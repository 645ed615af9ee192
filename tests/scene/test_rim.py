from __future__ import annotations

import numpy as np
import pytest

from matest.scene import rim
from matest.scene.rim import near_silhouette, starts_of_rows


@pytest.mark.parametrize("rows", [1, 2, 7])
def test_a_rim_judged_band_by_band_is_that_of_the_whole_image(monkeypatch, rng, rows):
    shape = (61, 40)
    pixels = np.flatnonzero(rng.random(shape) < 0.995)
    # Two levels of depth with a step between them, and a few stray pixels in front.
    depth = np.where(pixels % shape[1] < 17 + pixels // shape[1] // 4, 1.0, 2.0) - (rng.random(len(pixels)) < 0.003)
    jump = rng.uniform(0.2, 1.2, len(pixels))
    whole = near_silhouette(shape, pixels, depth, jump)
    assert 0.1 < whole.mean() < 0.7
    monkeypatch.setattr(rim, "_AT_ONCE", rows * shape[1])
    np.testing.assert_array_equal(near_silhouette(shape, pixels, depth, jump), whole)
    np.testing.assert_array_equal(near_silhouette(shape, pixels), near_silhouette(shape, pixels, depth, jump + 9))


def test_pixels_above_a_row_are_counted_up_to_the_last_row_of_any_band(rng):
    pixels = np.flatnonzero(rng.random((50, 30)) < 0.4).astype(np.int32)
    expected = [np.count_nonzero(pixels < 30 * row) for row in (0, 7, 50, 53)]
    assert starts_of_rows(pixels, 30, 0, 7, 50, 53).tolist() == expected
    assert starts_of_rows(pixels, 30, 1 << 40).tolist() == [len(pixels)]
