"""Samples of photographs."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from matest.photographs.photometry import Encoding
from matest.photographs.pixels import BLOCKS
from matest.shading import render, shade
from tests.photographs.studio import MATERIAL, photograph, sphere_scene


def sorted_rows(*parts: torch.Tensor) -> np.ndarray:
    rows = torch.cat(parts).numpy()
    return rows[np.lexsort(rows.T)]


@pytest.mark.parametrize("size", [100, 257, 10_000])
def test_unshuffled_batches_run_through_the_images_in_order(size):
    samples = photograph(sphere_scene()).samples()
    batches = list(samples.batches(size))
    assert [len(batch) for batch in batches[:-1]] == [size] * (len(batches) - 1)
    whole = torch.cat([samples.at(k, samples.indices(k)).radiance for k in range(len(samples.images))])
    torch.testing.assert_close(torch.cat([batch.radiance for batch in batches]), whole, rtol=0, atol=0)
    # A training loop may view the values of a sample as one.
    assert all(batch.radiance.is_contiguous() for batch in batches)


@pytest.mark.parametrize("size", [64, 333, 100_000])
def test_shuffled_batches_hold_every_sample_once(size):
    samples = photograph(sphere_scene()).samples()
    batches = list(samples.batches(size, shuffle=True, seed=3))
    assert [len(batch) for batch in batches[:-1]] == [size] * (len(batches) - 1)
    assert 0 < len(batches[-1]) <= size
    assert sum(map(len, batches)) == len(samples)
    np.testing.assert_array_equal(
        sorted_rows(*(batch.radiance for batch in batches)),
        sorted_rows(*(tile().batch.radiance for part in samples.tiles(merge=False) for tile in part)),
    )


@pytest.mark.parametrize("shuffle", [False, True])
def test_every_batch_shades_to_what_was_measured(shuffle):
    samples = photograph(sphere_scene()).samples(dtype=torch.float64)
    for batch in samples.batches(200, shuffle=shuffle):
        torch.testing.assert_close(shade(MATERIAL, batch.points), batch.radiance, rtol=1e-6, atol=1e-7)


def test_shuffling_mixes_images_with_differing_numbers_of_lights():
    batch = next(photograph(sphere_scene()).samples().batches(300, shuffle=True))
    lit = (batch.points.irradiance > 0).any(-1).sum(-1)
    assert batch.points.wi.shape[-2] == 2
    assert set(lit.tolist()) == {0, 1, 2}
    assert (batch.points.ambient[lit == 0] > 0).all()
    assert not batch.points.ambient[lit > 0].any()
    torch.testing.assert_close(batch.points.wi.norm(dim=-1), torch.ones(300, 2))
    assert {group // BLOCKS for group in batch.groups.tolist()} == {0, 1, 2}


def test_the_seed_decides_the_order():
    samples = photograph(sphere_scene()).samples()
    first, same, other = (next(samples.batches(50, shuffle=True, seed=s)).radiance for s in (1, 1, 2))
    assert torch.equal(first, same)
    assert not torch.equal(first, other)


def test_each_image_keeps_its_own_noise_in_a_mixed_batch():
    capture = photograph(sphere_scene(), exposures=(1.0, 2.0, 4.0), encoding=Encoding(scale=3.0))
    batch = next(capture.samples().batches(300, shuffle=True))
    expected = {((0.001 * 3 / e) ** 2, 0.0001 * 3 / e) for e in (1.0, 2.0, 4.0)}
    rows = torch.unique(torch.cat([batch.noise.readout.read, batch.noise.readout.gain], dim=1), dim=0)
    np.testing.assert_allclose(rows.numpy(), sorted(expected), rtol=1e-6)


def test_variance_in_radiance_follows_scale_and_exposure():
    scale, exposure = 3.0, 0.5
    capture = photograph(sphere_scene(), exposures=(exposure,) * 3, encoding=Encoding(scale=scale))
    batch = capture.samples(dtype=torch.float64).at(1, np.array([40, 50]))
    radiance = torch.tensor([[0.2, 0.4, 0.0], [1.0, 2.0, -0.1]], dtype=torch.float64)
    signal = radiance.clamp(min=0) * exposure / scale
    expected = (0.001**2 + 0.0001 * signal) * (scale / exposure) ** 2
    torch.testing.assert_close(batch.variance(radiance), expected)
    torch.testing.assert_close(batch.weight(radiance), 1 / expected)


def test_a_slice_of_a_batch_is_that_part_of_it():
    for batch in photograph(sphere_scene()).samples(dtype=torch.float64).batches(200, shuffle=True):
        part = batch[30:75]
        assert len(part) == min(len(batch), 75) - 30
        assert torch.equal(part.radiance, batch.radiance[30:75])
        torch.testing.assert_close(shade(MATERIAL, part.points), part.radiance, rtol=1e-6, atol=1e-7)
        assert torch.equal(part.variance(part.radiance), batch.variance(batch.radiance)[30:75])


@pytest.mark.parametrize("shuffle", [False, True])
def test_samples_know_their_pixel(shuffle):
    scene = sphere_scene()
    radiance = {image: render(scene, MATERIAL)[image].reshape(-1, 3)[scene.surface.pixels] for image in range(3)}
    for image in range(3):
        for batch in photograph(scene).samples([image]).batches(200, shuffle=shuffle):
            torch.testing.assert_close(batch.radiance, radiance[image][batch.pixels])
            assert torch.equal(batch[10:20].pixels, batch.pixels[10:20])
    mixed = next(photograph(scene).samples().batches(5000, shuffle=shuffle))
    assert len(mixed.pixels) == len(mixed)
    torch.testing.assert_close(mixed.points.wo[:, 2], scene.surface.normals[mixed.pixels, 2].float())


@pytest.mark.parametrize("shuffle", [False, True])
def test_skipped_batches_are_those_at_the_beginning(shuffle):
    samples = photograph(sphere_scene()).samples()
    batches = list(samples.batches(333, shuffle=shuffle, seed=4))
    for skip in (0, 1, len(batches) - 1, len(batches)):
        rest = list(samples.batches(333, shuffle=shuffle, seed=4, skip=skip))
        assert len(rest) == len(batches) - skip
        assert all(torch.equal(a.radiance, b.radiance) for a, b in zip(rest, batches[skip:], strict=True))


@pytest.mark.parametrize("images", [(0,), (2, 0, 1)])
def test_groups_are_blocks_of_the_pixels_of_one_image(images):
    capture = photograph(sphere_scene(size=48))
    samples = capture.samples(images)
    surface = capture.scene.surface
    rows, columns = np.divmod(surface.pixels, 48)
    width = np.ptp(columns) + 1
    for position in range(len(images)):
        index = samples.indices(position)
        block = (rows[index] - rows.min()) * 4 // width * 4 + (columns[index] - columns.min()) * 4 // width
        labels, sizes = np.unique(position * BLOCKS + block, return_counts=True)
        for label, size in zip(labels, sizes, strict=True):
            assert int((samples.at(position, index).groups == label).sum()) == size
            assert samples.groups.image[label] == position
    every = torch.cat([tile().batch.groups for part in samples.tiles(merge=False) for tile in part])
    assert len(every) == len(samples)
    assert set(samples.groups.image[every].tolist()) == set(range(len(images)))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_samples_have_the_precision_asked_for(dtype):
    batch = next(iter(photograph(sphere_scene()).samples(dtype=dtype).tiles()))[0]().batch
    tensors = (batch.radiance, batch.points.wi, batch.points.wo, batch.points.irradiance, *batch.noise.readout)
    assert {tensor.dtype for tensor in tensors} == {dtype}


def test_samples_show_how_many_photographs_values_and_channels_they_are() -> None:
    samples = photograph(sphere_scene()).samples()
    values = len(samples) * 3
    assert repr(samples) == f"PhotographSamples({values} values, 3 channels, 3 photographs)"
    assert repr(next(samples.batches(10))) == "Batch(30 values, 3 channels)"


def test_samples_of_a_few_pixels_lie_in_the_memory_of_the_processor() -> None:
    capture = photograph(sphere_scene())
    here, _ = capture.samples().of_pixels(20, seed=0)
    elsewhere, _ = capture.samples(device="meta").of_pixels(20, seed=0)
    assert elsewhere.radiance.device.type == "cpu"
    assert torch.equal(elsewhere.radiance, here.radiance)
