"""Simulated captures hold what a camera would have stored, and the same seed gives the same pixels."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from matest.benchmark.instruments.photographs import SATURATION, Conditions
from matest.benchmark.instruments.trial import draw

MODELS = ("lambert", "oren-nayar", "cook-torrance", "li-torrance")


@pytest.mark.parametrize("expression", MODELS)
def test_the_same_seed_draws_the_same_pixels(expression: str) -> None:
    one, other = (draw(expression, 3).photograph().photographs for _ in range(2))
    assert all(np.array_equal(a, b) for a, b in zip(one.stored, other.stored, strict=True))
    another = draw(expression, 4).photograph().photographs
    assert len(another) != len(one) or not np.array_equal(another.stored[0], one.stored[0])


def test_draws_differ_in_object_lights_and_channels() -> None:
    drawn = [draw("lambert", seed) for seed in range(20)]
    assert {len(one.scene) for one in drawn} == {1, 3, 12}
    assert {one.scene.channels for one in drawn} == {1, 3}
    assert {one.scene.surface.mesh is None for one in drawn} == {True, False}
    assert {one.sensor.black > 0 for one in drawn} == {True, False}


def test_clean_photographs_scatter_about_the_truth_as_their_noise_says() -> None:
    drawn = draw("cook-torrance", 1)
    photographs = drawn.photograph().photographs
    assert photographs.stored[0].dtype == np.uint16
    scale = drawn.encoding.scale
    for image, truth in enumerate(drawn.radiance):
        signal = truth / scale
        spread = np.sqrt(photographs.noise.read**2 + photographs.noise.gain * signal)
        # Where noise is not cut off at black.
        seen = signal + drawn.sensor.black > 5 * spread
        assert seen.sum() > 300
        misfit = ((photographs.radiance(image) / scale - signal) / spread)[seen]
        assert abs(misfit.mean()) < 4 / np.sqrt(misfit.size)
        assert misfit.std() == pytest.approx(1, abs=4 / np.sqrt(2 * misfit.size))
    assert not any(photographs.encoding.saturated(pixels).any() for pixels in photographs.stored)


def test_spoilt_photographs_have_the_stated_shares_of_outliers_and_saturated_pixels() -> None:
    conditions = Conditions(bits=8, outliers=0.02, saturated=0.05)
    drawn = next(one for seed in range(20) if len((one := draw("oren-nayar", seed, conditions)).scene) == 12)
    photographs, ideal = drawn.photograph().photographs, drawn.ideal().photographs
    assert photographs.stored[0].dtype == np.uint8
    lit = np.concatenate([image.max(axis=1) > 0 for image in drawn.radiance])
    above = np.concatenate([ideal.encoding.saturated(pixels).any(axis=1) for pixels in ideal.stored])
    assert above[lit].mean() == pytest.approx(0.05, abs=0.002)
    dark = np.concatenate([image.max(axis=1) == 0 for image in drawn.radiance])
    stored = np.concatenate([pixels.max(axis=1) for pixels in photographs.stored]) / 255
    # A pixel in shadow that is far above black can only be an outlier; few even draws fall below that.
    below = 0.2
    stray = (stored[dark] > below).mean() / (1 - below**photographs.channels)
    assert stray == pytest.approx(0.02, abs=4 * np.sqrt(0.02 / dark.sum()))


def test_an_ideal_photograph_gives_every_lit_pixel_off_the_rim_without_noise() -> None:
    drawn = draw("lambert", 2)
    samples = drawn.ideal().photographs.samples(dtype=torch.float64)
    surface = drawn.scene.surface
    lit = [
        ((surface.normals * lights[0].direction).sum(-1) > 0).numpy() & ~surface.rim for lights in drawn.scene.lights
    ]
    assert samples.counts == [int(mask.sum()) for mask in lit]
    batch = samples.at(0, samples.indices(0))
    assert batch.noise.clipped is None
    np.testing.assert_allclose(batch.radiance, drawn.radiance[0][lit[0]], rtol=1e-5, atol=1e-6)


def test_saturation_lies_at_the_level_of_the_brightest_share() -> None:
    drawn = draw("cook-torrance", 5, Conditions(saturated=0.3))
    brightest = np.concatenate([image.max(axis=1) for image in drawn.radiance])
    level = drawn.encoding.scale * (SATURATION - drawn.sensor.black)
    assert (brightest[brightest > 0] > level).mean() == pytest.approx(0.3, abs=0.01)
