"""What is said of how a capture was read."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from matest.capture.understanding import understood
from tests.captures import encode_as_png, sphere_normals


def test_a_sphere_under_stated_lights(folder) -> None:
    capture = folder.load()
    said = understood(capture.description, capture.photographs)
    assert said == capture.understood
    assert said["read from"] == "capture.toml"
    assert said["shape"].startswith("sphere whose circle the file states; ")
    assert said["axes"] == "x right, y up, z toward the viewer"
    assert said["transfer"] == "linear, floats as stored"
    assert said["units"] == "radii of the sphere, from its centre"
    assert said["lights"] == "2 distant lights in 2 images; strengths stated"
    assert said["scale"] == "absolute: full scale is radiance 1"


@pytest.mark.parametrize(("transfer", "name"), [("srgb", "sRGB"), (2.2, "gamma 2.2"), ("linear", "linear")])
def test_the_transfer_is_that_which_is_used(folder, transfer: str | float, name: str) -> None:
    encode_as_png(folder, np.uint16)
    assert folder.load(transfer=transfer).understood["transfer"] == f"{name}, integers of 16 bits"


def test_lights_of_unknown_strength_make_the_scale_relative(folder) -> None:
    for image in folder.tables["image"]:
        for light in image["lights"]:
            del light["irradiance"]
    said = folder.load().understood
    assert said["lights"].endswith("all equally strong")
    assert said["scale"].startswith("relative")


def test_normals_have_no_unit_unless_their_width_is_stated(folder) -> None:
    np.save(folder.path / "normals.npy", sphere_normals().astype(np.float32))
    folder.tables["geometry"] = {"normals": "normals.npy"}
    assert folder.load().understood["units"] == "none: directions only"
    folder.tables["geometry"]["width"] = 12.5
    assert folder.load().understood["units"].startswith("the image is 12.5 wide")


def test_a_mesh_has_its_own_axes_and_a_camera(folder) -> None:
    trimesh.creation.icosphere(3).export(folder.path / "ball.ply")
    folder.tables["geometry"] = {"mesh": "ball.ply"}
    folder.tables["camera"] = {"kind": "perspective", "position": [0, 0, 6.0], "fov_y": 0.4}
    del folder.tables["mask"]
    folder.tables["image"][0]["lights"].append({"position": [1.0, 2.0, 3.0], "intensity": 4.0})
    said = folder.load().understood
    assert said["axes"] == "those of the mesh; perspective camera at [0.0, 0.0, 6.0], up [0.0, 1.0, 0.0]"
    assert said["units"] == "those of the mesh"
    assert said["lights"] == "2 distant and 1 near lights in 2 images; strengths stated (1 to 4)"
