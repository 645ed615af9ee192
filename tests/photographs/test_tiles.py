"""The samples of photographs tile by tile."""

from __future__ import annotations

import pytest
import torch

from matest.photographs.tiles import ImageTiles
from tests.photographs.studio import LEFT, RIGHT, photograph, sphere_scene


@pytest.mark.parametrize("images", [1, 2, 5])
def test_a_small_capture_has_two_tiles_at_most(images: int) -> None:
    scene = sphere_scene(((LEFT,), (RIGHT,)) * 2 + ((LEFT,),), (0.0,) * 5)
    samples = photograph(scene).samples(range(images))
    (tiles,) = ImageTiles(samples)
    assert len(tiles) == min(images, 2)
    batches = [tile().batch for tile in tiles]
    assert sum(map(len, batches)) == len(samples)
    every = torch.cat([samples.at(k, samples.indices(k)).radiance for k in range(images)])
    torch.testing.assert_close(torch.cat([batch.radiance for batch in batches]).sort(0)[0], every.sort(0)[0])


def test_images_of_a_larger_capture_come_a_few_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("matest.photographs.tiles._TWO_TILES", 1)
    samples = photograph(sphere_scene(((LEFT,), (RIGHT,)) * 3, (0.0,) * 6)).samples()
    parts = list(ImageTiles(samples))
    assert [len(tiles) for tiles in parts] == [4, 2]
    assert sum(len(tile().batch) for tiles in parts for tile in tiles) == len(samples)


def test_an_image_without_usable_pixels_adds_nothing_to_a_tile() -> None:
    samples = photograph(sphere_scene(((LEFT,), ()), (0.0, 0.0))).samples()
    assert samples.counts[1] == 0
    (tiles,) = ImageTiles(samples)
    assert sum(len(tile().batch) for tile in tiles) == len(samples) == samples.counts[0]
