"""Samples texel by texel are those of the photographs image by image."""

from __future__ import annotations

import pytest
import torch

import matest
from matest.benchmark.instruments import miscalibration as off
from matest.benchmark.instruments.photographs import vase
from matest.photographs.samples import PhotographSamples
from matest.simulate import simulate
from tests.estimation.test_diagnosis import capture_of


@pytest.fixture(params=["ball", "vase"])
def samples(request) -> PhotographSamples:
    surface = vase(off.SIZE) if request.param == "vase" else None
    return capture_of(off.together(), 1, surface).photographs.samples()


def test_tiles_hold_every_texel_once_and_every_sample(samples: PhotographSamples) -> None:
    tiles = [tile() for group in samples.texel_tiles() for tile in group]
    texels = torch.cat([tile.texels for tile in tiles])
    assert torch.equal(texels.sort().values, torch.arange(samples.texels))
    assert sum(int(tile.usable.sum()) for tile in tiles) == len(samples)


def test_values_and_directions_are_those_of_the_pixels(samples: PhotographSamples) -> None:
    tile = samples.some_texels(60, 0)
    batch, _ = samples.of_pixels(60, 0)
    row = tile.in_a_row
    kept = tile.usable
    torch.testing.assert_close(row.radiance[kept], batch.radiance)
    torch.testing.assert_close(row.points.wi[kept], batch.points.wi)
    torch.testing.assert_close(row.points.wo[kept], batch.points.wo)
    reference = batch.radiance
    torch.testing.assert_close(row.noise[kept.nonzero()[:, 0]].variance(reference), batch.variance(reference))


def test_some_of_a_tile_are_the_same_samples(samples: PhotographSamples) -> None:
    tile = samples.some_texels(60, 0)
    places = torch.tensor([3, 20, 41])
    some, rows = tile.some(places), tile.rows_of(places)
    assert torch.equal(some.texels, tile.texels[places])
    assert torch.equal(some.radiance, tile.radiance[rows])
    assert torch.equal(some.in_a_row.points.wi, tile.in_a_row.points.wi[rows])
    reference = tile.radiance.clamp(min=1e-3)
    torch.testing.assert_close(tile.about(reference).weight[rows], some.about(reference[rows]).weight)


def test_ratios_are_those_of_the_sums(samples: PhotographSamples) -> None:
    tile = samples.some_texels(30, 0)
    ratios = tile.ratios(tile.radiance / 2)
    seen = tile.usable.unflatten(0, (tile.images, -1)).any(0)
    torch.testing.assert_close(ratios[:, seen], torch.full_like(ratios[:, seen], 2.0))


def test_images_with_several_lights_and_sky_have_them_at_every_texel(tmp_path) -> None:
    (tmp_path / "scene.toml").write_text(
        '[material]\nmodel = "lambert"\nalbedo = [0.6, 0.5, 0.4]\n[geometry]\nshape = "sphere"\ncentre = [16, 16]\n'
        'radius = 14\n[camera]\nresolution = [32, 32]\n[encoding]\ntransfer = "linear"\n'
        "[[image]]\nambient = [0.1, 0.1, 0.1]\n"
        "lights = [ { direction = [0, 0, 1] }, { direction = [0.5, 0, 0.8] } ]\n"
        "[[image]]\nlights = [ { direction = [0, 0.5, 0.8] } ]\n"
    )
    tile = matest.load_capture(simulate(tmp_path / "scene.toml")).photographs.samples().some_texels(50, 0)
    assert tile.points.wi.shape[:3] == (2, len(tile), 2)
    assert tile.points.ambient is not None
    assert float(tile.points.ambient[0].min()) > 0
    assert float(tile.points.ambient[1].max()) == 0
