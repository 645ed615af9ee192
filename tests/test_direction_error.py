"""How far images are off because a few directions stand for a map of light; and such maps from scene to estimate."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import matest
from matest import load_capture
from matest.brdf import Brdf, CookTorrance, Lambert
from matest.direction_error import direction_error, direction_note
from matest.photographs.images import read_image, write_image
from matest.scene import DirectionalLight, EnvironmentLight, Scene
from matest.scene.environment import MIRROR_SOLID_ANGLE, environment_of
from matest.scene_file import load_scene
from matest.shading import render
from matest.simulate import simulate
from tests import environments, scenes
from tests.captures import refusal, sphere_surface

SURFACE = sphere_surface(32)
GLOSSY = CookTorrance(diffuse=0.1, specular=1.0, slope=0.2, f0=0.5)
CLAY = scenes.material("oren-nayar", albedo=0.6, sigma=0.5)


def surrounded(count: int) -> Scene:
    light = EnvironmentLight(environment_of(environments.studio_map(32), count), 0.3)
    return Scene(SURFACE, ((light,),), torch.zeros(1, 1, dtype=torch.float64))


def test_the_stated_error_is_no_smaller_than_the_real_one() -> None:
    few, many = (render(surrounded(count), GLOSSY, dtype=torch.float64) for count in (256, 2048))
    real = float((few - many).square().mean().sqrt() / many.square().mean().sqrt())
    stated = direction_error(surrounded(256), GLOSSY)
    assert stated is not None
    # It is of 256 pixels only.
    assert 0.8 * real < stated < 0.1


def test_a_note_says_it_of_maps_alone() -> None:
    note = direction_note(surrounded(64), Lambert(albedo=0.5))
    assert note is not None
    assert note.startswith("64 directions stand for the map of light")
    lamp = DirectionalLight(torch.tensor([0.0, 0.0, 1.0]).double(), torch.ones(1).double())
    assert direction_note(Scene(SURFACE, ((lamp,),), torch.zeros(1, 1).double()), GLOSSY) is None


def scene(folder: Path, *images: str, material: str = CLAY) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    write_image(folder / "studio.exr", environments.studio_map(32, 3).numpy().astype(np.float32))
    lights = "\n".join(f'[[image]]\nlights = [ {{ environment = "studio.exr", {keys} }} ]' for keys in images)
    return scenes.write(folder, material, scenes.sphere(32), scenes.noise(), lights)


def test_estimates_hold_under_maps_of_light(tmp_path: Path) -> None:
    folder = simulate(
        scene(tmp_path / "scene", "turn = 0.0", "turn = 2.1", "turn = 4.2, scale = 0.7"), tmp_path / "capture"
    )
    capture = load_capture(folder)
    assert "3 environment lights in 3 images" in capture.understood["lights"]
    estimate = matest.estimate(capture, "oren-nayar")
    for name, truth in (("albedo", 0.6), ("sigma", 0.5)):
        parameter = estimate.parameters[name]
        score = (np.array(parameter.value) - truth) / np.array(parameter.std)
        assert np.abs(score).max() < 4
        assert np.max(np.array(parameter.std) / truth) < 0.05
    assert any("directions stand for the map of light" in sentence for sentence in estimate.warnings)
    assert estimate.fit.reduced_chi2 < 1.1


def test_a_scene_is_rendered_over_its_earlier_rendering_with_its_map(tmp_path: Path) -> None:
    file = scene(tmp_path / "scene", "turn = 1.0, directions = 16")
    first = simulate(file, tmp_path / "capture") / "00.png"
    before = first.read_bytes()
    file.write_text(file.read_text("utf-8").replace("turn = 1.0", "turn = 2.0"), "utf-8")
    simulate(file, tmp_path / "capture")
    assert first.read_bytes() != before
    assert (tmp_path / "capture" / "studio.exr").read_bytes() == (tmp_path / "scene" / "studio.exr").read_bytes()


def test_a_mirror_is_rendered_under_a_map_and_not_estimated(tmp_path: Path) -> None:
    mirror = scenes.material("li-torrance(coherent=on)", k_dd=0.9, height_rms=0.05, correlation_length=1.0)
    simulated = load_scene(scene(tmp_path, "directions = 16", material=mirror))
    assert isinstance(simulated.material, Brdf)
    assert float(simulated.material.parameters["solid_angle"]) == MIRROR_SOLID_ANGLE
    capture = load_capture(simulate(simulated))
    refused = refusal(lambda: matest.estimate(capture, "li-torrance(coherent=on)"))
    assert "neither estimated nor predicted there" in refused


def test_keys_of_maps_stand_beside_maps(tmp_path: Path) -> None:
    beside = scene(tmp_path / "a", "direction = [0, 0, 1]")
    assert "leave out direction" in refusal(lambda: load_scene(beside))
    alone = scenes.write(
        tmp_path / "b", CLAY, scenes.sphere(32), "[[image]]\nlights = [ { direction = [0, 0, 1], turn = 1.0 } ]"
    )
    assert "turn goes with environment" in refusal(lambda: load_scene(alone))
    few = scene(tmp_path / "c", "directions = 3")
    assert "16 to 65536 directions" in refusal(lambda: load_scene(few))
    gone = scene(tmp_path / "d", "turn = 1.0")
    (tmp_path / "d" / "studio.exr").unlink()
    assert "studio.exr: no such file" in refusal(lambda: load_scene(gone))


def test_mitsuba_renders_the_same(tmp_path: Path) -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    size, turn = 20, 0.7
    metal = CookTorrance(diffuse=0.0, specular=1.0, slope=0.15, eta=0.4, k=2.3, masking="smith", fresnel="conductor")
    # Mitsuba's first and last row are the poles.
    polar, azimuth = np.meshgrid(np.arange(128) * math.pi / 127, (np.arange(256) + 0.5) * math.pi / 128, indexing="ij")
    radiance = environments.studio(environments.directions(polar, azimuth))
    view = mi.ScalarTransform4f().look_at(origin=[0, 0, 5], target=[0, 0, 0], up=[0, 1, 0])
    description: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "direct"},
        "sensor": {
            "type": "orthographic",
            "to_world": view @ mi.ScalarTransform4f().scale([1.1, 1.1, 1]),
            "film": {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}},
            "sampler": {"type": "independent", "sample_count": 4096},
        },
        "emitter": {
            "type": "envmap",
            "bitmap": mi.Bitmap(np.repeat(radiance[..., None], 3, axis=2).astype(np.float32)),
            "to_world": mi.ScalarTransform4f().rotate([0, 1, 0], math.degrees(turn)),
        },
        "ball": {
            "type": "sphere",
            "bsdf": {"type": "roughconductor", "alpha": 0.15, "distribution": "beckmann", "eta": 0.4, "k": 2.3},
        },
    }
    theirs = np.array(mi.render(mi.load_dict(description)))[..., 0]
    factor = 4
    scenes.write(
        tmp_path,
        scenes.material(metal.expression, diffuse=0.0, specular=1.0, slope=0.15, eta=0.4, k=2.3),
        f'[geometry]\nshape = "sphere"\ncentre = [{size / 2}, {size / 2}]\nradius = {size / 2.2}\n',
        f"[camera]\nresolution = [{size}, {size}]\nsupersampling = {factor}\n",
        f'[[image]]\nlights = [ {{ environment = "map.npy", turn = {turn} }} ]',
    )
    np.save(tmp_path / "map.npy", environments.studio_map(128).numpy().astype(np.float32))
    ours = read_image(simulate(tmp_path, tmp_path / "out") / "00.exr")[..., 0]
    rows, columns = np.indices(ours.shape) + 0.5 - size / 2
    inner = np.hypot(rows, columns) < size / 2.2 - 1.5
    difference = (ours - theirs)[inner]
    # Noise of 4096 samples is 0.8 % of it.
    assert np.sqrt(np.square(difference).mean() / np.square(theirs[inner]).mean()) < 0.02
    assert abs(difference.mean() / theirs[inner].mean()) < 0.005
