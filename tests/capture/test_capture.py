from __future__ import annotations

import hashlib
import math
import os
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

import matest
from matest.brdf import Lambert
from matest.capture.capture import present_digests
from matest.photographs.images import ImageFile, read_image, write_image
from matest.samples.uncertainty import Uncertainty
from tests.captures import (
    ALBEDO,
    RADIUS,
    SHAPE,
    encode_as_png,
    inside_sphere,
    lambert_sphere,
    refusal,
    sphere_normals,
)
from tests.photographs.image_files import write_exr


def mapped(folder) -> None:
    """Give the geometry of the sphere as a normal map."""
    write_image(folder.path / "normals.exr", sphere_normals().astype(np.float32))
    folder.tables["geometry"] = {"normals": "normals.exr"}


def meshed(folder) -> None:
    """Give the geometry as a mesh of radius 1 seen by an orthographic camera that puts it where the sphere was."""
    trimesh.creation.icosphere(5).export(folder.path / "ball.ply")
    across, up = (SHAPE[1] / 2 - 23.5) / RADIUS, -(SHAPE[0] / 2 - 20.25) / RADIUS
    folder.tables["geometry"] = {"mesh": "ball.ply"}
    folder.tables["camera"] = {
        "position": [across, up, 5.0],
        "target": [across, up, 0.0],
        "height": SHAPE[0] / RADIUS,
    }


@pytest.mark.parametrize("geometry", ["sphere", "normals", "mesh"])
def test_the_true_material_renders_what_was_photographed(folder, geometry):
    {"sphere": lambda _: None, "normals": mapped, "mesh": meshed}[geometry](folder)
    capture = folder.load()
    assert (len(capture), capture.channels, capture.relative) == (2, 3, False)
    images = matest.render(capture.scene, Lambert(albedo=list(ALBEDO)), dtype=torch.float64).numpy()
    inner = ~capture.scene.surface.rim
    # A mesh of 20 000 triangles has normals good to a thousandth, and shadows uncertain by as much at the terminator.
    tolerance = 2e-3 if geometry == "mesh" else 1e-5
    for k in range(2):
        rendered = images[k].reshape(-1, 3)[capture.scene.surface.pixels]
        np.testing.assert_allclose(rendered[inner], capture.radiance(k)[inner], atol=tolerance)
        assert capture.radiance(k)[inner].max() > 0.2


def test_a_sphere_without_centre_and_radius_is_fitted_to_the_mask(folder):
    given = folder.load().scene.surface
    folder.tables["geometry"] = {"shape": "sphere"}
    fitted = folder.load().scene.surface
    inner = given.take(~given.rim)
    rows = np.searchsorted(fitted.pixels, inner.pixels)
    np.testing.assert_array_equal(fitted.pixels[rows], inner.pixels)
    np.testing.assert_allclose(fitted.normals[rows], inner.normals, atol=0.02)


def test_only_a_circle_that_was_fitted_is_uncertain(folder):
    assert folder.load().circle_uncertainty == Uncertainty()
    folder.tables["geometry"] = {"shape": "sphere"}
    folder.tables["uncertainty"] = {"radius": 0.7}
    capture = folder.load()
    pixels, angle = capture.circle_uncertainty.pose
    # The mask is binary: its edge is right to a fraction of a pixel.
    assert 0.01 < pixels < 0.1
    assert angle == pytest.approx(pixels / RADIUS, rel=0.01)
    assert 0.01 < capture.circle_uncertainty.radius < 0.1
    assert capture.uncertainty == Uncertainty(radius=0.7)
    assert capture.stated_uncertainty == Uncertainty(pose=(pixels, angle), radius=0.7)


