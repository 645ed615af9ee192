"""Tiles in which a few samples replace the pixels of smooth squares."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from matest.brdf import CookTorrance, OrenNayar
from matest.estimators import Problem, accumulate
from matest.estimators.moments import SCORES
from matest.photographs.noise import Noise
from matest.photographs.photometry import Encoding
from matest.photographs.pixel_merging import PixelMerger
from matest.photographs.samples import PhotographSamples
from matest.photographs.smooth_squares import LARGE, SMALL, SMALL_PER_LARGE, SMALL_PIXELS
from tests.problems import problem
from tests.simulated import Studio, coloured

SIZE = 256
MATERIALS = {
    "oren-nayar": OrenNayar((0.7, 0.5, 0.3), 0.6),
    "cook-torrance": CookTorrance((0.4, 0.2, 0.1), 0.8, 0.3, 0.04),
}


def samples(expression: str = "oren-nayar", seed: int = 0) -> PhotographSamples:
    return Studio(size=SIZE, lights=coloured()).photograph(MATERIALS[expression], seed=seed).samples()


def truth(expression: str) -> tuple[Problem, torch.Tensor]:
    chosen = problem(expression, channels=3)
    values = MATERIALS[expression].parameters
    parts = [values[name].expand(chosen.count(name)) if chosen.count(name) > 1 else values[name].reshape(1)
             for name in chosen.free]  # fmt: skip
    return chosen, torch.cat(parts).double()


def test_every_usable_pixel_counts_once() -> None:
    chosen = samples()
    merger = PixelMerger(chosen)
    for position, count in enumerate(chosen.counts):
        tiles = [merger.tile(position, part) for part in range(merger.parts(position))]
        assert sum(float(tile.means.pixels.sum()) for tile in tiles) == pytest.approx(count, rel=1e-6)
        assert all(len(tile.batch.groups) == len(tile) for tile in tiles)
        assert sum(len(tile) for tile in tiles) < count / 3


def test_blocks_of_pixels_keep_their_labels() -> None:
    chosen = samples()
    merged, single = (accumulate(*truth("oren-nayar"), chosen.tiles(merge=merge), None) for merge in (True, False))
    assert torch.equal(merged.labels, single.labels)
    counts = [found.scores[:, SCORES.index("samples")].numpy() for found in (merged, single)]
    # A large square on the border of two blocks belongs to one of them.
    np.testing.assert_allclose(*counts, atol=42 * SIZE / 4)


@pytest.mark.parametrize("expression", MATERIALS)
def test_merged_pixels_say_what_single_ones_do(expression: str) -> None:
    chosen = samples(expression)
    unknown, at = truth(expression)
    single, merged = (accumulate(unknown, at, chosen.tiles(merge=merge), at) for merge in (False, True))
    assert merged.total("evaluated") < 0.7 * single.total("evaluated")
    assert merged.total("samples") == single.total("samples")
    std = torch.linalg.inv(single.information).diagonal().sqrt()
    torch.testing.assert_close(
        torch.linalg.inv(merged.information).diagonal().sqrt(), std, rtol=2e-3, atol=0
    )  # fmt: skip
    steps = [torch.linalg.solve(found.information, found.gradient) / std for found in (single, merged)]
    assert float((steps[1] - steps[0]).abs().max()) < 0.1
    assert merged.reduced_chi2 == pytest.approx(single.reduced_chi2, rel=2e-3)
    assert merged.total("squared_signal") == pytest.approx(single.total("squared_signal"), rel=1e-5)


def test_a_spoilt_pixel_leaves_its_small_square_single_and_the_others_of_the_large_one_merged() -> None:
    chosen = samples()
    squares = PixelMerger(chosen).squares
    middle = squares.small[:, SMALL_PER_LARGE * (squares.large.shape[1] // 2)]
    stored = [image.copy() for image in chosen.photographs.stored]
    stored[0][middle[5]] = 0.9 * stored[0].max()
    spoilt = replace(chosen.photographs, stored=tuple(stored)).samples(chosen.images)
    before, after = (PixelMerger(some).tile(0, 0) for some in (chosen, spoilt))
    assert after.merged is not None
    assert before.merged is not None
    (large, small), (fewer, more) = ([count for _, count in batch.merged.tiers] for batch in (before, after))
    assert (fewer, more) == (large - 1, small + 8)
    assert len(after) - len(before) == SMALL_PIXELS + 8 * SMALL.size - LARGE.size


def test_saturated_pixels_stay_single() -> None:
    studio = Studio(size=SIZE, lights=coloured())
    bright = studio.photograph(MATERIALS["cook-torrance"], seed=0).photographs
    stored = tuple(np.round(65535 * image.clip(0, 1)).astype(np.uint16) for image in 4 * np.stack(bright.stored))
    capture = replace(bright, stored=stored, encoding=Encoding(saturation=1.0), exposures=(4.0,) * len(stored))
    chosen = replace(capture, noise=Noise(0.008, 0.002)).samples()
    merger = PixelMerger(chosen)
    clipped = 0
    for position in range(len(chosen.images)):
        tile = merger.tile(position, 0)
        assert tile.merged is not None
        if (of_tile := tile.batch.noise.clipped) is not None:
            assert not bool(of_tile[: sum(tier.size * count for tier, count in tile.merged.tiers)].any())
            clipped += int((of_tile > 0).any(-1).sum())
    assert clipped == chosen.skipped["saturated"] > 100


def test_creases_and_noisy_normals_are_not_smooth() -> None:
    chosen = samples()
    surface = chosen.photographs.scene.surface
    generator = torch.Generator().manual_seed(0)
    noisy = surface.normals + 0.003 * torch.randn(surface.normals.shape, generator=generator, dtype=torch.float64)
    columns = surface.pixels % SIZE
    creased = surface.normals.clone()
    creased[torch.from_numpy(columns > SIZE // 2)] = torch.tensor([0.6, 0.0, 0.8], dtype=torch.float64)
    for normals, smooth in ((noisy, False), (creased, True)):
        rough = replace(surface, normals=normals / normals.norm(dim=-1)[:, None])
        scene = replace(chosen.photographs.scene, surface=rough)
        squares = PixelMerger(replace(chosen.photographs, scene=scene).samples(chosen.images)).squares
        assert bool(squares.small.size) == smooth
        across = columns[squares.small]
        assert not ((across <= SIZE // 2).any(0) & (across > SIZE // 2).any(0)).any()


def test_small_surfaces_are_not_merged() -> None:
    chosen = Studio(size=64, lights=coloured()).photograph(MATERIALS["oren-nayar"], seed=0).samples()
    assert not PixelMerger(chosen).squares.small.size
    assert PixelMerger(chosen).tile(0, 0).merged is None
