from __future__ import annotations

import numpy as np
import pytest
import torch

from matest.scene import Surface
from matest.scene.rim import near_silhouette
from matest.scene.shadow_grid import Grid

SHAPE = (203, 170)


def flat(mask: np.ndarray) -> Surface:
    """A plane seen through a mask."""
    pixels = np.flatnonzero(mask).astype(np.int32)
    normals = torch.tensor([[0.0, 0.0, 1.0]]).expand(len(pixels), 3)
    return Surface(mask.shape, pixels, normals, normals[:1], None, near_silhouette(mask.shape, pixels))


@pytest.fixture
def surface() -> Surface:
    rows, columns = np.indices(SHAPE)
    mask = np.hypot(rows - 100, columns - 90) < 75
    mask[60:70, 60:70] = False
    return flat(mask)


@pytest.mark.parametrize("width", [0.7, 3.0, 30.0], ids=["a line", "a band", "a broad band"])
def test_a_connected_shadow_is_found_whole_from_few_rays(surface, width):
    rows, columns = np.divmod(surface.pixels, SHAPE[1])
    truth = np.abs(rows - 110 - 30 * np.sin(columns / 25)) < width
    facing = columns > 40
    rays = []

    def blocked(index: np.ndarray) -> np.ndarray:
        rays.append(index)
        return truth[index]

    shadow = Grid.over(surface).shadow(facing, blocked)
    np.testing.assert_array_equal(shadow, truth & facing)
    index = np.concatenate(rays)
    assert len(np.unique(index)) == len(index) < 0.6 * len(surface)
    assert facing[index].all()


def test_a_grid_serves_several_lights(surface):
    grid = Grid.over(surface)
    columns = surface.pixels % SHAPE[1]
    for edge in (50, 100, 130):
        truth = columns < edge
        shadow = grid.shadow(np.ones(len(surface), bool), lambda index, truth=truth: truth[index])
        np.testing.assert_array_equal(shadow, truth)


def test_every_pixel_is_a_member_of_its_cell(surface):
    grid = Grid.over(surface)
    index = np.arange(len(surface))
    assert (grid.members[grid.cell] == index[:, None]).any(axis=1).all()
    np.testing.assert_array_equal(np.sort(grid.members[grid.members >= 0]), index)