def test_an_integer_normal_map_encodes_minus_one_to_one(folder):
    normals = sphere_normals()
    codes = np.where(inside_sphere()[..., None], np.round((normals + 1) / 2 * 65535), 0).astype(np.uint16)
    folder.put("normals.png", codes)
    folder.tables["geometry"] = {"normals": "normals.png"}
    surface = folder.load().scene.surface
    np.testing.assert_array_equal(surface.mask, inside_sphere())
    np.testing.assert_allclose(surface.normals, normals[inside_sphere()], atol=1e-4)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_integer_images_decode_to_radiance(folder, dtype):
    encode_as_png(folder, dtype)
    folder.tables["encoding"] |= {"scale": 3.0, "black": 0.02}
    folder.tables["image"][1]["exposure"] = 2.0
    capture = folder.load()
    assert capture.photographs.stored[0].dtype == dtype
    for k, exposure in enumerate([1.0, 2.0]):
        truth = lambert_sphere(folder.tables["image"][k]["lights"])[capture.scene.surface.mask]
        expected = (truth - 0.02) * 3.0 / exposure
        np.testing.assert_allclose(capture.radiance(k), expected, atol=3 / np.iinfo(dtype).max)


def test_transfer_given_to_load_overrides_that_of_the_file(folder):
    encode_as_png(folder, np.uint16)
    linear, gamma = folder.load().radiance(0), folder.load(transfer=2.0).radiance(0)
    np.testing.assert_allclose(gamma, linear**2, atol=1e-4)
    del folder.tables["encoding"]
    np.testing.assert_array_equal(folder.load(transfer="linear").radiance(0), linear)


def test_dark_frame_and_flat_field_are_applied(folder):
    flat = np.linspace(0.5, 1.0, SHAPE[0] * SHAPE[1]).reshape(*SHAPE, 1).astype(np.float32) * np.ones(3, np.float32)
    dark = 0.01 + 0.01 * flat[::-1]
    truth = lambert_sphere(folder.tables["image"][0]["lights"])
    folder.put("00.npy", truth * flat + dark)
    folder.put("dark.npy", dark)
    folder.put("flat.npy", flat)
    folder.tables["encoding"] = {"black": "dark.npy", "flat": "flat.npy"}
    capture = folder.load()
    np.testing.assert_allclose(capture.radiance(0), truth[capture.scene.surface.mask], atol=1e-6)


def test_lights_are_as_the_file_says(folder):
    folder.tables["image"][0]["lights"] = [
        {"direction": [0.0, 3.0, 4.0], "irradiance": 2.0},
        {"position": [1.0, 2.0, 9.0], "intensity": [4.0, 5.0, 6.0]},
        {"direction": [0.0, 0.0, 1.0], "radiance": 10.0, "solid_angle": 0.05},
    ]
    folder.tables["image"][0]["ambient"] = [0.1, 0.2, 0.3]
    scene = folder.load().scene
    distant, near, disc = scene.lights[0]
    assert distant.direction.tolist() == [0.0, 0.6, 0.8]
    assert distant.irradiance.tolist() == [2.0] * 3
    assert near.position.tolist() == [1.0, 2.0, 9.0]
    assert near.intensity.tolist() == [4.0, 5.0, 6.0]
    assert disc.irradiance.tolist() == pytest.approx([0.5] * 3)
    assert scene.ambient.tolist() == [[0.1, 0.2, 0.3], [0.0, 0.0, 0.0]]


def test_a_light_of_unknown_power_is_pi_and_makes_the_capture_relative(folder):
    del folder.tables["image"][1]["lights"][0]["irradiance"]
    capture = folder.load()
    assert capture.relative
    assert capture.scene.lights[1][0].irradiance.tolist() == [math.pi] * 3
    assert capture.scene.lights[0][0].irradiance.tolist() == [1.2, 1.0, 0.8]


def test_radiometry_may_be_declared_relative(folder):
    folder.tables["encoding"] = {"radiometry": "relative"}
    assert folder.load().relative


def test_stated_noise_is_used_and_otherwise_estimated(folder):
    encode_as_png(folder, np.uint16)
    capture = folder.load()
    assert not capture.photographs.noise_stated
    folder.tables["noise"] = {"read": 0.01, "gain": 0.002}
    capture = folder.load()
    assert capture.photographs.noise_stated
    assert capture.photographs.noise.read == pytest.approx(0.01, rel=1e-4)
    assert capture.photographs.noise.gain == 0.002


