"""glTF with textures, read by trimesh and evaluated by the specification."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from matest.brdf import CookTorrance, Lambert, OrenNayar
from matest.export import gltf
from matest.export.texture import Texture
from matest.scene.surface import from_mesh
from tests.export.materials import even_pairs
from tests.export.test_gltf import chunks, evaluated
from tests.export.two_tone import SHAPE, STD, camera, textured, to_edge, truth, vase

pytest.importorskip("pygltflib")
# Half a code of sRGB at 0.7, in linear units.
HALF_CODE = 0.0045


def linear(codes: np.ndarray) -> np.ndarray:
    """Linear values of 8-bit sRGB, by IEC 61966-2-1."""
    v = codes / 255.0
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def looked_up(image: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """The texels nearest to trimesh's texture coordinates, whose v is upward."""
    size = len(image)
    column, row = (np.floor(size * part).astype(int).clip(0, size - 1) for part in (uv[:, 0], 1 - uv[:, 1]))
    return image[row, column]


def loaded(path: Path) -> trimesh.Trimesh:
    (mesh,) = trimesh.load_scene(path, process=False).geometry.values()
    return mesh


def test_the_texture_at_a_vertex_is_the_value_of_the_map_at_the_pixel_that_sees_it(tmp_path: Path) -> None:
    made = textured(Lambert(0.5), "albedo")
    gltf.write(made.material, tmp_path / "vase.glb", textured=made)
    mesh = loaded(tmp_path / "vase.glb")
    np.testing.assert_allclose(mesh.triangles, vase().triangles, atol=1e-6)
    image = np.asarray(mesh.visual.material.baseColorTexture)
    assert image.shape == (256, 256, 3)
    seen = camera(0)
    surface = from_mesh(vase(), seen, SHAPE)
    pixels = seen.project(SHAPE, np.asarray(mesh.vertices))
    inside = ((pixels > 0) & (pixels < (SHAPE[1], SHAPE[0]))).all(axis=1)
    flat = np.floor(pixels[inside]).astype(int) @ (1, SHAPE[1])
    numbers = surface.image(np.arange(1, len(surface) + 1)).ravel()[flat] - 1
    points = np.asarray(mesh.vertices)[inside]
    assert surface.positions is not None
    near = np.linalg.norm(surface.positions.numpy()[numbers] - points, axis=1) < 0.05
    kept = (numbers >= 0) & near & (to_edge(points) > 0.05)
    assert kept.sum() > 1000
    found = linear(looked_up(image, mesh.visual.uv[inside][kept]))
    assert np.abs(found - truth(points[kept])).max() < 5 * STD + HALF_CODE


def test_an_exact_albedo_stays_exact_to_the_rounding(tmp_path: Path) -> None:
    made = textured(Lambert(0.5), "albedo", exact=True)
    conversion = gltf.write(made.material, tmp_path / "vase.glb", textured=made)
    assert conversion.error.relative_rmse < 0.01
    mesh = loaded(tmp_path / "vase.glb")
    points = np.asarray(mesh.vertices)
    off = to_edge(points) > 0.05
    found = linear(looked_up(np.asarray(mesh.visual.material.baseColorTexture), mesh.visual.uv[off]))
    assert np.abs(found - truth(points[off])).max() < HALF_CODE


@pytest.mark.parametrize(
    ("material", "name"),
    [(OrenNayar(0.5, 0.5), "albedo"), (CookTorrance(0.5, [0.6, 0.5, 0.4], 0.2), "diffuse")],
    ids=["oren-nayar", "cook-torrance"],
)
def test_the_stated_error_is_that_of_the_specification_at_texels(material, name: str, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    made = textured(material, name)
    conversion = gltf.write(made.material, tmp_path / "vase.glb", textured=made)
    written = chunks(tmp_path / "vase.glb")[0]["materials"][0]
    assert written["extras"]["matest"]["relative_rmse"] == conversion.error.relative_rmse
    image = np.asarray(loaded(tmp_path / "vase.glb").visual.material.baseColorTexture)
    wi, wo = even_pairs(20_000)
    squares = []
    for place in np.random.default_rng(5).choice(made.seen, 16):
        row, column = divmod(int(place), 256)
        written["pbrMetallicRoughness"]["baseColorFactor"] = [*linear(image[row, column]), 1]
        truth_of = material.replace({name: torch.from_numpy(made.textures[name].value[row, column]).double()})(wi, wo)
        difference = (torch.from_numpy(evaluated(written, wi.numpy(), wo.numpy())) - truth_of) * wi[:, 2:]
        squares.append(float(difference.square().sum() / (truth_of * wi[:, 2:]).square().sum()))
    assert math.sqrt(np.mean(squares)) == pytest.approx(conversion.error.relative_rmse, rel=0.2)
    assert conversion.error.relative_rmse < 0.25


def test_a_slope_becomes_the_green_of_a_texture(tmp_path: Path) -> None:
    made = textured(CookTorrance(0.3, 1.0, 0.2, distribution="ggx", masking="smith"), "diffuse")
    slopes = np.full((256, 256, 1), 0.15, np.float32)
    slopes[:128] = 0.25
    each = made.textures["diffuse"]
    slope = Texture(slopes, 0.01 * np.ones_like(slopes), each.status, np.array([0.2]))
    made = replace(made, textures={"diffuse": each, "slope": slope})
    conversion = gltf.write(made.material, tmp_path / "vase.glb", textured=made)
    # Factors multiply textures.
    assert conversion.parameters["roughnessFactor"] == conversion.parameters["metallicFactor"] == 1
    mesh = loaded(tmp_path / "vase.glb")
    image = np.asarray(mesh.visual.material.metallicRoughnessTexture)
    alpha = (image[..., 1] / 255.0) ** 2
    assert alpha[:128].mean() / alpha[128:].mean() == pytest.approx(0.25 / 0.15, rel=0.02)
    # The same lobe but for Schlick's reflectance.
    assert alpha[128:].mean() == pytest.approx(0.15, rel=0.05)
    assert (image[..., 2] == 0).all()


def test_what_gltf_has_no_texture_for_is_named(tmp_path: Path) -> None:
    made = textured(CookTorrance(0.5, 0.5, 0.2), "specular")
    conversion = gltf.write(made.material, tmp_path / "vase.gltf", textured=made)
    assert "glTF's material has no texture for specular: the mean was written." in conversion.notes
    assert "images" not in (tmp_path / "vase.gltf").read_text()


def test_base_colours_above_one_are_counted(tmp_path: Path) -> None:
    made = textured(Lambert(0.5), "albedo", exact=True)
    each = made.textures["albedo"]
    bright = replace(made, textures={"albedo": replace(each, value=2 * each.value, mean=2 * each.mean)})
    notes = gltf.write(bright.material, tmp_path / "vase.glb", textured=bright).notes
    share = float((2 * each.value.reshape(-1, 3)[made.seen] > 1).mean())
    assert any(note.startswith(f"{share:.1%} of the base colours exceed 1") for note in notes)
