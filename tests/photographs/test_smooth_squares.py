"""Squares of pixels that four or nine samples replace."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from matest.photographs.smooth_squares import (
    LARGE,
    LARGE_SIDE,
    LARGE_TO_SMALL,
    PIXELS_TO_SMALL,
    SMALL_NODES,
    SMALL_PER_LARGE,
    SMALL_PIXELS,
    SMALL_SHARE,
    SMALL_TO_LARGE,
    find_squares,
    rows_of_large,
)
from tests.captures import point, scene_of, sphere_surface


def test_the_four_samples_of_a_small_square_carry_its_bilinear_part() -> None:
    rows, columns = np.meshgrid(np.arange(7) - 3.0, np.arange(7) - 3.0, indexing="ij")
    plane = torch.from_numpy(2 + 0.5 * rows - 0.3 * columns + 0.1 * rows * columns).flatten()
    torch.testing.assert_close(PIXELS_TO_SMALL @ plane, plane[list(SMALL_NODES)])


def test_the_four_samples_of_a_small_square_are_independent_and_as_precise_as_twelve_pixels_and_a_quarter() -> None:
    torch.testing.assert_close(PIXELS_TO_SMALL @ PIXELS_TO_SMALL.T, torch.eye(4, dtype=torch.float64) / SMALL_SHARE)


def test_quadratic_shading_keeps_its_mean() -> None:
    rows, columns = np.meshgrid(np.arange(7) - 3.0, np.arange(7) - 3.0, indexing="ij")
    curved = torch.from_numpy(rows**2 + 0.5 * columns**2 - columns).flatten()
    torch.testing.assert_close((PIXELS_TO_SMALL @ curved).mean(), curved.mean())
    torch.testing.assert_close(PIXELS_TO_SMALL @ curved, curved[list(SMALL_NODES)])


def _steps(places: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns, from the centre of a large square."""
    rows, columns = np.meshgrid(places, places, indexing="ij")
    return rows.ravel().astype(float), columns.ravel().astype(float)


def _biquadratic(rows: np.ndarray, columns: np.ndarray) -> torch.Tensor:
    x, y = columns / 8, rows / 8
    return torch.from_numpy(1 + 0.3 * x - 0.7 * y + 0.2 * x * y + 0.5 * x**2 - 0.4 * y**2 * x + 0.1 * x**2 * y**2)


def test_the_nine_samples_of_a_large_square_carry_its_biquadratic_part() -> None:
    whole = _biquadratic(*_steps(tuple(range(-10, 11)))).reshape(3, 7, 3, 7)
    small = whole.permute(1, 3, 0, 2).reshape(SMALL_PIXELS, SMALL_PER_LARGE)
    samples = SMALL_TO_LARGE @ rows_of_large((PIXELS_TO_SMALL @ small).reshape(4, 1, SMALL_PER_LARGE))[:, 0]
    torch.testing.assert_close(samples, _biquadratic(*_steps((-8, 0, 8)))[:, None])
    torch.testing.assert_close((LARGE_TO_SMALL @ samples)[:, 0], _biquadratic(*_steps((-9, -5, -2, 2, 5, 9))))
    torch.testing.assert_close((LARGE.checks @ samples)[:, 0], _biquadratic(*_steps((-4, 4))))


def test_the_nine_samples_of_a_large_square_are_as_precise_as_its_pixels() -> None:
    rows, columns = _steps(tuple(range(-10, 11)))
    down, across = _steps((-8, 0, 8))
    assert float(LARGE.shares.sum()) == pytest.approx(LARGE_SIDE**2)
    for powers in ((0, 0), (1, 0), (0, 1), (1, 1)):
        of_pixels, of_samples = ((y ** powers[0] * x ** powers[1]) ** 2 for y, x in ((rows, columns), (down, across)))
        assert float((LARGE.shares.numpy() * of_samples).sum()) == pytest.approx(of_pixels.sum())
    for x, y in ((columns, across), (rows, down)):
        # Parabolas about their mean: a little less, never more.
        of_pixels = ((x**2 - (x**2).mean()) ** 2).sum()
        of_samples = float((LARGE.shares.numpy() * (y**2 - (x**2).mean()) ** 2).sum())
        assert 0.93 * of_pixels < of_samples < of_pixels


def test_squares_are_found_only_where_the_beams_of_leds_are_smooth() -> None:
    surface = sphere_surface(96)
    surface = replace(surface, positions=surface.normals)
    blocks = np.zeros(len(surface), dtype=np.int64)
    lamp = point((0.5, 0.0, 4.0))
    beam = replace(lamp, axis=torch.tensor([0.0, 0.0, -1.0], dtype=torch.float64))
    merged = [
        find_squares(scene_of(surface, light), blocks).small.shape[1]
        for light in (lamp, beam, replace(beam, anisotropy=300.0))
    ]
    assert merged[0] > 20
    assert merged[1] == merged[0]
    assert merged[2] < merged[0]
