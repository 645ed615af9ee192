"""The subsample that the search starts from."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from matest.brdf import CookTorrance, Lambert
from matest.photographs.pilot import pilot
from matest.photographs.pixels import BLOCKS
from matest.photographs.samples import PhotographSamples
from matest.samples import Batch
from matest.shading import lit_directions
from tests.captures import directional
from tests.simulated import DIRECTIONS, Studio

QUOTA = 600


def samples(size: int = 160) -> PhotographSamples:
    return Studio(size=size).photograph(CookTorrance(0.3, 0.8, 0.1), seed=0).samples()


def half_angles(batch: Batch) -> np.ndarray:
    """Degrees between the normal and the nearest half vector, of every sample."""
    return torch.rad2deg(lit_directions(batch.points).theta_half[..., 0]).amin(-1).numpy()


def labels(batches: list[Batch]) -> list[int]:
    """The one group of each batch."""
    return [int(label) for batch in batches for label in batch.groups.unique()]


def same(first: list[Batch], second: list[Batch]) -> bool:
    return all(
        torch.equal(a.radiance, b.radiance) and torch.equal(a.points.wo, b.points.wo)
        for a, b in zip(first, second, strict=True)
    )


def test_every_image_gets_its_share() -> None:
    batches = pilot(samples(), 6 * QUOTA, seed=1)
    assert [len(batch) for batch in batches] == [QUOTA] * 6
    assert labels(batches) == [image * BLOCKS for image in range(6)]


def test_samples_are_drawn_without_replacement() -> None:
    for batch in pilot(samples(), 6 * QUOTA, seed=1):
        rows = torch.cat([batch.points.wo, batch.radiance], 1)
        assert len(torch.unique(rows, dim=0)) == QUOTA


@pytest.mark.parametrize("seed", range(3))
def test_the_centre_of_every_highlight_is_there(seed: int) -> None:
    every = samples()
    for image, batch in enumerate(pilot(every, 6 * QUOTA, seed)):
        available = half_angles(every.at(image, every.indices(image)))
        drawn = half_angles(batch)
        # The whole image has few pixels this near to the mirror direction, and an even split has room for them.
        assert (available < 2).sum() < QUOTA / 6
        share = (drawn < 2).sum() / (available < 2).sum()
        expected = min(1.0, 8 * QUOTA / len(available))
        assert share >= expected - 0.25
        assert (drawn < 2).sum() > 3 * QUOTA * (available < 2).mean()


def test_wide_angles_are_thinned_to_equal_shares() -> None:
    for batch in pilot(samples(), 6 * QUOTA, seed=2):
        counts = np.histogram(half_angles(batch), [0, 2, 4, 8, 16, 32, 180])[0]
        assert counts[3:].max() - counts[3:].min() <= 1 or counts[3:].min() < QUOTA / 6
        assert counts.max() < 0.45 * QUOTA


def test_the_same_seed_draws_the_same_samples() -> None:
    assert same(pilot(samples(), 6 * QUOTA, seed=3), pilot(samples(), 6 * QUOTA, seed=3))


def test_another_seed_draws_other_samples() -> None:
    assert not same(pilot(samples(), 6 * QUOTA, seed=3), pilot(samples(), 6 * QUOTA, seed=4))


def test_the_draw_does_not_depend_on_global_random_states() -> None:
    first = pilot(samples(), 6 * QUOTA, seed=5)
    torch.manual_seed(99)
    np.random.seed(99)  # noqa: NPY002
    assert same(pilot(samples(), 6 * QUOTA, seed=5), first)


def test_small_captures_are_taken_whole() -> None:
    every = samples(24)
    batches = pilot(every, 10**5, seed=0)
    assert sum(map(len, batches)) == len(every)
    for image, batch in enumerate(batches):
        assert torch.equal(batch.radiance, every.at(image, every.indices(image)).radiance)


def test_images_of_long_captures_keep_enough_samples() -> None:
    assert [len(batch) for batch in pilot(samples(), 60, seed=0)] == [256] * 6


def test_images_without_usable_pixels_are_passed_over() -> None:
    lights = ((directional(DIRECTIONS[0], 3.0),), (directional((0.0, 0.0, -1.0), 3.0),))
    dark = Studio(size=32, lights=lights).photograph(Lambert(0.5), seed=0).samples()
    assert len(dark.indices(1)) == 0
    assert labels(pilot(dark, 500, seed=0)) == [0]


def test_positions_of_some_images_are_counted_within_them() -> None:
    chosen = Studio(size=32).photograph(Lambert(0.5), seed=0).samples([4, 1])
    batches = pilot(chosen, 512, seed=0)
    assert labels(batches) == [0, BLOCKS]
    toward = chosen.photographs.scene.lights[4][0].direction
    assert float(batches[0].points.wi[0, 0] @ batches[0].points.wo[0]) == pytest.approx(float(toward[2]), abs=1e-6)


def test_light_from_the_sky_alone_is_sampled_too() -> None:
    chosen = Studio(size=64, lights=((directional((0.0, 0.0, -1.0), 3.0),),), ambient=0.4)
    batches = pilot(chosen.photograph(Lambert(0.5), seed=0).samples(), 300, seed=0)
    assert [len(batch) for batch in batches] == [300]