def test_noise_is_estimated_from_the_photographs(folder):
    rng = np.random.default_rng(9)
    lights = folder.tables["image"][0]["lights"]
    truth = lambert_sphere(lights)
    deviation = np.sqrt(0.01**2 + 0.001 * truth)
    tables = []
    for k in range(8):
        noisy = truth + rng.normal(size=truth.shape) * deviation
        folder.put(f"n{k}.png", np.round(65535 * (noisy + 0.05).clip(0, 1)).astype(np.uint16))
        tables.append({"file": f"n{k}.png", "lights": lights})
    folder.tables |= {"image": tables, "encoding": {"transfer": "linear", "black": 0.05}}
    noise = folder.load().photographs.noise
    # 500 pixels in three channels of eight images: the line is good to some 6 % within the range of the signal.
    for signal in (0.05, 0.25):
        expected = 0.01**2 + 0.001 * signal
        assert noise.read**2 + noise.gain * signal == pytest.approx(expected, rel=0.15)


def test_a_grey_image_stays_one_channel(folder):
    for table in folder.tables["image"]:
        folder.put(table["file"], np.load(folder.path / table["file"])[..., 0])
        table["lights"][0]["irradiance"] = 1.0
    capture = folder.load()
    assert capture.channels == 1
    assert capture.scene.points(0).irradiance.shape[-1] == 1


def test_the_capture_file_may_be_named_itself(folder):
    folder.save()
    by_folder, by_file = matest.load_capture(folder.path), matest.load_capture(str(folder.file))
    assert by_folder.name == by_file.name == folder.path.name
    np.testing.assert_array_equal(by_folder.photographs.stored[0], by_file.photographs.stored[0])


@pytest.mark.parametrize("path", [".", "capture.toml", "../{name}", "../{name}/capture.toml"])
def test_a_path_relative_to_the_working_folder_is_followed(folder, monkeypatch, path):
    monkeypatch.chdir(folder.save())
    assert len(matest.load_capture(path.format(name=folder.path.name))) == 2


def test_files_may_lie_above_the_capture_within_the_root(folder, tmp_path):
    inner = tmp_path / "inner"
    inner.mkdir()
    (tmp_path / "mask.png").rename(tmp_path / "shared.png")
    for table in folder.tables["image"]:
        (tmp_path / table["file"]).rename(inner / table["file"])
    folder.path = inner
    folder.tables["mask"] = "../shared.png"
    assert "outside" in refusal(folder.load)
    assert len(folder.load(root=tmp_path)) == 2


def test_digests_are_those_of_the_files(folder):
    capture = folder.load()
    content = (folder.path / "01.npy").read_bytes()
    assert capture.digests()["01.npy"] == "sha256:" + hashlib.sha256(content).hexdigest()
    assert list(capture.digests()) == ["00.npy", "01.npy", "capture.toml", "mask.png"]


def test_digests_are_those_of_the_files_as_they_were_read(folder):
    before = folder.load().digests()
    capture = folder.load()
    assert present_digests(folder.path) == before
    folder.put("01.npy", np.load(folder.path / "00.npy"))
    assert present_digests(folder.path) == before | {"01.npy": before["00.npy"]}
    (folder.path / "mask.png").unlink()
    assert capture.digests() == before
    assert "mask.png: no such file" in refusal(lambda: present_digests(folder.path))


@pytest.mark.parametrize("name", ["00.npy", "01.npy", "mask.png"])
def test_a_file_that_is_written_while_it_is_read_is_refused(folder, monkeypatch, name):
    def disturbed(path):
        image = read_image(path)
        if path.name == name:
            path.write_bytes(path.read_bytes())
        return image

    def disturbed_file(path):
        return ImageFile(disturbed(path), None, ())

    monkeypatch.setattr("matest.capture.capture.read_image_file", disturbed_file)
    monkeypatch.setattr("matest.capture.geometry.read_image", disturbed)
    monkeypatch.setattr("matest.capture.geometry.read_mask", lambda path: disturbed(path)[..., 0])
    # Long ago: the clock of a file system may not tell two moments of a test apart.
    os.utime(folder.path / name, (0, 0))
    message = refusal(folder.load)
    assert message.startswith(f"{folder.path / name}: ")


