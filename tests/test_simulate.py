"""From a scene file to a capture on disk."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from matest import load_capture
from matest.photographs.images import read_image, write_image
from matest.simulate import load_scene, radiance, simulate
from tests import scenes
from tests.captures import refusal

LAMBERT = scenes.material("lambert", albedo=0.5)
ONE_LIGHT = scenes.distant(([0.3, 0.2, 0.93],))
SIX_LIGHTS = scenes.distant()


def noise(bits: int | None = None, read: float = 0.002, gain: float = 0.0005, seed: int = 3) -> str:
    return f"[noise]\nread = {read}\ngain = {gain}\nseed = {seed}\n" + (f"bits = {bits}\n" if bits else "")


def sphere_scene(folder: Path, *parts: str, size: int = 24, supersampling: int = 1) -> Path:
    """A scene of a sphere; `parts` override material and lights where they bring their own."""
    sphere = scenes.sphere(size) + f"supersampling = {supersampling}\n"
    own = "\n".join(parts)
    material = "" if "[material]" in own else LAMBERT
    lights = "" if "[[image]]" in own else ONE_LIGHT
    return scenes.write(folder, material, sphere, own, lights)


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def clean(scene: Path) -> np.ndarray:
    """Radiance [K, H, W, C] without noise."""
    description = load_scene(scene)
    return np.stack([radiance(description, k) for k in range(len(description.scene))])


@pytest.mark.parametrize("bits", [None, 8, 16])
def test_the_same_scene_gives_the_same_bits_twice(tmp_path: Path, bits: int | None) -> None:
    scene = sphere_scene(tmp_path, noise(bits), SIX_LIGHTS)
    first, second = (files(simulate(scene, tmp_path / name)) for name in ("a", "b"))
    assert first.keys() == second.keys()
    assert first == second


def test_another_seed_gives_other_noise(tmp_path: Path) -> None:
    first = simulate(sphere_scene(tmp_path / "1", noise(16, seed=1)))
    second = simulate(sphere_scene(tmp_path / "2", noise(16, seed=2)))
    assert (first / "00.png").read_bytes() != (second / "00.png").read_bytes()
    assert (first / "normals.exr").read_bytes() == (second / "normals.exr").read_bytes()


def test_images_of_one_scene_have_their_own_noise(tmp_path: Path) -> None:
    folder = simulate(sphere_scene(tmp_path, noise(16), scenes.distant(([0.3, 0.2, 0.93],) * 2)))
    assert (folder / "00.png").read_bytes() != (folder / "01.png").read_bytes()


def test_rendering_again_replaces_an_earlier_rendering(tmp_path: Path) -> None:
    scene = sphere_scene(tmp_path, noise(16))
    before = files(simulate(scene))
    assert files(simulate(scene)) == before


@pytest.mark.parametrize(("bits", "dtype"), [(8, np.uint8), (16, np.uint16)])
def test_integer_images_hold_radiance_over_scale(tmp_path: Path, bits: int, dtype: type) -> None:
    scene = sphere_scene(tmp_path, noise(bits, 0.0, 0.0))
    pixels = read_image(simulate(scene) / "00.png")
    scale = load_capture(tmp_path).photographs.encoding.scale
    assert pixels.dtype == dtype
    full = 2**bits - 1
    np.testing.assert_array_equal(pixels, np.round(clean(scene)[0] / scale * full))


def test_a_name_implies_integers_where_the_scene_states_no_bits(tmp_path: Path) -> None:
    named = '[[image]]\nfile = "a.png"\nlights = [ { direction = [0, 0, 1], irradiance = 3.0 } ]\n'
    folder = simulate(sphere_scene(tmp_path, named))
    assert read_image(folder / "a.png").dtype == np.uint16
    capture = load_capture(folder)
    expected = clean(tmp_path)[0].reshape(-1, 1)[capture.scene.surface.pixels]
    np.testing.assert_allclose(capture.radiance(0), expected, atol=capture.photographs.encoding.scale / 65535)


def test_float_images_hold_radiance_itself(tmp_path: Path) -> None:
    scene = sphere_scene(tmp_path)
    pixels = read_image(simulate(scene) / "00.exr")
    assert pixels.dtype == np.float32
    np.testing.assert_allclose(pixels, clean(scene)[0], rtol=1e-6)


def test_a_lambertian_sphere_has_lamberts_radiance(tmp_path: Path) -> None:
    image = clean(sphere_scene(tmp_path, size=32))[0, :, :, 0]
    rows, columns = np.indices(image.shape)
    x, y = (columns + 0.5 - 16) / 14.4, (16 - rows - 0.5) / 14.4
    z = np.sqrt(np.clip(1 - x**2 - y**2, 0, None))
    light = np.array([0.3, 0.2, 0.93]) / np.linalg.norm([0.3, 0.2, 0.93])
    expected = 0.5 / math.pi * 3.0 * np.clip(x * light[0] + y * light[1] + z * light[2], 0, None)
    np.testing.assert_allclose(image, np.where(x**2 + y**2 < 1, expected, 0), atol=1e-12)


@pytest.mark.parametrize("transfer", ['"srgb"', "2.2"])
def test_encoded_images_are_decoded_to_the_same_radiance(tmp_path: Path, transfer: str) -> None:
    scene = sphere_scene(tmp_path, noise(16, 0.0, 0.0), f"[encoding]\ntransfer = {transfer}\nscale = 0.6\n")
    capture = load_capture(simulate(scene))
    expected = clean(scene)[0].reshape(-1, 1)[capture.scene.surface.pixels]
    np.testing.assert_allclose(capture.radiance(0), expected, atol=0.6 * 2e-5)


def test_black_level_and_exposure_are_undone_by_loading(tmp_path: Path) -> None:
    lights = "exposure = 0.5\nlights = [ { direction = [0.3, 0.2, 0.93], irradiance = 3.0 } ]"
    scene = sphere_scene(tmp_path, noise(16, 0.0, 0.0), "[encoding]\nblack = 0.05\n", f"[[image]]\n{lights}\n")
    folder = simulate(scene)
    capture = load_capture(folder)
    expected = clean(scene)[0].reshape(-1, 1)[capture.scene.surface.pixels]
    np.testing.assert_allclose(capture.radiance(0), expected, atol=2e-5)
    assert read_image(folder / "00.png")[0, 0, 0] == round(0.05 * 65535)


def test_noise_has_the_stated_variance(tmp_path: Path) -> None:
    scene = sphere_scene(tmp_path, noise(None, 0.01, 0.002), SIX_LIGHTS, size=64)
    folder = simulate(scene)
    signal = clean(scene)
    stored = np.stack([read_image(folder / f"{k:02d}.exr") for k in range(6)])
    normalised = (stored - signal) / np.sqrt(0.01**2 + 0.002 * signal)
    count = normalised.size
    assert normalised.mean() == pytest.approx(0, abs=4 / math.sqrt(count))
    assert normalised.std() == pytest.approx(1, abs=4 / math.sqrt(2 * count))
    bright = signal > 0.3
    assert normalised[bright].std() == pytest.approx(1, abs=4 / math.sqrt(2 * bright.sum()))


@pytest.mark.parametrize("factor", [2, 3])
def test_supersampled_pixels_are_means_of_finer_ones(tmp_path: Path, factor: int) -> None:
    coarse = clean(sphere_scene(tmp_path / "coarse", size=20, supersampling=factor))
    fine = clean(sphere_scene(tmp_path / "fine", size=20 * factor))
    expected = fine.reshape(1, 20, factor, 20, factor, 1).mean(axis=(2, 4))
    np.testing.assert_allclose(coarse, expected, atol=1e-12)


def test_supersampled_masks_mark_every_touched_pixel(tmp_path: Path) -> None:
    mask = read_image(simulate(sphere_scene(tmp_path, size=20, supersampling=4)) / "mask.png")[..., 0]
    image = read_image(tmp_path / "00.exr")[..., 0]
    assert (mask[image > 0] > 0).all()
    assert set(np.unique(mask)) > {0, 255}
    coverage = mask.sum() / 255
    assert coverage == pytest.approx(math.pi * 9.0**2, rel=0.02)


def test_normals_are_unit_vectors_on_the_object_and_zero_off_it(tmp_path: Path) -> None:
    folder = simulate(sphere_scene(tmp_path, size=20, supersampling=3))
    normals, mask = read_image(folder / "normals.exr"), read_image(folder / "mask.png")[..., 0] > 0
    length = np.linalg.norm(normals, axis=2)
    np.testing.assert_allclose(length[mask], 1, atol=1e-6)
    assert not length[~mask].any()


@pytest.mark.parametrize("supersampling", [1, 2])
def test_a_mask_restricts_the_object(tmp_path: Path, supersampling: int) -> None:
    half = np.zeros((24, 24), np.uint8)
    half[:, :12] = 255
    write_image(tmp_path / "half.png", half)
    file = sphere_scene(tmp_path, supersampling=supersampling)
    file.write_text('mask = "half.png"\n' + file.read_text("utf-8"), "utf-8")
    simulate(file, tmp_path / "out")
    assert not read_image(tmp_path / "out" / "00.exr")[:, 12:].any()
    assert not read_image(tmp_path / "out" / "mask.png")[:, 12:].any()


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("irradiance", [0.03, 3.0, 4000.0])
def test_scale_is_chosen_so_that_nothing_clips(tmp_path: Path, irradiance: float, bits: int) -> None:
    scene = sphere_scene(tmp_path, noise(bits, 0.0, 0.0), scenes.distant(([0.0, 0.0, 1.0],), irradiance))
    brightest = read_image(simulate(scene) / "00.png").max() / (2**bits - 1)
    assert 0.8 < brightest <= 0.9 + 1 / 2**bits
    scale = load_capture(tmp_path).photographs.encoding.scale
    assert len(f"{scale:.12g}".replace(".", "").strip("0")) <= 2


def test_a_given_scale_is_kept(tmp_path: Path) -> None:
    simulate(sphere_scene(tmp_path, noise(16), "[encoding]\nscale = 2.5\n"))
    assert load_capture(tmp_path).photographs.encoding.scale == 2.5


def test_a_dark_scene_can_be_rendered(tmp_path: Path) -> None:
    folder = simulate(sphere_scene(tmp_path, noise(16, 0.0, 0.0), scenes.distant(([0.0, 0.0, -1.0],))))
    assert not read_image(folder / "00.png").any()


def test_a_capture_states_the_uncertainty_that_its_scene_states(tmp_path: Path) -> None:
    stated = "[uncertainty]\ndirection = 0.01\npose = [0.5, 0.01]\n"
    capture = load_capture(simulate(sphere_scene(tmp_path, noise(16), SIX_LIGHTS, stated)))
    assert capture.uncertainty.stated == {"direction": 0.01, "pose": (0.5, 0.01)}


def test_loading_gives_back_lights_noise_and_camera(tmp_path: Path) -> None:
    capture = load_capture(simulate(sphere_scene(tmp_path, noise(16), SIX_LIGHTS)))
    assert len(capture) == 6
    assert capture.photographs.noise_stated
    assert capture.photographs.noise.gain == 0.0005
    assert capture.photographs.noise.read == pytest.approx(0.002, rel=1e-3)
    assert not capture.relative
    for (light,), direction in zip(capture.scene.lights, scenes.LIGHTS, strict=True):
        np.testing.assert_allclose(light.direction, np.array(direction) / np.linalg.norm(direction))
        assert light.irradiance.tolist() == [3.0]


def test_one_colour_makes_colour_images(tmp_path: Path) -> None:
    scene = sphere_scene(tmp_path, scenes.material("lambert", albedo=[0.2, 0.4, 0.6]))
    image = read_image(simulate(scene) / "00.exr")
    assert image.shape == (24, 24, 3)
    np.testing.assert_allclose(image[..., 2], 3 * image[..., 0], rtol=1e-6)


def test_meshes_travel_with_the_capture(tmp_path: Path) -> None:
    trimesh.creation.icosphere(subdivisions=3).export(tmp_path / "ball.ply")
    geometry = '[geometry]\nmesh = "ball.ply"\n[camera]\nheight = 2.5\nresolution = [20, 24]\n'
    folder = simulate(scenes.write(tmp_path, LAMBERT, geometry, noise(16), ONE_LIGHT), tmp_path / "out")
    assert (folder / "ball.ply").read_bytes() == (tmp_path / "ball.ply").read_bytes()
    assert load_capture(folder).scene.surface.shape == (24, 20)


def test_a_normal_map_is_the_geometry_of_the_capture(tmp_path: Path) -> None:
    first = simulate(sphere_scene(tmp_path / "sphere"))
    (tmp_path / "map").mkdir()
    (tmp_path / "map" / "n.exr").write_bytes((first / "normals.exr").read_bytes())
    scene = scenes.write(tmp_path / "map", LAMBERT, '[geometry]\nnormals = "n.exr"\n', ONE_LIGHT)
    folder = simulate(scene, tmp_path / "out")
    np.testing.assert_allclose(read_image(folder / "00.exr"), read_image(first / "00.exr"), atol=1e-6)
    assert len(load_capture(folder).scene.surface) == len(load_capture(first).scene.surface)


def test_progress_counts_images(tmp_path: Path) -> None:
    calls: list[tuple[object, ...]] = []
    simulate(sphere_scene(tmp_path, SIX_LIGHTS), None, lambda *said: calls.append(said))
    assert calls == [("rendering images", k, 6) for k in range(1, 7)]


def test_parts_of_a_sum_may_be_given_by_path_or_in_tables(tmp_path: Path) -> None:
    by_path = scenes.material("lambert+torrance-sparrow", lambert__albedo=0.3, torrance_sparrow__sigma=0.2)
    in_tables = scenes.material("lambert+torrance-sparrow") + (
        "\nlambert = { albedo = 0.3 }\ntorrance-sparrow = { sigma = 0.2 }\n"
    )
    first, second = (
        load_scene(sphere_scene(tmp_path / name, text)).material
        for name, text in (("path", by_path), ("tables", in_tables))
    )
    assert first.expression == second.expression
    assert {k: float(v) for k, v in first.parameters.items()} == {k: float(v) for k, v in second.parameters.items()}
    assert float(first.parameters["torrance-sparrow.sigma"]) == 0.2


def test_a_capture_that_was_photographed_is_never_overwritten(tmp_path: Path) -> None:
    scene = sphere_scene(tmp_path, noise(16))
    (tmp_path / "capture.toml").write_text("# my photographs\n", "utf-8")
    cv2.imwrite(str(tmp_path / "00.png"), np.zeros((4, 4), np.uint8))
    before = files(tmp_path)
    message = refusal(lambda: simulate(scene))
    assert "capture.toml" in message
    assert "-o" in message
    assert files(tmp_path) == before


@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(28, "No space left")], ids=["stopped", "full"])
def test_a_rendering_that_ends_early_leaves_the_folder_as_it_was(tmp_path: Path, error: BaseException) -> None:
    def end(_: str, number: int, count: int) -> None:
        if number == count:
            raise error

    scene = sphere_scene(tmp_path / "scene", noise(16), SIX_LIGHTS)
    with pytest.raises(type(error)):
        simulate(scene, tmp_path / "new", end)
    assert not (tmp_path / "new").exists()
    folder = simulate(scene, tmp_path / "earlier")
    before = files(folder)
    with pytest.raises(type(error)):
        simulate(sphere_scene(tmp_path / "scene", noise(16, 0.1), SIX_LIGHTS), folder, end)
    assert files(folder) == before


def test_a_mesh_that_lies_in_the_way_is_not_overwritten(tmp_path: Path) -> None:
    trimesh.creation.icosphere(subdivisions=3).export(tmp_path / "ball.ply")
    geometry = '[geometry]\nmesh = "ball.ply"\n[camera]\nheight = 2.5\nresolution = [20, 24]\n'
    scene = scenes.write(tmp_path, LAMBERT, geometry, noise(16), ONE_LIGHT)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "ball.ply").write_bytes(b"another mesh")
    assert "ball.ply: would be overwritten" in refusal(lambda: simulate(scene, tmp_path / "out"))
    assert files(tmp_path / "out") == {"ball.ply": b"another mesh"}


def test_no_partial_file_is_left_behind(tmp_path: Path) -> None:
    folder = simulate(sphere_scene(tmp_path, noise(16)))
    assert {path.name for path in folder.iterdir()} == {
        "scene.toml",
        "00.png",
        "mask.png",
        "normals.exr",
        "capture.toml",
    }


def test_a_sphere_is_fitted_to_the_mask_of_a_supersampled_scene(tmp_path: Path) -> None:
    first = simulate(sphere_scene(tmp_path / "stated"))
    geometry = '[geometry]\nshape = "sphere"\n[camera]\nresolution = [24, 24]\nsupersampling = 2\n'
    (tmp_path / "fitted").mkdir()
    (tmp_path / "fitted" / "disc.png").write_bytes((first / "mask.png").read_bytes())
    fitted = load_scene(scenes.write(tmp_path / "fitted", 'mask = "disc.png"', LAMBERT, geometry, ONE_LIGHT))
    assert fitted.scene.surface.shape == (48, 48)
    stated = load_scene(sphere_scene(tmp_path / "again", supersampling=2))
    inside = stated.scene.surface.mask & fitted.scene.surface.mask
    normals = [scene.scene.surface.image(scene.scene.surface.normals.numpy())[inside] for scene in (fitted, stated)]
    np.testing.assert_allclose(*normals, atol=0.06)
