"""Captures whose camera stands in another program's file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import matest
from matest.capture import schema
from matest.capture.camera_file import with_camera
from matest.capture.description import describe
from matest.capture.geometry import visible_surface
from matest.simulate import simulate
from tests.capture.formats.camera_files import (
    DISTORTION,
    HEIGHT,
    OTHER_POSE,
    PINHOLE,
    POSE,
    WIDTH,
    Pose,
    blender,
    nerfstudio,
    write_binary,
    write_json,
    write_text,
)
from tests.captures import CaptureFolder, refusal

SHAPE = (HEIGHT, WIDTH)
# The camera stands away from the origin, where the ball is.
TURNS = Rotation.from_euler("yxz", [0.3, -0.2, 0.1])
TOWARD = Pose(TURNS, TURNS.apply([0, 0, 4]))
APPLIED = np.array([[0.0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]])
MATRIX = [[PINHOLE[0], 0.0, PINHOLE[2]], [0.0, PINHOLE[1], PINHOLE[3]], [0.0, 0.0, 1.0]]


@pytest.fixture
def ball(tmp_path: Path) -> CaptureFolder:
    """Two images of a ball as a mesh; the camera is not yet said."""
    trimesh.creation.icosphere(3).export(tmp_path / "ball.ply")
    lights = [[0.3, 0.2, 0.9], [-0.5, 0.1, 0.8]]
    images = [{"file": f"r_{k}.npy", "lights": [{"direction": light}]} for k, light in enumerate(lights)]
    folder = CaptureFolder(tmp_path, {"geometry": {"mesh": "ball.ply"}, "camera": {}, "image": images})
    for table in images:
        folder.put(table["file"], np.full((*SHAPE, 3), 0.5, np.float32))
    return folder


def frames(pose: Pose = TOWARD) -> dict[str, Pose]:
    return {"images/r_0.npy": pose, "images/r_1.npy": pose, "images/other.npy": OTHER_POSE}


def in_blender(folder: Path) -> dict[str, Any]:
    write_json(folder / "transforms.json", blender({f"./train/r_{k}": TOWARD for k in range(2)}))
    return {"file": "transforms.json"}


def in_nerfstudio(folder: Path) -> dict[str, Any]:
    write_json(folder / "transforms.json", nerfstudio(frames(), APPLIED))
    return {"file": "transforms.json"}


def as_text(folder: Path) -> dict[str, Any]:
    write_text(folder / "sparse" / "0", frames())
    return {"file": "sparse/0"}


def in_binary(folder: Path) -> dict[str, Any]:
    write_binary(folder / "sparse" / "0", frames())
    return {"file": "sparse/0"}


WRITERS = {f.__name__.replace("_", " "): f for f in (in_blender, in_nerfstudio, as_text, in_binary)}


def rays(folder: CaptureFolder) -> np.ndarray:
    """Positions on the mesh and sightlines of a capture, [N, 6]: what its rays hit."""
    description = describe(folder.save(), schema.CaptureFile)
    surface = visible_surface(with_camera(description, SHAPE)[0], SHAPE)
    assert surface.positions is not None
    return np.concatenate([surface.positions.numpy(), surface.image(surface.normals.numpy())[surface.mask]], axis=1)


@pytest.mark.parametrize("writer", WRITERS)
def test_one_camera_sees_the_same_in_every_format(ball: CaptureFolder, writer: str) -> None:
    ball.tables["camera"] = TOWARD.toml() | {"matrix": MATRIX}
    expected = rays(ball)
    assert len(expected) > 300
    ball.tables["camera"] = WRITERS[writer](ball.path)
    np.testing.assert_allclose(rays(ball), expected, atol=1e-9)


def test_distortion_is_that_of_every_format(ball: CaptureFolder) -> None:
    ball.tables["camera"] = TOWARD.toml() | {"matrix": MATRIX, "distortion": list(DISTORTION)}
    expected = rays(ball)
    keys = dict(zip(("k1", "k2", "p1", "p2"), DISTORTION, strict=True))
    write_json(ball.path / "transforms.json", nerfstudio(frames(), **keys))
    write_text(ball.path / "text", frames(), "OPENCV", (*PINHOLE, *DISTORTION))
    write_binary(ball.path / "binary", frames(), "OPENCV", (*PINHOLE, *DISTORTION))
    for file in ("transforms.json", "text", "binary"):
        ball.tables["camera"] = {"file": file}
        np.testing.assert_allclose(rays(ball), expected, atol=1e-9)


def test_other_keys_of_the_camera_stay(ball: CaptureFolder) -> None:
    ball.tables["camera"] = in_blender(ball.path) | {"wavelength": [0.6, 0.55, 0.45], "resolution": [WIDTH, HEIGHT]}
    camera = with_camera(describe(ball.save(), schema.CaptureFile), SHAPE)[0].tables.camera
    assert camera is not None
    assert camera.wavelength == [0.6, 0.55, 0.45]
    assert camera.resolution == (WIDTH, HEIGHT)
    assert camera.kind == "perspective"


@pytest.mark.parametrize(
    "frame", ["images/other.npy", "other.npy", "other", "./images/other.npy", "images\\\\other.npy"]
)
def test_a_frame_is_found_by_path_name_or_stem(ball: CaptureFolder, frame: str) -> None:
    ball.tables["camera"] = as_text(ball.path) | {"frame": frame}
    camera = with_camera(describe(ball.save(), schema.CaptureFile), SHAPE)[0].tables.camera
    assert camera is not None
    np.testing.assert_allclose(camera.position, OTHER_POSE.position, atol=1e-9)


def test_the_only_frame_needs_no_name(ball: CaptureFolder) -> None:
    write_json(ball.path / "transforms.json", blender({"./view": POSE}))
    ball.tables["camera"] = {"file": "transforms.json"}
    camera = with_camera(describe(ball.save(), schema.CaptureFile), SHAPE)[0].tables.camera
    assert camera is not None
    np.testing.assert_allclose(camera.position, POSE.position, atol=1e-9)


def test_a_capture_says_what_was_done_and_holds_the_digests(ball: CaptureFolder) -> None:
    content = nerfstudio(frames(), w=2 * WIDTH, h=2 * HEIGHT, cx=2 * PINHOLE[2], cy=2 * PINHOLE[3])
    content |= {"fl_x": 2 * PINHOLE[0], "fl_y": 2 * PINHOLE[1]}
    for frame in content["frames"]:
        frame["transform_matrix"] = (np.array(frame["transform_matrix"]) @ np.diag([3.0, 3, 3, 1])).tolist()
    write_json(ball.path / "transforms.json", content)
    ball.tables["camera"] = {"file": "transforms.json"}
    capture = ball.load()
    said = capture.photographs.notes
    assert [note.startswith("transforms.json: ") for note in said] == [True, True]
    assert "scales by 3" in said[0]
    assert "120×80" in said[1]
    assert "transforms.json" in capture.digests()
    ball.tables["camera"] = TOWARD.toml() | {"matrix": MATRIX}
    positions = ball.load().scene.surface.positions
    np.testing.assert_allclose(capture.scene.surface.positions, positions, atol=1e-6)


def test_a_rendered_capture_takes_the_camera_with_it(ball: CaptureFolder, tmp_path: Path) -> None:
    as_text(ball.path)
    tables = ball.tables | {
        "camera": {"file": "sparse/0", "frame": "r_1.npy", "resolution": [WIDTH, HEIGHT]},
        "material": {"model": "lambert", "albedo": 0.5},
    }
    for image in tables["image"]:
        image["file"] = image["file"].replace("npy", "exr")
    CaptureFolder(tmp_path, tables).save().joinpath("capture.toml").rename(tmp_path / "scene.toml")
    capture = matest.load_capture(simulate(tmp_path, tmp_path / "out"))
    assert "position" not in (tmp_path / "out" / "capture.toml").read_text("utf-8")
    assert {"sparse/0/cameras.txt", "sparse/0/images.txt"} <= set(capture.digests())
    assert capture.radiance(0).max() > 0.1


def other_view(folder: Path) -> dict[str, Any]:
    write_json(folder / "transforms.json", blender({"./r_0": TOWARD, "./r_1": OTHER_POSE}))
    return {"file": "transforms.json"}


def unlike_names(folder: Path) -> dict[str, Any]:
    write_json(folder / "transforms.json", blender({"./a": TOWARD, "./b": TOWARD}))
    return {"file": "transforms.json"}


def two_folders(folder: Path) -> dict[str, Any]:
    write_json(folder / "transforms.json", blender({"./left/a": TOWARD, "./right/a": OTHER_POSE}))
    return {"file": "transforms.json", "frame": "a"}


def other_shape(folder: Path) -> dict[str, Any]:
    write_json(folder / "transforms.json", nerfstudio(frames(), w=HEIGHT, h=WIDTH))
    return {"file": "transforms.json"}


def text_file(folder: Path) -> dict[str, Any]:
    write_text(folder / "sparse", frames())
    return {"file": "sparse/images.txt"}


def empty_folder(folder: Path) -> dict[str, Any]:
    (folder / "sparse").mkdir()
    return {"file": "sparse"}


BAD: dict[str, tuple[Callable[[Path], dict[str, Any]], str]] = {
    "two views": (other_view, "a capture has one camera"),
    "names of other images": (unlike_names, "frame = './a'"),
    "a frame of two folders": (two_folders, "'./left/a' and './right/a'"),
    "a frame that is not there": (lambda folder: as_text(folder) | {"frame": "r_7.npy"}, "is not in"),
    "images of another shape": (other_shape, "40×60"),
    "a pose, too": (lambda folder: as_text(folder) | {"fov_y": 0.5, "up": [0, 0, 1]}, "remove up, fov_y"),
    "a frame without file": (lambda _: {"frame": "r_0"}, "give the file, too"),
    "no such file": (lambda _: {"file": "cameras.json"}, "cameras.json: no such file"),
    "a file of a model": (text_file, "the folder of a sparse model"),
    "an empty folder": (empty_folder, "cameras.txt: no such file"),
    "a folder outside": (lambda _: {"file": "../sparse"}, "leads outside"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_names_no_camera_is_refused(ball: CaptureFolder, case: str) -> None:
    writer, words = BAD[case]
    ball.tables["camera"] = writer(ball.path)
    assert words in refusal(ball.load)


@pytest.mark.filterwarnings("error")
def test_a_camera_beyond_all_numbers_is_refused(ball: CaptureFolder) -> None:
    far = Pose(TURNS, np.full(3, 1e200))
    write_json(ball.path / "transforms.json", blender({f"./train/r_{k}": far for k in range(2)}))
    ball.tables["camera"] = {"file": "transforms.json"}
    message = refusal(lambda: matest.load_capture(ball.save()))
    assert "transforms.json" in message or "capture.toml" in message
    assert "position" in message or "target" in message


def test_a_folder_of_cameras_without_lights_is_told_what_is_missing(tmp_path: Path) -> None:
    in_blender(tmp_path)
    message = refusal(lambda: matest.load_capture(tmp_path))
    assert message.startswith(f"{tmp_path}: ")
    assert "how the photographs are lit" in message
