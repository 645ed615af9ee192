"""The usable pixels of photographs."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import torch

from matest.photographs.noise import Noise
from matest.photographs.photometry import Encoding
from matest.photographs.pixels import LitPixels
from matest.samples import Tile
from matest.shading import render
from tests.captures import directional
from tests.photographs.studio import LEFT, MATERIAL, RIGHT, photograph, plate_scene, sphere_scene


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
    out = np.asarray(scene.shadows[0][0]) | np.asarray(scene.shadow_edge[0]) | scene.surface.rim
    np.testing.assert_array_equal(samples.indices(0), np.flatnonzero(~out))
    # Where one of two lamps is blocked the other still shows the material.
    shadows = np.stack(scene.shadows[1])
    out = shadows.all(axis=0) | np.asarray(scene.shadow_edge[1]) | scene.surface.rim
    np.testing.assert_array_equal(samples.indices(1), np.flatnonzero(~out))
    assert (shadows.any(axis=0) & ~out).any()


@pytest.mark.parametrize("kind", ["sphere", "plates", "map"])
def test_some_pixels_are_usable_as_among_all(kind: str) -> None:
    if kind == "plates":
        photographs = photograph(plate_scene())
    else:
        photographs = photograph(sphere_scene(), full=255)
        surface = photographs.scene.surface
        surface = dataclasses.replace(surface, convex=kind == "sphere")
        photographs = dataclasses.replace(photographs, scene=dataclasses.replace(photographs.scene, surface=surface))
    index = np.random.default_rng(1).permutation(len(photographs.scene.surface))[::3]
    images = (1, 0)
    for position in range(2):
        usable = photographs.samples(images).usable(position)[index]
        np.testing.assert_array_equal(photographs.samples(images).usable_at(position, index), usable)
        assert 0 < usable.sum() < len(index)


def test_usable_pixels_in_a_row_are_those_among_all():
    samples = photograph(sphere_scene()).samples()
    every, count = samples.usable(0), len(samples.photographs.scene.surface)
    # Neither end lies between two bytes of the packed flags.
    for start, stop in ((0, 13), (11, count - 3), (count - 1, count)):
        np.testing.assert_array_equal(samples.usable(0, slice(start, stop)), every[start:stop])


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


def test_a_light_reaches_the_pixels_that_face_it_and_are_not_in_shadow() -> None:
    scene = plate_scene()
    pixels = LitPixels(photograph(scene), (0, 1), torch.float32, "cpu")
    (toward, reaches), (_, by_left) = pixels.lights(1)
    torch.testing.assert_close(toward, RIGHT.direction[None].float())
    assert torch.equal(reaches, torch.from_numpy(~np.asarray(scene.shadows[1][0])))
    assert not torch.equal(reaches, by_left)
    some = torch.tensor([5, 300, 17])
    assert torch.equal(next(pixels.lights(1, some))[1], reaches[some])


def test_pixels_that_face_away_are_not_reached() -> None:
    scene = sphere_scene(((LEFT,),), (0.0,))
    ((_, reaches),) = LitPixels(photograph(scene), (0,), torch.float32, "cpu").lights(0)
    assert torch.equal(reaches, scene.surface.normals @ LEFT.direction > 0)
    assert 0 < reaches.sum() < len(reaches)
