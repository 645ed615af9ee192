from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import torch
import trimesh

from matest.brdf import Lambert
from matest.photographs.noise import Noise
from matest.photographs.photographs import Photographs
from matest.photographs.photometry import Encoding
from matest.photographs.pixels import BLOCKS
from matest.samples import Tile
from matest.scene import Camera, Mesh, Scene
from matest.scene.surface import from_mesh
from matest.shading import render, shade
from tests.captures import directional, point, sphere_surface

MATERIAL = Lambert(albedo=[0.7, 0.5, 0.3])
LEFT, RIGHT = directional((-0.5, 0.1, 0.8), 1.0, 2.0, 1.5), directional((0.6, -0.3, 0.5), 2.0, 1.0, 1.0)
NEAR = point((0.5, 1.0, 3.0), 6.0, 7.0, 8.0)
# Images with one, two and no lights, the last one under an even sky.
MIXED = ((LEFT,), (RIGHT, NEAR), ())
MIXED_AMBIENT = (0.0, 0.0, 0.2)


def photograph(scene: Scene, full: int | None = None, **changes: object) -> Photographs:
    """Photographs of the scene made of `MATERIAL`: floats, or integers up to `full` = radiance 1."""
    images = render(scene, MATERIAL, dtype=torch.float64).numpy()
    stored = images.reshape(len(scene), -1, scene.channels)[:, scene.surface.pixels]
    if full is None:
        stored = stored.astype(np.float32)
    else:
        stored = np.round(full * stored).clip(0, full).astype(np.uint8 if full == 255 else np.uint16)
    photographs = Photographs(
        scene=scene,
        stored=tuple(stored),
        encoding=Encoding(),
        exposures=(1.0,) * len(scene),
        noise=Noise(0.001, 0.0001),
        noise_stated=True,
        relative=False,
        names=tuple(f"image {number}" for number in range(len(scene))),
    )
    return dataclasses.replace(photographs, **changes)


def sphere_scene(lights=MIXED, ambient=MIXED_AMBIENT, size: int = 32) -> Scene:
    sky = torch.tensor(ambient, dtype=torch.float64)[:, None].expand(-1, 3)
    return Scene(sphere_surface(size), tuple(lights), sky)


def plate_scene() -> Scene:
    """A small square plate above a large one: cast shadows."""

    def square(half: float, height: float) -> trimesh.Trimesh:
        corners = [(-half, -half, height), (half, -half, height), (half, half, height), (-half, half, height)]
        return trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)])

    joined = trimesh.util.concatenate([square(1.2, 0.0), square(0.4, 0.7)])
    surface = from_mesh(Mesh(joined.vertices, joined.faces), Camera(position=(0, 0, 5), height=3.0), (40, 50))
    return Scene(surface, ((LEFT,), (RIGHT, LEFT)), torch.zeros(2, 3, dtype=torch.float64)).with_shadows()


def sorted_rows(*parts: torch.Tensor) -> np.ndarray:
    rows = torch.cat(parts).numpy()
    return rows[np.lexsort(rows.T)]


def left_out(samples):
    """Saturated pixels are counted, but serve as bounds."""
    return sum(count for reason, count in samples.skipped.items() if reason != "saturated")


@pytest.mark.parametrize("images", [None, (0,), (2, 0)])
def test_every_pixel_is_a_sample_or_counted_as_skipped(images):
    saturated = Encoding(saturation=0.3)
    for capture in (
        photograph(sphere_scene(), encoding=saturated),
        photograph(sphere_scene(), 255, encoding=saturated),
    ):
        samples = capture.samples(images)
        count = len(capture) if images is None else len(images)
        assert left_out(samples) + len(samples) == count * 32 * 32
        assert set(samples.skipped) == {"background", "shadowed", "saturated", "rim", "redundant"}


def test_every_pixel_of_a_scene_with_cast_shadows_is_accounted_for():
    samples = photograph(plate_scene(), encoding=Encoding(saturation=0.4)).samples()
    assert left_out(samples) + len(samples) == 2 * 40 * 50
    assert samples.skipped["saturated"] > 0


def test_skipped_pixels_are_what_they_are_called():
    grazing = directional((0.9, 0.1, 0.2), 1.0, 1.0, 1.0)
    scene = sphere_scene(((grazing,),), (0.0,))
    surface = scene.surface
    skipped = photograph(scene).samples().skipped
    dark = (surface.normals @ grazing.direction).numpy() <= 0
    assert skipped == {
        "background": 32 * 32 - len(surface),
        "rim": int(surface.rim.sum()),
        "shadowed": int((dark & ~surface.rim).sum()),
        "saturated": 0,
        "redundant": 0,
    }
    assert skipped["shadowed"] > 0


