"""What is known of a capture before its photographs are looked at."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from matest.capture import schema
from matest.capture.description import capture_file, describe, image_channels, image_shape
from matest.photographs.images import write_image
from matest.samples.uncertainty import Uncertainty
from tests import scenes
from tests.captures import SHAPE, CaptureFolder, refusal, sphere_normals


def test_a_description_reads_no_image(folder: CaptureFolder) -> None:
    for path in folder.path.glob("*.npy"):
        path.unlink()
    description = describe(folder.save(), schema.CaptureFile)
    assert description.name == folder.path.name
    assert description.names == ("00.npy", "01.npy")
    assert description.references == [("mask", "mask.png")]
    assert description.path("mask.png", "mask") == folder.path / "mask.png"


def test_images_without_a_file_are_numbered(tmp_path: Path) -> None:
    material = scenes.material("lambert", albedo=0.5)
    file = scenes.write(tmp_path, material, scenes.sphere(24), scenes.distant(scenes.LIGHTS[:2]))
    assert describe(tmp_path, schema.SceneFile).file == file
    assert describe(file, schema.SceneFile).names == ("image 0", "image 1")


def test_images_are_as_large_as_the_camera_says_or_else_the_normal_map_or_mask(folder: CaptureFolder) -> None:
    assert image_shape(describe(folder.save(), schema.CaptureFile)) == SHAPE
    write_image(folder.path / "normals.exr", sphere_normals()[:, 2:])
    folder.tables["geometry"] = {"normals": "normals.exr"}
    assert image_shape(describe(folder.save(), schema.CaptureFile)) == (SHAPE[0], SHAPE[1] - 2)
    folder.tables["camera"] = {"resolution": [7, 5]}
    assert image_shape(describe(folder.save(), schema.CaptureFile)) == (5, 7)


def test_there_are_as_many_channels_as_the_longest_colour_has(folder: CaptureFolder) -> None:
    assert image_channels(describe(folder.save(), schema.CaptureFile)) == 3
    for table in folder.tables["image"]:
        table["lights"][0]["irradiance"] = 1.0
    grey = describe(folder.save(), schema.CaptureFile)
    assert (image_channels(grey), image_channels(grey, [1, 3])) == (1, 3)
    assert "3 values" in refusal(lambda: image_channels(grey, [2]))


@pytest.mark.parametrize(
    ("table", "values", "words"),
    [
        ("noise", {"read": -0.1}, "noise.read must be below 1e+15 and not negative; got -0.1"),
        ("encoding", {"scale": 1e-300}, "encoding.scale is the radiance of full scale and must lie between"),
        (
            "encoding",
            {"scale": 0.0},
            "encoding.scale is the radiance of full scale and must lie between 1e-15 and 1e+15; got 0.0.",
        ),
        (
            "geometry",
            {"shape": "sphere", "radius": -3.0},
            "geometry.radius must be pixels, 0.001 or more and below 1e+15; got -3.0.",
        ),
        (
            "geometry",
            {"normals": "n.exr", "width": 0.0},
            "geometry.width must be positive world units, below 1e+15; got 0.0.",
        ),
        ("geometry", {"shape": "sphere", "width": 2.0}, "geometry.width goes with normals seen by a distant viewer"),
        (
            "geometry",
            {"normals": "n.exr", "positions": "p.exr", "width": 2.0},
            "geometry.width goes with normals seen by a distant viewer, and without positions; leave it out.",
        ),
        ("camera", {"height": 0.0}, "camera.height must be positive world units, below 1e+15; got 0.0."),
        ("camera", {"fov_y": 4.0}, "camera.fov_y must lie between 1e-6 and π rad; got 4.0."),
    ],
)
def test_impossible_numbers_are_refused_before_any_file_is_read(
    folder: CaptureFolder, table: str, values: dict, words: str
) -> None:
    (folder.path / "mask.png").unlink()
    folder.tables[table] = values
    message = refusal(lambda: describe(folder.save(), schema.CaptureFile))
    assert message.startswith(f"{folder.file}: {words}")


def test_the_file_of_a_folder_is_found_and_another_kind_of_file_refused(folder: CaptureFolder) -> None:
    assert capture_file(folder.save(), "capture.toml") == folder.file
    np.save(folder.path / "x.npy", np.zeros(3))
    assert "got a .npy file" in refusal(lambda: capture_file(folder.path / "x.npy", "capture.toml"))


def test_the_uncertainty_of_a_calibration_is_what_its_table_states(folder: CaptureFolder) -> None:
    assert describe(folder.save(), schema.CaptureFile).uncertainty == Uncertainty()
    folder.tables["uncertainty"] = {"direction": 0.01, "pose": [0.5, 0.01]}
    stated = Uncertainty(direction=0.01, pose=(0.5, 0.01))
    assert describe(folder.save(), schema.CaptureFile).uncertainty == stated
    assert folder.load().uncertainty == stated


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"intensty": 0.02}, "unknown uncertainty 'intensty'; did you mean 'intensity'?"),
        ({"direction": 1.0}, "direction (rad) must be at most 0.2; got 1. 1° is 0.0175 rad."),
        ({"intensity": "3%"}, "intensity must be one number (relative), as 0.01; got '3%'."),
    ],
)
def test_an_impossible_uncertainty_is_refused_by_file_and_table(
    folder: CaptureFolder, table: dict[str, Any], words: str
) -> None:
    folder.tables["uncertainty"] = table
    assert refusal(lambda: describe(folder.save(), schema.CaptureFile)) == f"{folder.file}: [uncertainty]: {words}"
