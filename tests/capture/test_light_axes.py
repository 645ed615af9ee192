"""Lights in the axes of the camera, beside a mesh that has axes of its own."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from scipy.spatial.transform import Rotation

import matest
from matest.brdf import Lambert
from matest.capture.initial import initialise
from matest.scene import Camera, DirectionalLight, Scene
from matest.scene.mesh import Mesh
from matest.scene.surface import from_mesh
from matest.simulate import simulate
from tests.capture.formats.camera_files import HEIGHT, PINHOLE, WIDTH, Pose, blender, write_json, write_text
from tests.capture.formats.laboratories import GOLDEN
from tests.captures import ALBEDO, CaptureFolder, put_image, refusal

TURNS = Rotation.from_euler("yxz", [1.2, -0.4, 0.3])
POSE = Pose(TURNS, TURNS.apply([0, 0, 4]))
# As a list has them: x right, y up, z toward the viewer.
LISTED = np.array([[0.3, 0.2, 0.9], [-0.5, 0.1, 0.8], [0.1, -0.4, 0.9], [0.2, 0.5, 0.8]])
LISTED /= np.linalg.norm(LISTED, axis=1, keepdims=True)
WORLD = TURNS.apply(LISTED)
MATRIX = [[PINHOLE[0], 0.0, PINHOLE[2]], [0.0, PINHOLE[1], PINHOLE[3]], [0.0, 0.0, 1.0]]
# Float photographs: what is left is the rounding of directions in the list.
EXACT = 1e-4


@pytest.fixture
def laboratory(tmp_path: Path) -> Path:
    """A box, seen from the side: its photographs, its mesh in its own axes, and a list of lights in the camera's."""
    mesh = trimesh.creation.box((1.2, 0.8, 1.0)).subdivide().subdivide()
    mesh.export(tmp_path / "box.ply")
    camera = Camera(**{k: tuple(v) for k, v in POSE.toml().items() if k != "kind"}, matrix=MATRIX)
    surface = from_mesh(Mesh.load(tmp_path / "box.ply"), camera, (HEIGHT, WIDTH))
    lights = [DirectionalLight(torch.tensor(light), torch.full((3,), np.pi)) for light in WORLD]
    scene = Scene(surface, tuple((light,) for light in lights), torch.zeros(len(lights), 3, dtype=torch.float64))
    images = matest.render(scene.with_shadows(), Lambert(albedo=list(ALBEDO)), dtype=torch.float64).numpy()
    rows = [f"r_{k}.npy {x:.6f} {y:.6f} {z:.6f}" for k, (x, y, z) in enumerate(LISTED)]
    (tmp_path / "box.lp").write_text("\n".join([str(len(rows)), *rows]), "ascii")
    for k, image in enumerate(images):
        put_image(tmp_path / f"r_{k}.npy", image.astype(np.float32))
    return tmp_path


def in_transforms(folder: Path) -> None:
    write_json(folder / "transforms.json", blender({f"./train/r_{k}": POSE for k in range(len(LISTED))}))


def in_colmap(folder: Path) -> None:
    write_text(folder / "sparse" / "0", {f"r_{k}.npy": POSE for k in range(len(LISTED))})


def directions(capture: matest.Capture) -> np.ndarray:
    return np.array([light.direction.tolist() for (light,) in capture.scene.lights])


@pytest.mark.parametrize("write", [in_transforms, in_colmap])
def test_a_list_beside_a_mesh_is_turned_by_the_camera_that_lies_there(laboratory: Path, write: Any) -> None:
    write(laboratory)
    capture = matest.load_capture(laboratory)
    np.testing.assert_allclose(directions(capture), WORLD, atol=2e-6)
    assert any("turned into those of the mesh" in note for note in capture.photographs.notes)
    assert capture.understood["axes"].endswith("turned into those of the mesh")
    assert matest.estimate(capture, "lambert").fit.relative_rmse < EXACT


def test_init_writes_what_gives_the_same_result(laboratory: Path) -> None:
    in_transforms(laboratory)
    direct = matest.estimate(matest.load_capture(laboratory), "lambert")
    written = initialise(laboratory)
    again = matest.estimate(matest.load_capture(laboratory), "lambert")
    assert 'light_axes = "camera"' in written.file.read_text("utf-8")
    assert again.parameters == direct.parameters
    # With the directions as they stand in the list the photographs are not explained.
    written.file.write_text(written.file.read_text("utf-8").replace('light_axes = "camera"', ""), "utf-8")
    assert matest.estimate(matest.load_capture(laboratory), "lambert").fit.relative_rmse > 0.1


def test_without_a_camera_the_list_is_refused_until_there_is_one(laboratory: Path) -> None:
    sentence = refusal(lambda: matest.load_capture(laboratory))
    assert "a mesh needs a [camera]" in sentence
    assert "the directions of the list, that are in the camera's axes, are turned into those of the mesh" in sentence
    text = initialise(laboratory).file.read_text("utf-8")
    camera = (
        "[camera]\n" + "".join(f"{key} = {value!r}\n" for key, value in POSE.toml().items()) + f"matrix = {MATRIX}\n"
    )
    (laboratory / "capture.toml").write_text(text[: text.index("\n# The files do not say")] + camera, "utf-8")
    capture = matest.load_capture(laboratory)
    np.testing.assert_allclose(directions(capture), WORLD, atol=2e-6)
    assert re.search(r"perspective camera at .*; lights in those of the camera", capture.understood["axes"])


@pytest.mark.parametrize("name", GOLDEN)
def test_normal_maps_and_spheres_are_in_the_axes_of_the_camera_already(name: str, tmp_path: Path) -> None:
    GOLDEN[name](tmp_path)
    assert matest.load_capture(tmp_path, transfer="linear").description.tables.light_axes == "world"


def test_places_of_lights_are_refused(laboratory: Path) -> None:
    light = {"position": [0.0, 0.0, 2.0]}
    tables = {
        "light_axes": "camera",
        "geometry": {"mesh": "box.ply"},
        "camera": POSE.toml() | {"matrix": MATRIX},
        "image": [{"file": "r_0.npy", "lights": [light]}],
    }
    sentence = refusal(CaptureFolder(laboratory, tables).load)
    assert "image 0 has a light with a position, which is stated in world units and axes" in sentence


def test_a_scene_renders_with_lights_in_the_axes_of_its_camera(laboratory: Path) -> None:
    tables: dict[str, Any] = {
        "light_axes": "camera",
        "material": {"model": "lambert", "albedo": 0.5},
        "geometry": {"mesh": "box.ply"},
        "camera": POSE.toml() | {"matrix": MATRIX, "resolution": [WIDTH, HEIGHT]},
        "image": [{"lights": [{"direction": light.tolist()}]} for light in LISTED[:2]],
    }
    folder = CaptureFolder(laboratory, tables)
    (laboratory / "scene.toml").write_text(folder.save().joinpath("capture.toml").read_text("utf-8"), "utf-8")
    simulate(laboratory / "scene.toml", laboratory / "out")
    capture = matest.load_capture(laboratory / "out")
    np.testing.assert_allclose(directions(capture), WORLD[:2], atol=1e-6)
    assert matest.estimate(capture, "lambert").fit.relative_rmse < EXACT
