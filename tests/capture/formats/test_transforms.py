from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from matest.capture.formats.transforms import read_transforms
from tests.capture.formats.camera_files import (
    DISTORTION,
    HEIGHT,
    OTHER_POSE,
    PINHOLE,
    POSE,
    WIDTH,
    blender,
    nerfstudio,
    shared_rays,
    write_json,
)
from tests.captures import refusal

SIZE = (WIDTH, HEIGHT)
FRAMES = {"./train/r_0": POSE, "./train/r_1": OTHER_POSE}


def applied(scale: float = 1.0) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = scale * Rotation.from_euler("xyz", [0.7, -1.1, 0.2]).as_matrix()
    matrix[:3, 3] = (3.0, -1.0, 0.5)
    return matrix


@pytest.mark.parametrize("place", [0, 1])
@pytest.mark.parametrize(
    "content",
    [
        blender(FRAMES),
        nerfstudio(FRAMES),
        nerfstudio(FRAMES, applied()),
        nerfstudio(FRAMES, applied(2.0)),
        blender(FRAMES, w=WIDTH, h=HEIGHT),
    ],
    ids=["Blender", "nerfstudio", "applied", "applied with scale", "instant-ngp"],
)
def test_every_dialect_gives_the_pose_and_the_lens(tmp_path: Path, content: dict[str, Any], place: int) -> None:
    transforms = read_transforms(write_json(tmp_path / "transforms.json", content))
    assert transforms.names == list(FRAMES)
    view, pose = transforms.view(place, SIZE), list(FRAMES.values())[place]
    np.testing.assert_allclose(view.axes, pose.turns.as_matrix().T, atol=1e-12)
    np.testing.assert_allclose(view.position, pose.position, atol=1e-12)
    assert view.lens.size == SIZE
    np.testing.assert_allclose((*view.lens.focal, *view.lens.centre), PINHOLE, rtol=1e-12)
    assert view.lens.distortion == ()


def test_an_applied_scale_is_undone(tmp_path: Path) -> None:
    content = nerfstudio({"a": POSE}, applied_scale=4.0)
    for row in content["frames"][0]["transform_matrix"][:3]:
        row[3] *= 4
    view = read_transforms(write_json(tmp_path / "t.json", content)).view(0, SIZE)
    np.testing.assert_allclose(view.position, POSE.position, atol=1e-12)


def test_distortion_comes_in_the_order_of_opencv(tmp_path: Path) -> None:
    keys = dict(zip(("k1", "k2", "p1", "p2"), DISTORTION, strict=True))
    view = read_transforms(write_json(tmp_path / "t.json", nerfstudio(FRAMES, **keys, k3=0.01))).view(0, SIZE)
    assert view.lens.distortion == (*DISTORTION, 0.01)


def test_a_frame_may_have_a_lens_of_its_own(tmp_path: Path) -> None:
    content = nerfstudio(FRAMES)
    content["frames"][1] |= {"fl_x": 90.0, "fl_y": 91.0, "cx": 0.0}
    transforms = read_transforms(write_json(tmp_path / "t.json", content))
    assert transforms.view(0, SIZE).lens.focal == PINHOLE[:2]
    assert transforms.view(1, SIZE).lens.focal == (90.0, 91.0)
    assert transforms.view(1, SIZE).lens.centre == (0.0, PINHOLE[3])


def test_a_scale_in_the_matrix_is_split_off_and_said(tmp_path: Path) -> None:
    content = blender({"a": POSE})
    rows = content["frames"][0]["transform_matrix"]
    content["frames"][0]["transform_matrix"] = [[*(0.5 * x for x in row[:3]), row[3]] for row in rows[:3]] + rows[3:]
    view = read_transforms(write_json(tmp_path / "t.json", content)).view(0, SIZE)
    np.testing.assert_allclose(view.axes, POSE.turns.as_matrix().T, atol=1e-12)
    np.testing.assert_allclose(view.position, POSE.position, atol=1e-12)
    assert ["scales by 0.5" in note for note in view.notes] == [True]


def test_the_camera_of_the_shared_file_has_its_rays() -> None:
    folder, centre, directions = shared_rays()
    view = read_transforms(folder / "nerfstudio_transforms.json").view(0, (64, 48))
    np.testing.assert_allclose(view.position, centre, atol=1e-9)
    for (x, y), direction in directions.items():
        own = (x - view.lens.centre[0]) / view.lens.focal[0], (view.lens.centre[1] - y) / view.lens.focal[1], -1.0
        np.testing.assert_allclose(own @ view.axes / np.linalg.norm(own), direction, atol=1e-9)
    pose = read_transforms(folder / "blender_transforms.json").view(0, (64, 48))
    np.testing.assert_allclose(pose.axes, view.axes, atol=1e-9)
    np.testing.assert_allclose(pose.position, centre, atol=1e-9)


MALFORMED = {
    "no JSON": ("{", "expected a transforms.json"),
    "no frames": ({"camera_angle_x": 0.5}, "frames"),
    "an empty list": ({"camera_angle_x": 0.5, "frames": []}, "at least one frame"),
    "no path": ({"frames": [{"transform_matrix": np.eye(4).tolist()}]}, "file_path"),
    "a word": (blender(FRAMES, camera_angle_x="wide"), "camera_angle_x"),
    "an angle of 60": (blender(FRAMES, camera_angle_x=60.0), "between 0 and π"),
    "no lens": ({"frames": blender(FRAMES)["frames"]}, "fl_x or camera_angle_x"),
    "three columns": (
        {"frames": [{"file_path": "a", "transform_matrix": np.eye(3).tolist()}]},
        "3 rows of 4",
    ),
    "a last row": (
        {"frames": [{"file_path": "a", "transform_matrix": np.ones((4, 4)).tolist()}]},
        "0 0 0 1",
    ),
    "a fisheye": (nerfstudio(FRAMES, camera_model="OPENCV_FISHEYE"), "OPENCV_FISHEYE"),
    "k4": (nerfstudio(FRAMES, k4=0.1), "k4"),
    "a singular world": (nerfstudio(FRAMES, applied_transform=np.zeros((3, 4)).tolist()), "cannot be undone"),
    "a mirrored world": (nerfstudio(FRAMES, applied_transform=np.diag([1.0, 1, -1, 1]).tolist()), "mirrors"),
    "a scale of 0": (nerfstudio(FRAMES, applied_scale=0), "applied_scale"),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_malformed_files_are_refused_in_a_sentence(tmp_path: Path, case: str) -> None:
    content, words = MALFORMED[case]
    path = tmp_path / "transforms.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content), "utf-8")
    message = refusal(lambda: read_transforms(path).view(0, SIZE))
    assert message.startswith(f"{path}: ")
    assert words in message


@pytest.mark.parametrize("content", [b'{"frames": "\xf0("}', b'{"\xff": 1}'])
def test_text_that_is_no_utf_8_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "transforms.json").write_bytes(content)
    assert "expected a transforms.json" in refusal(lambda: read_transforms(tmp_path / "transforms.json"))
