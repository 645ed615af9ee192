"""Supersampling where the rays of a pixel differ, against supersampling everywhere."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from matest import supersampling
from matest.photographs.images import read_image
from matest.scene import Scene
from matest.scene.surface import from_sphere
from matest.simulate import SimulatedScene, load_scene, radiance, simulate
from matest.supersampling import PixelMeans
from tests import scenes

GLOSSY = scenes.material("cook-torrance", diffuse=0.3, specular=1.0, slope=0.15, f0=0.04)
LIGHTS = scenes.distant(([0.3, 0.2, 0.93], [0.8, -0.3, 0.5]))
TOLERANCE = 1e-4


def sphere(folder: Path, factor: int, size: int = 256, noise: str = "") -> SimulatedScene:
    text = scenes.sphere(size) + f"supersampling = {factor}\n"
    return load_scene(scenes.write(folder, GLOSSY, text, noise, LIGHTS))


def mesh(folder: Path, solid: trimesh.Trimesh, factor: int, lights: str = LIGHTS) -> SimulatedScene:
    solid.export(folder / "mesh.ply")
    camera = f"[camera]\nheight = 3.0\nresolution = [96, 96]\nsupersampling = {factor}\n"
    return load_scene(scenes.write(folder, GLOSSY, '[geometry]\nmesh = "mesh.ply"\n', camera, lights))


def errors(scene: SimulatedScene, image: int, tolerance: float = TOLERANCE) -> np.ndarray:
    """What each covered pixel differs from the mean over all rays, as a share of the highest radiance [m, C]."""
    means = PixelMeans.of(scene.scene, scene.supersampling)
    full = supersampling.radiance_of_rays(scene.scene, scene.supersampling, image, scene.material)
    return np.abs(means.radiance(image, scene.material, tolerance) - full) / full.max()


@pytest.mark.parametrize("factor", [2, 3])
@pytest.mark.parametrize("image", [0, 1])
def test_a_curved_surface_is_right_to_the_tolerance(tmp_path: Path, factor: int, image: int) -> None:
    error = errors(sphere(tmp_path, factor), image)
    assert error.max() <= TOLERANCE
    assert (error.max(axis=1) > 0).mean() > 0.3, "nothing is saved"


def test_flat_faces_are_exact_and_shaded_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = mesh(tmp_path, trimesh.creation.box((2, 2, 0.5)), 4)
    shaded: list[int] = []
    render = supersampling.render_pixels

    def count(scene, image, material, index, **options):
        shaded.append(len(index))
        return render(scene, image, material, index, **options)

    means = PixelMeans.of(scene.scene, 4)
    monkeypatch.setattr(supersampling, "render_pixels", count)
    values = means.radiance(0, scene.material, TOLERANCE)
    assert sum(shaded) < 0.3 * len(scene.scene.surface)
    full = supersampling.radiance_of_rays(scene.scene, 4, 0, scene.material)
    np.testing.assert_allclose(values, full, rtol=1e-12)


def test_edges_and_cast_shadows_are_right_to_the_tolerance(tmp_path: Path) -> None:
    body = trimesh.creation.box((2, 2, 0.2))
    pin = trimesh.creation.cylinder(0.02, 1.0)
    pin.apply_translation([0.3, 0.1, 0.6])
    scene = mesh(tmp_path, trimesh.util.concatenate([body, pin]), 3, scenes.distant(([0.7, 0.31, 0.6],)))
    assert any(np.asarray(shadow).any() for shadows in scene.scene.shadows for shadow in shadows or ())
    assert errors(scene, 0).max() <= TOLERANCE


def test_a_groove_finer_than_a_pixel_is_seen(tmp_path: Path) -> None:
    scene = sphere(tmp_path, 4, size=64).scene
    flat = from_sphere(scene.surface.shape, (128, 128), 1e6, None)
    tilt = np.where(flat.pixels % 4 < 2, 0.2, -0.2)
    normals = flat.normals.clone()
    normals[:, 0], normals[:, 2] = normals.new_tensor(np.sin(tilt)), normals.new_tensor(np.cos(tilt))
    grooved = Scene(replace(flat, normals=normals), scene.lights, scene.ambient, (None, None))
    material = load_scene(tmp_path / "scene.toml").material
    full = supersampling.radiance_of_rays(grooved, 4, 0, material)
    values = PixelMeans.of(grooved, 4).radiance(0, material, TOLERANCE)
    np.testing.assert_allclose(values, full, atol=TOLERANCE * full.max())


@pytest.mark.parametrize("bits", [8, 16])
def test_integer_images_are_within_a_code_of_full_supersampling(tmp_path: Path, bits: int) -> None:
    scene = sphere(tmp_path, 3, noise=f"[noise]\nbits = {bits}\n[encoding]\nscale = 1.3\n")
    simulate(tmp_path / "scene.toml")
    top = 2**bits - 1
    for number in range(2):
        codes = read_image(tmp_path / f"{number:02d}.png").astype(int)
        full = np.round(radiance(scene, number).clip(0, 1.3) / 1.3 * top)
        assert np.abs(codes - full).max() <= 1
        assert (codes != full).mean() < 0.05


def test_near_lights_and_a_sky_are_right_to_the_tolerance(tmp_path: Path) -> None:
    light = "[[image]]\nambient = 0.1\nlights = [ { position = [0.4, 0.3, 1.6], intensity = 3.0 } ]"
    scene = mesh(tmp_path, trimesh.creation.icosphere(subdivisions=5), 3, light)
    assert errors(scene, 0).max() <= TOLERANCE