def test_pixels_in_a_cast_shadow_or_on_its_edge_are_no_samples():
    scene = plate_scene()
    samples = photograph(scene).samples()
    out = scene.shadows[0][0] | scene.shadow_edge[0] | scene.surface.rim
    np.testing.assert_array_equal(samples.indices(0), np.flatnonzero(~out))
    # Where one of two lamps is blocked the other still shows the material.
    out = scene.shadows[1].all(axis=0) | scene.shadow_edge[1] | scene.surface.rim
    np.testing.assert_array_equal(samples.indices(1), np.flatnonzero(~out))
    assert (scene.shadows[1].any(axis=0) & ~out).any()


def test_an_even_sky_lights_every_pixel():
    capture = photograph(sphere_scene())
    np.testing.assert_array_equal(capture.samples().indices(2), np.flatnonzero(~capture.scene.surface.rim))


@pytest.mark.parametrize("full", [None, 65535])
def test_saturated_channels_are_bounds_and_the_others_values(full):
    scene = sphere_scene(((LEFT,),), (0.0,))
    capture = photograph(scene, full, encoding=Encoding(saturation=0.2), noise=Noise(1e-6, 0.0))
    samples = capture.samples()
    batch = samples.at(0, samples.indices(0))
    assert batch.noise.clipped.amin() == 0
    assert samples.skipped["saturated"] == int((batch.noise.clipped == 1).any(1).sum()) > 20
    assert ((batch.radiance > 0.2) == (batch.noise.clipped == 1)).all()
    step = 1e-6 if full is None else 1 / full
    assert float(batch.noise.limits.upper) == pytest.approx(0.2, abs=step)
    # The green channel saturates first.
    assert (batch.noise.clipped[:, 1] > batch.noise.clipped[:, 0]).any()
    assert (batch.noise.clipped[:, 1] >= batch.noise.clipped[:, 0]).all()


def test_a_flat_field_does_not_change_which_pixels_are_saturated():
    scene = sphere_scene(((LEFT,),), (0.0,))
    plain = photograph(scene, 65535, encoding=Encoding(saturation=0.25), noise=Noise(1e-6, 0.0))
    flat = np.full((len(scene.surface), 1), 0.6, np.float32)
    corrected = dataclasses.replace(plain, encoding=Encoding(saturation=0.25, flat=flat))
    assert plain.samples().skipped["saturated"] > 0
    assert corrected.samples().skipped == plain.samples().skipped


def test_an_object_that_is_black_in_one_channel_still_gives_samples():
    scene = sphere_scene(((LEFT,),), (0.0,))
    capture = photograph(scene, 255, noise=Noise(0.002, 0.0))
    red = tuple(stored * np.array([1, 1, 0], np.uint8) for stored in capture.stored)
    count = len(capture.samples())
    assert len(dataclasses.replace(capture, stored=red).samples()) > 0.9 * count > 100


@pytest.mark.parametrize("black", [0.0, 0.08])
def test_the_ends_of_the_range_do_not_bias_the_likelihood(black):
    """Both ends clip some of the noise; the score at the truth is zero but for chance, and as uncertain as it says."""
    power = [1.35 * math.pi / albedo for albedo in (0.7, 0.5, 0.3)]
    scene = sphere_scene(((directional((0.0, 0.3, 1.0), *power),),), (0.0,), 320)
    truth = render(scene, MATERIAL, dtype=torch.float64).numpy().reshape(-1, 3)[scene.surface.pixels]
    noise = Noise(0.02, 0.001)
    spread = np.sqrt(noise.read**2 + noise.gain * truth)
    noisy = truth + spread * np.random.default_rng(4).normal(size=truth.shape)
    stored = np.round(65535 * (noisy + black).clip(0, 1)).astype(np.uint16)
    encoding = Encoding(black=black, saturation=1.0)
    samples = photograph(scene, 65535, stored=(stored,), noise=noise, encoding=encoding).samples(dtype=torch.float64)
    index = samples.indices(0)
    batch = samples.at(0, index)
    reference = torch.from_numpy(truth[index])
    response, weight, plain, *_ = Tile(batch).about(reference)
    score = weight * (response - reference)
    for near_the_end in (truth[index] > 0.9 - black, truth[index] < 0.15):
        here = torch.from_numpy(near_the_end)
        clipped = (batch.noise.clipped[here] != 0).double().mean()
        assert near_the_end.sum() > 1000
        assert clipped > 0.02 or black
        assert abs(score[here].sum()) < 4 * weight[here].sum().sqrt()
        assert float(score[here].square().sum() / weight[here].sum()) == pytest.approx(1, abs=0.05)
    residual = ((response - reference).square() * weight)[plain]
    assert float(residual.mean()) == pytest.approx(1, abs=0.02)


@pytest.mark.parametrize("size", [100, 257, 10_000])
def test_unshuffled_batches_run_through_the_images_in_order(size):
    samples = photograph(sphere_scene()).samples()
    batches = list(samples.batches(size))
    assert [len(batch) for batch in batches[:-1]] == [size] * (len(batches) - 1)
    whole = torch.cat([samples.at(k, samples.indices(k)).radiance for k in range(len(samples.images))])
    torch.testing.assert_close(torch.cat([batch.radiance for batch in batches]), whole, rtol=0, atol=0)


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
