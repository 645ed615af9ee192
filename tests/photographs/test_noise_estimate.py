"""Noise estimated from photographs: right within its standard errors, whatever the surface and the codes."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from matest.photographs.noise import Noise, quantisation, rounding, steps
from matest.photographs.noise_estimate import noise_of_photographs
from matest.photographs.photometry import Encoding
from matest.photographs.windows import windows
from matest.scene import Surface
from tests.captures import sphere_surface

READ, GAIN = 0.004, 0.0006
DIRECTIONS = [(0.2, 0.3, 1.0), (-0.5, 0.1, 0.8), (0.6, -0.4, 0.9), (0.0, -0.7, 0.7)]
SURFACE = sphere_surface(256)
WINDOWS = windows(SURFACE)


def signals(paint: np.ndarray | float = 1.0) -> list[np.ndarray]:
    """Signal [N, 1] of a painted sphere with a soft highlight under four lights."""
    normals = SURFACE.normals.numpy()
    cosines = [np.clip(normals @ (np.array(d) / np.linalg.norm(d)), 0, None)[:, None] for d in DIRECTIONS]
    return [(0.6 * cosine + 0.25 * cosine**20) * paint for cosine in cosines]


def photographs(read: float, gain: float, seed: int, paint: np.ndarray | float = 1.0) -> list[np.ndarray]:
    """Four photographs with noise of variance read² + gain · signal."""
    rng = np.random.default_rng(seed)
    return [s + rng.normal(size=s.shape) * np.sqrt(read**2 + gain * s) for s in signals(paint)]


def in_standard_errors(noise: Noise, read: float, gain: float) -> tuple[float, float]:
    """Errors of read² and of the gain."""
    read2_std = (noise.read + noise.read_std) ** 2 - noise.read**2
    return (noise.read**2 - read**2) / read2_std, (noise.gain - gain) / noise.gain_std


@pytest.mark.parametrize(("read", "gain"), [(READ, GAIN), (0.01, 0.001), (0.002, 0.0001), (0.005, 0.0), (0.0, 0.001)])
def test_read_noise_and_gain_are_found_within_their_standard_errors(read: float, gain: float) -> None:
    errors = []
    for seed in range(8):
        noise = noise_of_photographs(photographs(read, gain, seed), Encoding(), WINDOWS)
        assert noise.read**2 + 0.4 * noise.gain == pytest.approx(read**2 + 0.4 * gain, rel=0.1)
        errors.append(in_standard_errors(noise, read, gain))
    # Sixteen errors, some of them cut off at zero: none beyond four, their root mean square not far from one.
    assert np.abs(errors).max() < 4
    assert np.sqrt(np.square(errors).mean()) < 1.7


@pytest.mark.parametrize("size", [3.0, 1e3, 1e9, -1e9, 1e14])
def test_one_wild_pixel_does_not_change_the_noise(size: float) -> None:
    images = [image.astype(np.float32) for image in photographs(READ, GAIN, 0)]
    clean = noise_of_photographs(images, Encoding(), WINDOWS)
    images[1][WINDOWS[len(WINDOWS) // 2, 3]] = size
    noise = noise_of_photographs(images, Encoding(), WINDOWS)
    assert abs(noise.read - clean.read) < 0.3 * clean.read_std
    assert abs(noise.gain - clean.gain) < 0.3 * clean.gain_std


def test_a_hundredth_of_wild_pixels_of_every_size_moves_the_noise_by_no_more_than_it_is_uncertain() -> None:
    shifts = []
    for seed in range(6):
        images = photographs(READ, GAIN, seed)
        clean = noise_of_photographs(images, Encoding(), WINDOWS)
        rng = np.random.default_rng(seed)
        for image in images:
            wild = rng.random(len(image)) < 0.01
            image[wild] = 10 ** rng.uniform(-3, 6, (int(wild.sum()), 1)) * rng.choice([-1, 1], (int(wild.sum()), 1))
        noise = noise_of_photographs(images, Encoding(), WINDOWS)
        shifts.append([(noise.read - clean.read) / clean.read_std, (noise.gain - clean.gain) / clean.gain_std])
    # Without a tenth of the windows it would move by a third of its error anyhow.
    assert np.sqrt(np.square(shifts).mean(axis=0)).max() < 1


def test_the_edge_of_a_shadow_is_not_wild() -> None:
    shadow = np.where(SURFACE.pixels % SURFACE.shape[1] < 100, 0.3, 1.0)[:, None]
    for seed in range(3):
        images = photographs(READ, GAIN, seed, shadow)
        noise = noise_of_photographs(images, Encoding(), WINDOWS)
        assert noise.gain == pytest.approx(GAIN, abs=4 * noise.gain_std)


def test_fewer_photographs_give_larger_standard_errors() -> None:
    images = photographs(READ, GAIN, 0)
    one, four = (noise_of_photographs(images[:count], Encoding(), WINDOWS) for count in (1, 4))
    assert 1.4 < one.gain_std / four.gain_std < 4


# Less noise than a third of a step leaves no trace beside the rounding: those of sRGB are twice as large in the light.
@pytest.mark.parametrize(
    ("transfer", "read"), [("linear", 0.0015), ("linear", 0.002), ("linear", 0.003), ("srgb", 0.002), ("srgb", 0.003)]
)
def test_noise_of_less_than_a_code_is_found_in_8_bit_images(transfer: str, read: float) -> None:
    encoding = Encoding(transfer)
    lit = [image * (image > 0.05) for image in photographs(read, 0.0, 6)]
    codes = [np.round(encoding.encoded(image).clip(0, 1) * 255).astype(np.uint8) for image in lit]
    noise = noise_of_photographs(codes, encoding, WINDOWS)
    for level in (0.2, 0.5):
        factor, power = rounding(encoding, codes[0].dtype)
        step = steps(transfer, 255)[round(float(encoding.encoded(np.array(level))) * 255)]
        estimated = noise.read**2 + noise.gain * level + factor * level**power
        assert estimated == pytest.approx(read**2 + float(step) ** 2 / 12, rel=0.1)


def test_shading_without_noise_counts_for_less_than_a_thousandth() -> None:
    noise = noise_of_photographs(photographs(0.0, 0.0, 0), Encoding(), WINDOWS)
    assert math.sqrt(noise.read**2 + noise.gain * 0.5) < 1e-3


def test_the_edges_of_a_checkerboard_are_no_noise() -> None:
    rows, columns = np.divmod(SURFACE.pixels, 256)
    paint = np.where((rows // 16 + columns // 16) % 2, 1.0, 0.6)[:, None]
    noise = noise_of_photographs(photographs(READ, GAIN, 5, paint), Encoding(), WINDOWS)
    assert noise.read == pytest.approx(READ, rel=0.15)
    assert noise.gain == pytest.approx(GAIN, rel=0.1)


def test_noise_is_never_below_that_of_rounding() -> None:
    codes = [np.round(255 * image).astype(np.uint8) for image in signals()]
    noise = noise_of_photographs(codes, Encoding(), WINDOWS)
    assert noise.read >= quantisation(Encoding(), np.dtype(np.uint8))


def test_too_few_pixels_fall_back_to_rounding() -> None:
    pixels = np.array([27, 28, 35, 36])
    surface = Surface(
        (8, 8), pixels, torch.eye(3)[[2] * 4].double(), torch.eye(3)[[2]].double(), None, np.zeros(4, bool)
    )
    codes = [np.full((4, 1), 128, np.uint8)]
    noise = noise_of_photographs(codes, Encoding(), windows(surface))
    assert noise == Noise(quantisation(Encoding(), codes[0].dtype), 0.0)


def test_values_cut_off_at_black_do_not_make_the_noise_look_small() -> None:
    # Half of the sphere is as dark as the noise.
    images = [0.004 + image * (SURFACE.normals[:, 0] > 0).numpy()[:, None] for image in signals()]
    rng = np.random.default_rng(3)
    noisy = [image + rng.normal(size=image.shape) * np.sqrt(READ**2 + GAIN * image) for image in images]
    codes = [np.round(65535 * image.clip(0, 1)).astype(np.uint16) for image in noisy]
    noise = noise_of_photographs(codes, Encoding(), WINDOWS)
    assert np.abs(in_standard_errors(noise, READ, GAIN)).max() < 3


def test_clipped_pixels_and_the_rim_do_not_disturb_the_noise() -> None:
    surface = sphere_surface(96)
    rng = np.random.default_rng(11)
    signal = 0.9 * surface.normals[:, 2:].numpy()
    images = [signal + rng.normal(size=signal.shape) * np.sqrt(READ**2 + GAIN * signal) for _ in range(4)]
    for image in images:
        image[surface.rim] = rng.random((int(surface.rim.sum()), 1))
    stored = [np.round(65535 * image.clip(0, 0.7)).astype(np.uint16) for image in images]
    noise = noise_of_photographs(stored, Encoding(saturation=0.69), windows(surface))
    assert noise.read**2 + 0.5 * noise.gain == pytest.approx(READ**2 + 0.5 * GAIN, rel=0.1)
