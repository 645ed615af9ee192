"""Patches of pixels that four samples stand for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from matest.brdf import CookTorrance, OrenNayar
from matest.capture import Samples
from matest.capture.patches import NODES, PIXELS, PROJECTION, SHARE, Patches
from matest.capture.photometry import Encoding, Noise
from matest.estimators import AllTiles, Problem, accumulate
from tests.problems import problem
from tests.simulated import Studio, coloured

SIZE = 256
MATERIALS = {
    "oren-nayar": OrenNayar((0.7, 0.5, 0.3), 0.6),
    "cook-torrance": CookTorrance((0.4, 0.2, 0.1), 0.8, 0.3, 0.04),
}


def samples(expression: str = "oren-nayar", seed: int = 0) -> Samples:
    return Studio(size=SIZE, lights=coloured()).photograph(MATERIALS[expression], seed=seed).samples()


def truth(expression: str) -> tuple[Problem, torch.Tensor]:
    chosen = problem(expression, channels=3)
    values = MATERIALS[expression].parameters
    parts = [values[name].expand(chosen.count(name)) if chosen.count(name) > 1 else values[name].reshape(1)
             for name in chosen.free]  # fmt: skip
    return chosen, torch.cat(parts).double()


def test_the_four_of_a_patch_carry_its_bilinear_part() -> None:
    rows, columns = np.meshgrid(np.arange(7) - 3.0, np.arange(7) - 3.0, indexing="ij")
    plane = torch.from_numpy(2 + 0.5 * rows - 0.3 * columns + 0.1 * rows * columns).flatten()
    torch.testing.assert_close(PROJECTION @ plane, plane[list(NODES)])


def test_the_four_of_a_patch_are_independent_and_as_precise_as_twelve_pixels_and_a_quarter() -> None:
    torch.testing.assert_close(PROJECTION @ PROJECTION.T, torch.eye(4, dtype=torch.float64) / SHARE)


def test_quadratic_shading_keeps_its_mean() -> None:
    rows, columns = np.meshgrid(np.arange(7) - 3.0, np.arange(7) - 3.0, indexing="ij")
    curved = torch.from_numpy(rows**2 + 0.5 * columns**2 - columns).flatten()
    torch.testing.assert_close((PROJECTION @ curved).mean(), curved.mean())
    torch.testing.assert_close(PROJECTION @ curved, curved[list(NODES)])


def test_every_usable_pixel_counts_once() -> None:
    chosen = samples()
    patches = Patches(chosen)
    for position, count in enumerate(chosen.counts):
        batches = [patches.batch(position, part) for part in range(patches.parts(position))]
        assert sum(float(batch.copies.sum()) for batch in batches) == count
        assert all(sum(length for _, length in batch.runs) == len(batch) for batch in batches)
        assert sum(len(batch) for batch in batches) < count / 3


def test_blocks_of_pixels_keep_their_labels() -> None:
    chosen = samples()
    merged, single = (accumulate(*truth("oren-nayar"), AllTiles(chosen, merge), None) for merge in (True, False))
    assert merged.clusters.keys() == single.clusters.keys()
    for label, sums in single.clusters.items():
        # A patch on the border of two blocks belongs to one of them.
        assert merged.clusters[label].scores.samples == pytest.approx(sums.scores.samples, abs=14 * SIZE / 4)


@pytest.mark.parametrize("expression", MATERIALS)
def test_merged_pixels_say_what_single_ones_do(expression: str) -> None:
    chosen = samples(expression)
    unknown, at = truth(expression)
    single, merged = (accumulate(unknown, at, AllTiles(chosen, merge), at) for merge in (False, True))
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


def test_a_spoilt_pixel_leaves_its_patch_single() -> None:
    chosen = samples()
    patches = Patches(chosen)
    patch = patches.pixels[len(patches.pixels) // 2]
    stored = [image.copy() for image in chosen.capture.stored]
    stored[0][patch[5]] = 0.9 * stored[0].max()
    spoilt = Samples(replace(chosen.capture, stored=tuple(stored)), chosen.images, chosen.dtype, chosen.device)
    before, after = (Patches(some).batch(0, 0) for some in (chosen, spoilt))
    assert after.merged is not None
    assert before.merged is not None
    assert after.merged.count == before.merged.count - 1
    assert len(after) - len(before) == PIXELS - 5


def test_saturated_pixels_stay_single() -> None:
    studio = Studio(size=SIZE, lights=coloured())
    bright = studio.photograph(MATERIALS["cook-torrance"], seed=0)
    stored = tuple(np.round(65535 * image.clip(0, 1)).astype(np.uint16) for image in 4 * np.stack(bright.stored))
    capture = replace(bright, stored=stored, encoding=Encoding(saturation=1.0), exposures=(4.0,) * len(stored))
    chosen = replace(capture, noise=Noise(0.008, 0.002)).samples()
    patches = Patches(chosen)
    clipped = 0
    for position in range(len(chosen.images)):
        batch = patches.batch(position, 0)
        assert batch.merged is not None
        if batch.clipped is not None:
            assert not bool(batch.clipped[: 5 * batch.merged.count].any())
            clipped += int((batch.clipped > 0).any(-1).sum())
    assert clipped == chosen.skipped["saturated"] > 100


def test_creases_and_noisy_normals_are_not_smooth() -> None:
    chosen = samples()
    surface = chosen.capture.scene.surface
    generator = torch.Generator().manual_seed(0)
    noisy = surface.normals + 0.003 * torch.randn(surface.normals.shape, generator=generator, dtype=torch.float64)
    columns = surface.pixels % SIZE
    creased = surface.normals.clone()
    creased[torch.from_numpy(columns > SIZE // 2)] = torch.tensor([0.6, 0.0, 0.8], dtype=torch.float64)
    for normals, smooth in ((noisy, False), (creased, True)):
        scene = replace(chosen.capture.scene, surface=replace(surface, normals=normals / normals.norm(dim=-1)[:, None]))
        found = Patches(Samples(replace(chosen.capture, scene=scene), chosen.images, chosen.dtype, chosen.device))
        assert bool(len(found.pixels)) == smooth
        across = columns[found.pixels]
        assert not ((across <= SIZE // 2).any(1) & (across > SIZE // 2).any(1)).any()


def test_small_surfaces_are_not_merged() -> None:
    chosen = Studio(size=64, lights=coloured()).photograph(MATERIALS["oren-nayar"], seed=0).samples()
    assert not len(Patches(chosen).pixels)
    assert Patches(chosen).batch(0, 0).merged is None
