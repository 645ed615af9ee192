"""What stored values say of a sensor: how far its codes lie apart, and where it clips."""

from __future__ import annotations

import numpy as np
import pytest

from matest.photographs.codes import clipping, code_step, highest
from matest.photographs.noise import Noise
from matest.photographs.photometry import Encoding
from matest.photographs.windows import windows
from tests.captures import sphere_surface

SURFACE = sphere_surface(96)
WINDOWS = windows(SURFACE)
NORMALS = SURFACE.normals.numpy()
DIRECTIONS = np.array([(0.2, 0.3, 0.9), (-0.5, 0.1, 0.8), (0.6, -0.4, 0.7)])
NOISE = Noise(0.002, 0.0005)


def signals(noise: Noise = NOISE, flat: bool = False) -> list[np.ndarray]:
    """Signal [N, 3] of a sphere under three lights, with its noise; with `flat`, a bright part of it is a plane."""
    rng = np.random.default_rng(0)
    normals = NORMALS.copy()
    if flat:
        normals[NORMALS[:, 2] > 0.9] = (0.0, 0.0, 1.0)
    out = []
    for direction in DIRECTIONS / np.linalg.norm(DIRECTIONS, axis=1, keepdims=True):
        signal = np.clip(normals @ direction, 0, None)[:, None] * np.array([0.8, 0.6, 0.5])
        out.append(signal + rng.normal(size=signal.shape) * np.sqrt(noise.read**2 + noise.gain * signal))
    return out


def codes(images: list[np.ndarray], top: int = 65535) -> list[np.ndarray]:
    return [np.round(top * image.clip(0, 1)).astype(np.uint16 if top > 255 else np.uint8) for image in images]


def found(stored: list[np.ndarray], noise: Noise = NOISE) -> tuple[float | None, ...]:
    clip = clipping(stored, highest(stored), Encoding(), noise)
    return () if clip is None else clip.levels


@pytest.mark.parametrize("step", [16, 73, 42.8])
def test_codes_that_come_in_steps_are_seen_to(step: float) -> None:
    stretched = [np.round(step * np.round(image / step)).astype(np.uint16) for image in codes(signals())]
    assert code_step(stretched, WINDOWS) == pytest.approx(step, rel=0.01)


def test_codes_that_are_missing_by_chance_are_no_step() -> None:
    assert code_step(codes(signals()), WINDOWS) == 1
    assert code_step(codes(signals(), 255), WINDOWS) == 1
    assert code_step([np.zeros((len(SURFACE), 1), np.uint16)], WINDOWS) == 1
    assert code_step([image.astype(np.float32) for image in signals()], WINDOWS) == 1


def test_the_highest_values_are_those_of_every_pixel() -> None:
    rng = np.random.default_rng(1)
    for count in (1, 63, 64, 1000):
        pixels = rng.integers(0, 65536, (count, 3)).astype(np.uint16)
        np.testing.assert_array_equal(highest([pixels])[0], pixels.max(axis=0))


def test_a_pile_at_the_highest_code_is_found_and_counted() -> None:
    stored = [image.clip(0, 30_000) for image in codes(signals())]
    clip = clipping(stored, highest(stored), Encoding(), NOISE)
    assert clip is not None
    assert clip.levels == (30_000, 30_000, 30_000)
    assert clip.count == sum(int((image == 30_000).sum()) for image in stored)
    assert "30000" in clip.sentence
    assert "encoding.saturation" in clip.sentence


def test_each_channel_has_a_level_of_its_own_in_floats_too() -> None:
    levels = np.array([0.5, 0.4, 2.0], np.float32)
    stored = [np.minimum(image.astype(np.float32), levels) for image in signals()]
    assert found(stored) == (pytest.approx(0.5), pytest.approx(0.4), None)


def test_values_at_the_stated_saturation_are_no_news() -> None:
    stored = [2 * image.clip(0, 30_000) for image in codes(signals())]
    maxima = highest(stored)
    assert clipping(stored, maxima, Encoding(saturation=0.98), NOISE) is not None
    assert clipping(stored, maxima, Encoding(saturation=0.9), NOISE) is None


@pytest.mark.parametrize("top", [255, 65535])
def test_a_scene_that_is_merely_bright_has_no_pile(top: int) -> None:
    assert found(codes(signals(), top)) == ()
    assert found(codes(signals(flat=True), top)) == ()


def test_an_even_region_without_noise_is_no_pile() -> None:
    silent = Noise(0.0, 0.0)
    even = signals(silent, flat=True)
    assert found([image.astype(np.float32) for image in even], Noise(1e-4, 0.0)) == ()
    assert found(codes(even, 255), Noise(0.0011, 0.0)) == ()


def test_where_noise_is_less_than_a_step_several_images_must_end_at_the_level() -> None:
    silent = Noise(0.0, 0.0)
    clipped = [image.clip(0, 90) for image in codes(signals(silent), 255)]
    assert found(clipped, Noise(0.0011, 0.0)) == (90, 90, 90)
    assert found(clipped[:1], Noise(0.0011, 0.0)) == ()
