from __future__ import annotations

import math

import numpy as np
import pytest

from matest.photographs.noise import (
    FLOAT_FLOOR,
    Noise,
    estimate_noise,
    noise_of_photographs,
    quantisation,
    rounding,
    stated_noise,
    steps,
)
from matest.photographs.photometry import Encoding
from tests.captures import sphere_surface

READ, GAIN = 0.004, 0.0006


def shaded_sphere(size: int, direction: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Signal H×W×1 of a Lambertian sphere with a soft highlight, and the pixels well inside it."""
    axis = (np.arange(size) + 0.5) / size * 2.2 - 1.1
    x, y = np.meshgrid(axis, -axis)
    squared = x**2 + y**2
    normals = np.stack([x, y, np.sqrt(np.clip(1 - squared, 0, None))], axis=-1)
    cosine = np.clip(normals @ (np.array(direction) / np.linalg.norm(direction)), 0, None)
    signal = np.where(squared < 1, 0.6 * cosine + 0.25 * cosine**20, 0.0)
    return signal[..., None], squared < 0.95**2


def photographs(
    read: float, gain: float, seed: int, paint: np.ndarray | float = 1.0
) -> tuple[list[np.ndarray], np.ndarray]:
    """Four photographs of a painted sphere, each with noise of variance read² + gain · signal."""
    rng = np.random.default_rng(seed)
    images = []
    for direction in [(0.2, 0.3, 1.0), (-0.5, 0.1, 0.8), (0.6, -0.4, 0.9), (0.0, -0.7, 0.7)]:
        signal, inside = shaded_sphere(256, direction)
        signal = signal * paint
        images.append(signal + rng.normal(size=signal.shape) * np.sqrt(read**2 + gain * signal))
    return images, [np.broadcast_to((inside)[..., None], image.shape) for image in images]


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


# Less noise than a third of a step leaves no trace beside the rounding: those of sRGB are twice as large in the light.
@pytest.mark.parametrize(
    ("transfer", "read"), [("linear", 0.0015), ("linear", 0.002), ("linear", 0.003), ("srgb", 0.002), ("srgb", 0.003)]
)
def test_noise_of_less_than_a_code_is_found_in_8_bit_images(transfer, read):
    images, inside = photographs(read, 0.0, 6)
    encoding = Encoding(transfer)
    codes = [np.round(encoding.encoded(image).clip(0, 1) * 255).astype(np.uint8) for image in images]
    linear = [encoding.linear(code / 255) for code in codes]

    def step(signal: np.ndarray) -> np.ndarray:
        return steps(transfer, 255)[np.round(encoding.encoded(signal).clip(0, 1) * 255).astype(int)]

    lit = [image > 0.05 for image in linear]
    floor = quantisation(encoding, codes[0].dtype)
    noise = estimate_noise(linear, [a & b for a, b in zip(inside, lit, strict=True)], floor, step)
    for level in (0.2, 0.5):
        factor, power = rounding(encoding, codes[0].dtype)
        found = noise.read**2 + noise.gain * level + factor * level**power
        true = read**2 + float(step(np.array([level]))[0]) ** 2 / 12
        assert found == pytest.approx(true, rel=0.1)


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize(("read", "gain"), [(READ, GAIN), (0.01, 0.001), (0.002, 0.0001)])
def test_read_noise_and_gain_are_found_in_photographs_of_a_sphere(read, gain, seed):
    noise = estimate_noise(*photographs(read, gain, seed), floor=0.0)
    assert noise.read == pytest.approx(read, rel=0.1)
    assert noise.gain == pytest.approx(gain, rel=0.1)


def test_read_noise_alone_is_found():
    noise = estimate_noise(*photographs(0.005, 0.0, 3), floor=0.0)
    assert noise.read == pytest.approx(0.005, rel=0.1)
    assert noise.gain < 0.05 * 0.005**2 / 0.5


def test_photon_noise_alone_is_found():
    noise = estimate_noise(*photographs(0.0, 0.001, 4), floor=0.0)
    assert noise.gain == pytest.approx(0.001, rel=0.1)
    assert noise.read**2 < 0.05 * 0.001 * 0.5


def test_shading_without_noise_counts_for_less_than_a_thousandth():
    images, inside = photographs(0.0, 0.0, 0)
    noise = estimate_noise(images, inside, floor=0.0)
    assert np.sqrt(noise.read**2 + noise.gain * 0.5) < 1e-3


def test_the_edges_of_a_checkerboard_are_no_noise():
    rows, columns = np.indices((256, 256)) // 16
    paint = np.where((rows + columns) % 2, 1.0, 0.6)[..., None]
    noise = estimate_noise(*photographs(READ, GAIN, 5, paint), floor=0.0)
    assert noise.read == pytest.approx(READ, rel=0.1)
    assert noise.gain == pytest.approx(GAIN, rel=0.1)


def test_noise_is_never_below_the_floor():
    images, inside = photographs(0.0, 0.0, 0)
    assert estimate_noise(images, inside, floor=0.01).read >= 0.01


def test_too_few_pixels_fall_back_to_the_floor():
    inside = np.zeros((8, 8), bool)
    inside[3:5, 3:5] = True
    assert estimate_noise([np.full((8, 8, 1), 0.5)], [inside[..., None]], floor=0.003) == Noise(0.003, 0.0)


def test_rounding_to_integers_adds_to_the_noise_of_the_sensor():
    noise = Noise(0.002, GAIN).with_rounding(Encoding(), np.dtype(np.uint8))
    assert noise == Noise(pytest.approx(math.hypot(0.002, 1 / 255 / math.sqrt(12))), GAIN)
    assert Noise(0.002, GAIN).with_rounding(Encoding(), np.dtype(np.float32)) == Noise(0.002, GAIN)


def test_floats_stated_to_be_without_noise_are_as_good_as_their_geometry():
    pixels = np.array([[0.2], [0.8]], np.float32)
    assert stated_noise(Noise(0.0, 0.0), Encoding(), pixels).read == pytest.approx(FLOAT_FLOOR * 0.8)
    assert stated_noise(Noise(0.0, GAIN), Encoding(), 0 * pixels).read > 0
    assert stated_noise(Noise(READ, GAIN), Encoding(), pixels) == Noise(READ, GAIN)


def test_clipped_pixels_and_the_rim_do_not_disturb_the_noise_of_photographs():
    surface = sphere_surface(96)
    rng = np.random.default_rng(11)
    signal = 0.9 * surface.normals[:, 2:].numpy()
    images = [signal + rng.normal(size=signal.shape) * np.sqrt(READ**2 + GAIN * signal) for _ in range(4)]
    for image in images:
        image[surface.rim] = rng.random((int(surface.rim.sum()), 1))
    stored = [np.round(65535 * image.clip(0, 0.7)).astype(np.uint16) for image in images]
    noise = noise_of_photographs(stored, Encoding(saturation=0.69), surface)
    assert noise.read**2 + 0.5 * noise.gain == pytest.approx(READ**2 + 0.5 * GAIN, rel=0.1)