def test_progress_counts_the_images(folder):
    calls = []
    folder.load(progress=lambda *said: calls.append(said))
    assert calls[-1] == ("reading images", 2, 2)


def test_pixels_beyond_the_memory_budget_are_the_same(folder, monkeypatch):
    in_memory = folder.load()
    monkeypatch.setattr("matest.photographs.storage.MEMORY_BUDGET", 1)
    spilled = folder.load()
    for k in range(2):
        assert isinstance(spilled.photographs.stored[k], np.memmap)
        np.testing.assert_array_equal(spilled.photographs.stored[k], in_memory.photographs.stored[k])


def test_an_exr_capture_equals_the_same_values_in_npy(folder):
    expected = folder.load()
    for table in folder.tables["image"]:
        image = np.load(folder.path / table["file"])
        table["file"] = Path(table["file"]).with_suffix(".exr").name
        write_exr(folder.path / table["file"], {c: np.ascontiguousarray(image[..., k]) for k, c in enumerate("RGB")})
    capture = folder.load()
    for k in range(2):
        np.testing.assert_array_equal(capture.radiance(k), expected.radiance(k))


def as_exr_with_alpha(folder, count: int) -> None:
    """Store the first `count` images with alpha 0.5 multiplied into them, and the others with alpha 1."""
    for k, table in enumerate(folder.tables["image"]):
        image, alpha = np.load(folder.path / table["file"]), np.full(SHAPE, 0.5 if k < count else 1.0, np.float32)
        table["file"] = Path(table["file"]).with_suffix(".exr").name
        planes = {c: np.ascontiguousarray(image[..., channel] * alpha) for channel, c in enumerate("RGB")}
        write_exr(folder.path / table["file"], planes | {"A": alpha})


@pytest.mark.parametrize(("count", "images"), [(1, "00.exr"), (2, "All images")])
def test_what_a_reader_did_to_images_is_told_once_for_all_of_them(folder, count, images):
    expected = folder.load()
    as_exr_with_alpha(folder, count)
    capture = folder.load()
    for k in range(2):
        np.testing.assert_array_equal(capture.radiance(k), expected.radiance(k))
    sentence = f"{images}: alpha was multiplied into the colours and is divided out; pixels of alpha 0 are 0."
    assert capture.photographs.notes == (sentence,)
    assert sentence in matest.estimate(capture, "lambert").warnings
    assert sentence in matest.check(capture, "lambert").warnings


def test_many_images_with_one_note_are_counted(folder):
    as_exr_with_alpha(folder, 2)
    folder.tables["image"] += folder.tables["image"][:1] * 3
    folder.put("05.npy", lambert_sphere(folder.tables["image"][0]["lights"]))
    folder.tables["image"].append({**folder.tables["image"][0], "file": "05.npy"})
    (note,) = folder.load().photographs.notes
    assert note.startswith("00.exr, 01.exr, 00.exr and 2 more: alpha")


def test_a_photograph_with_alpha_serves_as_the_mask(folder):
    expected = folder.load()
    alpha = inside_sphere().astype(np.float32)
    write_exr(folder.path / "cut_out.exr", dict.fromkeys("RGB", 0.3 * alpha) | {"A": alpha})
    folder.tables["mask"] = "cut_out.exr"
    np.testing.assert_array_equal(folder.load().scene.surface.pixels, expected.scene.surface.pixels)


def test_a_saturated_photograph_does_not_disturb_the_noise_estimate(folder):
    rng = np.random.default_rng(10)
    for table in folder.tables["image"]:
        truth = 7 * lambert_sphere(table["lights"])
        noisy = (truth + 0.01 * rng.normal(size=truth.shape)).clip(0, 1)
        assert (noisy == 1).mean() > 0.01
        table["file"] = table["file"].replace("npy", "png")
        folder.put(table["file"], np.round(65535 * noisy).astype(np.uint16))
    folder.tables["encoding"] = {"transfer": "linear"}
    noise = folder.load().photographs.noise
    assert noise.read**2 + noise.gain * 0.5 == pytest.approx(0.01**2, rel=0.3)
