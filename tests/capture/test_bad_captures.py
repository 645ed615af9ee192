"""Captures that cannot be used: each is refused in one sentence that names the file and the mend."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh

import matest
from matest.photographs.images import write_image
from tests.captures import SHAPE, encode_as_png, refusal, sphere_normals

SMALL = (SHAPE[0] // 2, SHAPE[1] // 2)


def test_a_folder_without_capture_file_is_refused(tmp_path):
    message = refusal(lambda: matest.load_capture(tmp_path))
    assert str(tmp_path) in message
    assert "capture.toml" in message


def test_a_path_that_does_not_exist_is_refused(tmp_path):
    for path in (tmp_path / "nowhere", tmp_path / "nowhere.toml"):
        assert str(path) in refusal(lambda path=path: matest.load_capture(path))


def test_a_missing_image_is_refused(folder):
    (folder.path / "01.npy").unlink()
    message = refusal(folder.load)
    assert str(folder.path / "01.npy") in message
    assert "no such file" in message


@pytest.mark.parametrize("number", [0, 1])
def test_an_unreadable_image_is_refused(folder, number):
    encode_as_png(folder, np.uint8)
    path = folder.path / f"{number:02d}.png"
    path.write_bytes(b"\x89PNG\r\n\x1a\n no picture")
    message = refusal(folder.load)
    assert str(path) in message
    assert "cannot be read" in message


@pytest.mark.parametrize("number", [0, 1])
def test_a_truncated_png_is_refused(folder, number):
    encode_as_png(folder, np.uint16)
    path = folder.path / f"{number:02d}.png"
    path.write_bytes(path.read_bytes()[:-200])
    message = refusal(folder.load)
    assert str(path) in message
    assert "truncated" in message


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_values_that_are_not_finite_in_an_exr_are_refused(folder, bad):
    image = np.load(folder.path / "01.npy")
    image[20, 20, 1] = bad
    for table in folder.tables["image"]:
        table["file"] = table["file"].replace("npy", "exr")
        write_image(folder.path / table["file"], image)
    message = refusal(folder.load)
    assert str(folder.path / "00.exr") in message
    assert (
        "1 pixel holds NaN, infinity or larger ones. Set it to 0 in the file; in a photograph leave it out of the mask"
        in message
    )


def test_pixels_that_are_not_finite_are_counted_once_each(folder):
    image = np.load(folder.path / "01.npy")
    image[3, 3], image[4, 4, 1], image[5, 5, 2] = math.nan, math.inf, -1e30
    folder.put("01.npy", image)
    message = refusal(folder.load)
    assert "3 pixels hold NaN, infinity or larger ones. Set them to 0 in the file; in a photograph leave" in message


def test_images_of_different_sizes_are_refused(folder):
    folder.put("01.npy", np.ones((*SMALL, 3), np.float32))
    message = refusal(folder.load)
    assert str(folder.path / "01.npy") in message
    for size in (SHAPE, SMALL):
        assert "×".join(map(str, size)) in message


@pytest.mark.parametrize("other", [np.ones(SHAPE, np.float32), np.ones((*SHAPE, 3), np.uint16)])
def test_images_of_different_kinds_are_refused(folder, other):
    folder.put("01.npy", other)
    message = refusal(folder.load)
    assert str(folder.path / "01.npy") in message
    assert "float32" in message


@pytest.mark.parametrize("odd", [0, 1, 3])
@pytest.mark.parametrize(
    ("other", "says"),
    [
        (np.ones((*SHAPE, 3), np.uint16), "got 3 channel(s) of uint16"),
        (np.ones(SHAPE, np.float32), "got 1 channel(s) of float32"),
        (np.ones((*SMALL, 3), np.float32), "×".join(map(str, SMALL))),
    ],
)
def test_the_image_that_differs_from_most_is_the_one_that_is_named(folder, other, says, odd):
    table = folder.tables["image"][0]
    folder.tables["image"] = [{**table, "file": f"{k}.npy"} for k in range(4)]
    for k in range(4):
        folder.put(f"{k}.npy", other if k == odd else np.ones((*SHAPE, 3), np.float32))
    message = refusal(folder.load)
    assert message.startswith(f"{folder.path / f'{odd}.npy'}: ")
    assert says in message
    assert " and 2 more" in message


def test_a_mask_of_another_size_is_refused(folder):
    folder.put("mask.png", np.full(SMALL, 255, np.uint8))
    message = refusal(folder.load)
    assert str(folder.path / "mask.png") in message
    for size in (SHAPE, SMALL):
        assert "×".join(map(str, size)) in message


def test_a_mask_that_is_zero_everywhere_is_refused(folder):
    folder.put("mask.png", np.zeros(SHAPE, np.uint8))
    message = refusal(folder.load)
    assert str(folder.path / "mask.png") in message
    assert "zero everywhere" in message


def test_a_mask_that_is_no_circle_is_refused(folder):
    mask = np.zeros(SHAPE, np.uint8)
    mask[8:30, 5:42] = 255
    folder.put("mask.png", mask)
    folder.tables["geometry"] = {"shape": "sphere"}
    message = refusal(folder.load)
    assert str(folder.path) in message
    assert "no circle" in message
    assert "radius" in message


@pytest.mark.parametrize("key", ["normals", "positions"])
def test_a_map_of_another_size_is_refused(folder, key):
    write_image(folder.path / "normals.exr", sphere_normals())
    write_image(folder.path / f"{key}.exr", np.ones((*SMALL, 3)))
    folder.tables["geometry"] = {"normals": "normals.exr"} | {key: f"{key}.exr"}
    message = refusal(folder.load)
    assert str(folder.path / f"{key}.exr") in message
    for size in (SHAPE, SMALL):
        assert "×".join(map(str, size)) + "×3" in message


def test_normals_that_face_away_are_refused(folder):
    write_image(folder.path / "normals.exr", sphere_normals() * (1, 1, -1))
    folder.tables["geometry"] = {"normals": "normals.exr"}
    message = refusal(folder.load)
    assert str(folder.path / "normals.exr") in message
    assert "toward the viewer" in message


def test_integer_images_without_transfer_are_refused(folder):
    encode_as_png(folder, np.uint8)
    del folder.tables["encoding"]
    message = refusal(folder.load)
    assert str(folder.file) in message
    for word in ("transfer", "linear", "srgb"):
        assert word in message


@pytest.mark.parametrize("direction", [[0.0, 0.0, 0.0], [0.0, math.nan, 1.0], [0.0, math.inf, 1.0]])
def test_a_light_without_direction_is_refused(folder, direction):
    folder.tables["image"][1]["lights"][0]["direction"] = direction
    message = refusal(folder.load)
    assert str(folder.file) in message
    assert "image 1, light 0: direction" in message


@pytest.mark.parametrize(
    "light",
    [
        {},
        {"direction": [0.0, 0.0, 1.0], "position": [0.0, 0.0, 1.0]},
        {"position": [0.0, 0.0, math.nan], "intensity": 1.0},
        {"direction": [0.0, 0.0, 1.0], "irradiance": -1.0},
        {"direction": [0.0, 0.0, 1.0], "irradiance": math.nan},
        {"direction": [0.0, 0.0, 1.0], "irradiance": 1e23},
        {"direction": [0.0, 0.0, 1.0], "irradiance": [1.0, 2.0]},
        {"direction": [0.0, 0.0, 1.0], "intensity": 1.0},
        {"position": [0.0, 0.0, 9.0], "irradiance": 1.0},
        {"direction": [0.0, 0.0, 1.0], "radiance": 1.0},
        {"direction": [0.0, 0.0, 1.0], "irradiance": 1.0, "solid_angle": -0.1},
    ],
    ids=str,
)
def test_a_light_that_makes_no_sense_is_refused(folder, light):
    folder.tables["image"][1]["lights"] = [light]
    message = refusal(folder.load)
    assert str(folder.file) in message
    assert "image 1, light 0" in message


def test_a_point_light_without_positions_is_refused(folder):
    write_image(folder.path / "normals.exr", sphere_normals())
    folder.tables["geometry"] = {"normals": "normals.exr"}
    folder.tables["image"][1]["lights"] = [{"position": [0.0, 0.0, 9.0], "intensity": 1.0}]

    def shade():
        capture = folder.load()
        return len(capture.samples())

    message = refusal(shade)
    assert str(folder.path) in message
    assert "positions" in message


def test_a_mesh_outside_the_view_is_refused(folder):
    trimesh.creation.icosphere(2).apply_translation((50, 0, 0)).export(folder.path / "ball.ply")
    folder.tables |= {"geometry": {"mesh": "ball.ply"}, "camera": {"height": 2.5}}
    message = refusal(folder.load)
    assert str(folder.path / "ball.ply") in message
    assert "outside the view" in message
    assert "camera.position" in message


def test_a_mesh_without_camera_is_refused(folder):
    trimesh.creation.icosphere(2).export(folder.path / "ball.ply")
    folder.tables["geometry"] = {"mesh": "ball.ply"}
    message = refusal(folder.load)
    assert str(folder.file) in message
    assert "[camera]" in message


@pytest.mark.parametrize(
    ("key", "words"),
    [("mask", "mask ="), ("file", "image 1: file ="), ("mesh", "geometry.mesh ="), ("black", "encoding.black =")],
)
@pytest.mark.parametrize("reference", ["../outside", "/nowhere/file", "inner/../../outside"])
def test_a_file_outside_the_folder_is_refused(folder, key, words, reference):
    if key == "mask":
        folder.tables["mask"] = reference
    elif key == "file":
        folder.tables["image"][1]["file"] = reference
    elif key == "mesh":
        folder.tables |= {"geometry": {"mesh": reference}, "camera": {"height": 2.5}}
    else:
        folder.tables["encoding"] = {"black": reference}
    message = refusal(folder.load)
    assert f"{words} '{reference}'" in message
    assert "outside" in message
    assert str(folder.path) in message


def test_the_file_that_refers_outside_is_named(folder):
    folder.tables["mask"] = "../outside.png"
    assert str(folder.file) in refusal(folder.load)


@pytest.mark.parametrize(
    ("table", "typo", "key"),
    [
        ("geometry", "raduis", "radius"),
        ("encoding", "trasnfer", "transfer"),
        ("camera", "heigth", "height"),
        ("noise", "raed", "read"),
    ],
)
def test_a_typo_names_the_nearest_known_key(folder, table, typo, key):
    folder.tables.setdefault(table, {})[typo] = 1.0
    message = refusal(folder.load)
    assert str(folder.file) in message
    assert f"'{typo}'" in message
    assert f"'{key}'" in message


@pytest.mark.parametrize(
    ("table", "values", "word"),
    [
        ("geometry", {"shape": "sphere", "centre": [20.0, 20.0]}, "radius"),
        ("geometry", {"shape": "sphere", "centre": [20.0, 20.0], "radius": -3.0}, "radius"),
        ("geometry", {"shape": "sphere", "centre": [900.0, 20.0], "radius": 3.0}, "no pixel"),
        ("geometry", {}, "mesh, normals or shape"),
        ("geometry", {"shape": "sphere", "mesh": "a.ply"}, "mesh and shape"),
        ("camera", {"kind": "perspective"}, "fov_y or matrix"),
        ("camera", {"kind": "perspective", "fov_y": 4.0}, "fov_y"),
        ("camera", {"kind": "perspective", "fov_y": 0.4}, "perspective"),
        ("camera", {"height": 0.0}, "height"),
        ("camera", {"fov_y": 0.4}, "orthographic"),
        ("camera", {"position": [0.0, 0.0, 0.0]}, "position"),
        ("encoding", {"transfer": -2.2}, "transfer"),
        ("encoding", {"scale": 0.0}, "scale"),
        ("encoding", {"scale": -1.0}, "scale"),
        ("encoding", {"scale": math.nan}, "scale"),
        ("noise", {"read": -0.1}, "read"),
        ("encoding", {"saturation": math.nan}, "saturation"),
        ("encoding", {"black": math.nan}, "black"),
        ("noise", {"gain": math.nan}, "gain"),
        ("noise", {"read": 1e30}, "read"),
    ],
    ids=str,
)
def test_values_out_of_range_are_refused(folder, table, values, word):
    if table == "camera" and "fov_y" not in values:
        write_image(folder.path / "normals.exr", sphere_normals())
        folder.tables["geometry"] = {"normals": "normals.exr"}
    folder.tables[table] = values
    message = refusal(folder.load)
    assert str(folder.file) in message
    assert word in message


@pytest.mark.parametrize("exposure", [0.0, -1.0, math.nan, math.inf])
def test_an_exposure_that_is_not_positive_is_refused(folder, exposure):
    folder.tables["image"][1]["exposure"] = exposure
    message = refusal(folder.load)
    assert str(folder.file) in message
    assert "image 1: exposure" in message


def test_ambient_light_too_strong_for_single_precision_is_refused(folder):
    folder.tables["image"][1]["ambient"] = [1e23, 1.0, 1.0]
    message = refusal(folder.load)
    assert str(folder.file) in message
    assert "image 1: ambient" in message


def test_a_flat_field_with_zeros_is_refused(folder):
    folder.put("flat.npy", np.zeros(SHAPE, np.float32))
    folder.tables["encoding"] = {"flat": "flat.npy"}
    message = refusal(folder.load)
    assert str(folder.path / "flat.npy") in message
    assert "positive" in message


@pytest.mark.parametrize("key", ["black", "flat"])
def test_a_frame_of_another_size_is_refused(folder, key):
    folder.put("frame.npy", np.ones(SMALL, np.float32))
    folder.tables["encoding"] = {key: "frame.npy"}
    message = refusal(folder.load)
    assert str(folder.path / "frame.npy") in message
    assert "×".join(map(str, SMALL)) in message


def test_no_image_at_all_is_refused(folder):
    del folder.tables["image"]
    folder.file.write_text("image = []\n[geometry]\nshape = 'sphere'\n", "utf-8")
    message = refusal(lambda: matest.load_capture(folder.path))
    assert str(folder.file) in message
    assert "[[image]]" in message


def test_an_image_without_file_is_refused(folder):
    del folder.tables["image"][1]["file"]
    message = refusal(folder.load)
    assert str(folder.file) in message
    assert "image 1" in message
