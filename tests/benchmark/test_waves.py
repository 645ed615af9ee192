"""Random smooth fields."""

from __future__ import annotations

import numpy as np
import pytest

from matest.benchmark.instruments.photographs import sphere, vase
from matest.benchmark.instruments.waves import Waves, places


def test_the_gradient_is_that_of_differences() -> None:
    generator = np.random.default_rng(0)
    waves, at, step = Waves(generator), generator.uniform(-0.5, 0.5, (50, 2)), 1e-5
    for axis in range(2):
        shift = step * np.eye(2)[axis]
        difference = (waves.values(at + shift) - waves.values(at - shift)) / (2 * step)
        np.testing.assert_allclose(waves.gradient(at)[:, axis], difference, rtol=1e-5, atol=1e-5)


def test_places_reach_from_end_to_end_of_the_longer_side() -> None:
    for surface in (sphere(64), vase(64)):
        at = places(surface)
        assert np.ptp(at, axis=0).max() == pytest.approx(1)
        np.testing.assert_allclose(at.max(axis=0), -at.min(axis=0))
    # Up is up: the first pixel is in the top row.
    assert at[0, 1] == at[:, 1].max()


def test_values_between_two_ends_use_most_of_the_range_and_keep_their_order() -> None:
    waves, at = Waves(np.random.default_rng(1)), places(sphere(64))
    values = waves.between(at, 0.1, 0.7)
    assert 0.1 < values.min() < 0.2
    assert 0.6 < values.max() < 0.7
    np.testing.assert_array_equal(np.argsort(values), np.argsort(waves.values(at)))
