"""Scenes of several objects: rendered, read back, and estimated object by object."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

import matest
from matest import batch, brdf, load_capture
from matest.capture import Capture
from matest.estimation.options import Options
from matest.photographs.images import read_image
from matest.scene_file import load_scene, material_in
from matest.simulate import simulate
from tests import scenes
from tests.captures import refusal

# A matt ball, and before it a glossy one whose shadow falls on it.
OBJECTS = """
[[object]]
name = "matt"
shape = "sphere"
position = [-0.25, 0.0, 0.0]
radius = 0.7
[object.material]
model = "oren-nayar"
albedo = {albedo}
sigma = 0.5

[[object]]
name = "glossy"
shape = "sphere"
position = [0.45, 0.1, 0.9]
radius = 0.3
[object.material]
model = "cook-torrance"
diffuse = 0.2
specular = 0.8
slope = 0.25
f0 = 0.04

[camera]
position = [0, 0, 5]
height = 1.5
resolution = [80, 60]
supersampling = {supersampling}
"""
TRUTH = {"matt": {"albedo": 0.6, "sigma": 0.5}, "glossy": {"diffuse": 0.2, "specular": 0.8, "slope": 0.25}}
MODELS = {"matt": "oren-nayar", "glossy": "cook-torrance"}


def scene(folder: Path, seed: int = 1, supersampling: int = 1, albedo: object = 0.6) -> Path:
    text = OBJECTS.format(albedo=albedo, supersampling=supersampling)
    return scenes.write(folder, text, scenes.noise(seed), scenes.distant())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("objects")
    return simulate(scene(place), place / "capture")


@pytest.fixture(scope="module")
def capture(folder: Path) -> Capture:
    return load_capture(folder)


def test_a_rendered_scene_reads_back_with_the_same_objects(folder: Path, capture: Capture) -> None:
    objects = capture.scene.surface.objects
    assert objects is not None
    written = read_image(folder / "objects.png")[..., 0]
    np.testing.assert_array_equal(written, capture.scene.surface.image(objects.index + np.uint8(1)))
    normals = read_image(folder / "normals.exr")
    np.testing.assert_allclose(capture.scene.surface.image(capture.scene.surface.normals.numpy()), normals, atol=1e-6)


def test_pixels_show_the_nearest_object_as_a_sphere_has_it(capture: Capture) -> None:
    surface = capture.scene.surface
    rows, columns = np.divmod(surface.pixels, 80)
    x, y = (columns + 0.5 - 40) * 1.5 / 60, (30 - rows - 0.5) * 1.5 / 60
    before = np.hypot(x - 0.45, y - 0.1) < 0.3
    off_edge = np.abs(np.hypot(x - 0.45, y - 0.1) - 0.3) > 1e-3
    np.testing.assert_array_equal((surface.objects.index == 1)[off_edge], before[off_edge])
    centre = np.where(before[:, None], (0.45, 0.1, 0.9), (-0.25, 0.0, 0.0))
    exact = (surface.positions.numpy() - centre) / np.where(before, 0.3, 0.7)[:, None]
    # Facets of the sphere are flat to 4e-5 of its radius, which shifts the outline.
    assert np.abs(surface.normals.numpy() - exact)[off_edge & ~surface.rim].max() < 1e-3


def test_one_object_casts_its_shadow_on_the_other(capture: Capture) -> None:
    surface = capture.scene.surface
    matt = surface.objects.index == 0
    for lights, shadows in zip(capture.scene.lights, capture.scene.shadows, strict=True):
        toward = lights[0].at(None)[0][0].numpy()
        # The ray from a point of the matt ball passes the centre of the other one at this distance.
        offset = np.array([0.45, 0.1, 0.9]) - surface.positions.numpy()[matt]
        along = offset @ toward
        distance = np.linalg.norm(offset - along[:, None] * toward, axis=1)
        facing = surface.normals.numpy()[matt] @ toward > 0.05
        clear = facing & (np.abs(distance - 0.3) > 2e-3)
        np.testing.assert_array_equal(np.asarray(shadows[0])[matt][clear], ((distance < 0.3) & (along > 0))[clear])


def test_each_object_has_the_material_that_it_was_rendered_with(tmp_path: Path, capture: Capture) -> None:
    scores = []
    for seed in range(6):
        taken = capture if seed == 1 else load_capture(simulate(scene(tmp_path / f"{seed}", seed)))
        for name, view in taken.objects.items():
            estimate = matest.estimate(view, MODELS[name], fix={"f0": 0.04} if name == "glossy" else {})
            for key, value in TRUTH[name].items():
                parameter = estimate.parameters[key]
                scores.append(float((parameter.value - value) / parameter.std))
    # 30 scores, of which those of one estimate are correlated.
    assert np.abs(scores).max() < 4
    assert 0.5 < np.sqrt(np.mean(np.square(scores))) < 1.5


def test_a_capture_of_several_objects_has_no_single_material(capture: Capture) -> None:
    expected = "capture: shows several objects (matt, glossy), each of a material of its own"
    assert expected in refusal(lambda: matest.estimate(capture))
    assert expected in refusal(lambda: matest.check(capture))
    assert "did you mean 'matt'" in refusal(lambda: capture.object("mat"))


def test_the_command_writes_a_result_for_each_object(folder: Path, tmp_path: Path) -> None:
    jobs = batch.jobs([folder], tmp_path / "out", Options(model="lambert"))
    assert [job.out for job in jobs] == [tmp_path / "out" / name for name in TRUTH]
    outcome = batch.run(jobs[1])
    assert outcome.estimate is not None
    assert outcome.estimate.capture == "capture/glossy"
    written = json.loads((tmp_path / "out" / "glossy" / "result.json").read_text("utf-8"))
    assert written["provenance"]["object"] == "glossy"
    assert any("one object sends to another is not modelled" in note for note in written["warnings"])


def test_a_pixel_of_two_objects_is_the_mean_over_its_rays(tmp_path: Path) -> None:
    integers = load_scene(scene(tmp_path, supersampling=3))
    full = integers.pixels
    mixed = ~full.whole & (np.abs(full.radiance(0, integers.material, 1e-9)).max(1) > 0)
    assert mixed.any()
    coarse = full.radiance(0, integers.material, 0.5)
    np.testing.assert_allclose(coarse[mixed], full.radiance(0, integers.material, 0.0)[mixed], atol=1e-12)


def test_materials_are_given_by_name(capture: Capture) -> None:
    white, black = brdf.Lambert(albedo=1.0), brdf.Lambert(albedo=torch.tensor(0.0, requires_grad=True))
    rendered = matest.render(capture.scene, {"matt": white, "glossy": black})
    images, alone = rendered.detach().numpy(), matest.render(capture.scene, white).numpy()
    objects = capture.scene.surface.image(capture.scene.surface.objects.index, background=9)
    assert images[:, objects == 1].max() == 0
    np.testing.assert_allclose(images[:, objects == 0], alone[:, objects == 0])
    (slope,) = torch.autograd.grad(rendered.sum(), [black.albedo])
    assert float(slope) > 0
    assert "give one for each" in refusal(lambda: matest.render(capture.scene, {"matt": white}))


def test_materials_that_are_missing_or_too_many_are_refused(tmp_path: Path) -> None:
    text = OBJECTS.format(albedo=0.6, supersampling=1)
    start, end = text.rindex("[object.material]"), text.index("[camera]")
    bare = scenes.write(tmp_path / "a", text[:start] + text[end:], scenes.distant())
    assert "object 'glossy' has no material" in refusal(lambda: load_scene(bare))
    both = scenes.write(tmp_path / "b", scenes.material("lambert", albedo=0.5), text, scenes.distant())
    assert "leave out [material]" in refusal(lambda: load_scene(both))
    wrong = scenes.write(tmp_path / "c", text.replace("sigma", "sigmo"), scenes.distant())
    assert "object 'matt': [object.material]: " in refusal(lambda: load_scene(wrong))


def test_colours_of_any_object_make_colour_photographs(tmp_path: Path) -> None:
    coloured = load_scene(scene(tmp_path, albedo=[0.1, 0.2, 0.3]))
    assert coloured.images.channels == 3
    assert {*material_in(coloured.description)} == {*TRUTH}
