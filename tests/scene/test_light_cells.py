"""Cells of a map of light."""

from __future__ import annotations

import numpy as np

from matest.scene.light_cells import light_cells
from tests import environments

ROWS = 32
GRID = environments.grid(ROWS)
SUN = np.array([0.5, 0.7, 0.51])


def powers(radiance: np.ndarray) -> np.ndarray:
    return (radiance * environments.solid_angles(ROWS)[:, None])[..., None]


def test_cells_share_out_all_light_once() -> None:
    light = powers(environments.studio(GRID))
    cells = light_cells(light, GRID, 100)
    assert len(cells.powers) == 100
    by_label = np.bincount(cells.labels.ravel(), light.ravel())
    np.testing.assert_allclose(cells.powers[:, 0], by_label, rtol=1e-9)
    moments = np.stack([np.bincount(cells.labels.ravel(), (light * GRID)[..., axis].ravel()) for axis in range(3)], 1)
    middles = moments / np.linalg.norm(moments, axis=1, keepdims=True)
    np.testing.assert_allclose(cells.directions, middles, atol=1e-9)
    spreads = 1 - np.square(moments).sum(1) / by_label**2
    np.testing.assert_allclose(cells.spreads, spreads, atol=1e-9)


def test_bright_and_compact_light_gets_more_cells() -> None:
    sun = np.arccos((GRID @ (SUN / np.linalg.norm(SUN))).clip(-1, 1)) < 0.3
    cells = light_cells(powers(np.where(sun, 100.0, 1.0)), GRID, 64)
    density = [len(np.unique(cells.labels[part])) / part.sum() for part in (sun, ~sun)]
    assert density[0] > 5 * density[1]


def test_more_cells_spread_less() -> None:
    light = powers(environments.studio(GRID))
    spreads = [light_cells(light, GRID, count).spread for count in (1, 16, 64, 256)]
    assert spreads[0] > 4 * spreads[1] > 12 * spreads[2] > 36 * spreads[3] > 0


def test_texels_are_not_split_and_dark_cells_left_out() -> None:
    radiance = np.zeros((ROWS, 2 * ROWS))
    radiance[5, 7], radiance[20, 40] = 1.0, 2.0
    cells = light_cells(powers(radiance), GRID, 1000)
    assert len(cells.powers) == 2
    assert cells.spread < 1e-12
    expected = [GRID[5, 7], GRID[20, 40]]
    np.testing.assert_allclose(sorted(cells.directions.tolist()), sorted(map(list, expected)), atol=1e-12)
