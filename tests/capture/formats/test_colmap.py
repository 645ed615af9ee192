from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from matest.capture.formats.colmap import model_files, read_colmap
from tests.capture.formats.camera_files import (
    DISTORTION,
    HEIGHT,
    OTHER_POSE,
    PINHOLE,
    POSE,
    WIDTH,
    Pose,
    shared_rays,
    write_binary,
    write_text,
)
from tests.captures import refusal

SIZE = (WIDTH, HEIGHT)
FRAMES = {"left/view (402).jpg": POSE, "right/view two.jpg": OTHER_POSE}
WRITERS: dict[str, Callable[..., Path]] = {"text": write_text, "binary": write_binary}
# Parameters of every model that is read, and the lens that they mean: fx, fy, cx, cy and OpenCV's distortion.
LENSES: dict[str, tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]] = {
    "SIMPLE_PINHOLE": ((70, 31, 19), (70, 70, 31, 19), ()),
    "PINHOLE": (PINHOLE, PINHOLE, ()),
    "SIMPLE_RADIAL": ((70, 31, 19, -0.1), (70, 70, 31, 19), (-0.1, 0, 0, 0)),
    "RADIAL": ((70, 31, 19, -0.1, 0.02), (70, 70, 31, 19), (-0.1, 0.02, 0, 0)),
    "OPENCV": ((*PINHOLE, *DISTORTION), PINHOLE, DISTORTION),
}


@pytest.mark.parametrize("writer", WRITERS)
@pytest.mark.parametrize("model", LENSES)
def test_pose_and_lens_of_every_image_are_read(tmp_path: Path, model: str, writer: str) -> None:
    values, pinhole, distortion = LENSES[model]
    read = read_colmap(WRITERS[writer](tmp_path, FRAMES, model, values))
    assert read.names == list(FRAMES)
    for place, pose in enumerate(FRAMES.values()):
        view = read.view(place, SIZE)
        np.testing.assert_allclose(view.axes, pose.turns.as_matrix().T, atol=1e-12)
        np.testing.assert_allclose(view.position, pose.position, atol=1e-12)
        assert (view.lens.size, *view.lens.focal, *view.lens.centre) == (SIZE, *pinhole)
        assert view.lens.distortion == distortion


def test_a_full_opencv_camera_has_eight_terms(tmp_path: Path) -> None:
    terms = (*DISTORTION, 0.01, 0.02, 0.03, 0.04)
    view = read_colmap(write_text(tmp_path, FRAMES, "FULL_OPENCV", (*PINHOLE, *terms))).view(0, SIZE)
    assert view.lens.distortion == terms


def test_the_camera_of_the_shared_file_has_its_rays() -> None:
    folder, centre, directions = shared_rays()
    read = read_colmap(folder / "colmap_text")
    assert read.names == ["view (402).jpg"]
    view = read.view(0, (64, 48))
    np.testing.assert_allclose(view.position, centre, atol=1e-9)
    for (x, y), direction in directions.items():
        own = (x - view.lens.centre[0]) / view.lens.focal[0], (view.lens.centre[1] - y) / view.lens.focal[1], -1.0
        np.testing.assert_allclose(own @ view.axes / np.linalg.norm(own), direction, atol=1e-9)


@pytest.mark.parametrize("length", [0.9993, 1.0, 2.0])
def test_a_quaternion_of_any_length_is_a_rotation(tmp_path: Path, length: float) -> None:
    write_text(tmp_path, {"a.jpg": POSE})
    quaternion, translation = POSE.to_camera
    # Exponents of three digits, as C's runtime of Windows writes them.
    words = [f"{value:.16e}"[:-2] + "0" + f"{value:.16e}"[-2:] for value in (*(length * quaternion), *translation)]
    (tmp_path / "images.txt").write_text(f"1 {' '.join(words)} 7 a.jpg\r\n\r\n", "utf-8")
    view = read_colmap(tmp_path).view(0, SIZE)
    np.testing.assert_allclose(view.axes, POSE.turns.as_matrix().T, atol=1e-12)


def test_the_last_line_of_points_may_be_missing(tmp_path: Path) -> None:
    write_text(tmp_path, FRAMES)
    path = tmp_path / "images.txt"
    path.write_text(path.read_text("utf-8").rstrip("\n"), "utf-8")
    assert read_colmap(tmp_path).names == list(FRAMES)


def test_binary_comes_before_text_where_it_is_whole(tmp_path: Path) -> None:
    write_text(tmp_path, {"text.jpg": POSE})
    write_binary(tmp_path, {"binary.jpg": POSE})
    assert model_files(tmp_path) == ("cameras.bin", "images.bin")
    assert read_colmap(tmp_path).names == ["binary.jpg"]
    (tmp_path / "cameras.bin").unlink()
    assert read_colmap(tmp_path).names == ["text.jpg"]


@pytest.mark.parametrize("writer", WRITERS)
def test_other_models_are_refused_with_the_way_out(tmp_path: Path, writer: str) -> None:
    folder = WRITERS[writer](tmp_path, FRAMES, "OPENCV_FISHEYE", (*PINHOLE, 0, 0, 0, 0))
    message = refusal(lambda: read_colmap(folder).view(0, SIZE))
    assert str(folder) in message
    assert "OPENCV_FISHEYE" in message
    assert "image_undistorter" in message


@pytest.mark.parametrize("file", ["cameras.bin", "images.bin"])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.8, 0.99])
def test_a_truncated_binary_file_is_refused(tmp_path: Path, file: str, share: float) -> None:
    write_binary(tmp_path, FRAMES)
    data = (tmp_path / file).read_bytes()
    (tmp_path / file).write_bytes(data[: int(share * len(data))])
    message = refusal(lambda: read_colmap(tmp_path))
    assert message.startswith(f"{tmp_path / file}: ")
    assert "ends too soon" in message


def test_an_unknown_number_of_a_model_is_refused(tmp_path: Path) -> None:
    write_binary(tmp_path, FRAMES)
    (tmp_path / "cameras.bin").write_bytes(struct.pack("<QIiQQ4d", 1, 7, 99, WIDTH, HEIGHT, *PINHOLE))
    assert "model number 99" in refusal(lambda: read_colmap(tmp_path))


def lines_of(pose: Pose, name: str = "a.jpg", camera: int = 7) -> str:
    quaternion, translation = pose.to_camera
    return " ".join(map(repr, (1, *quaternion.tolist(), *translation.tolist(), camera))) + f" {name}\n"


MALFORMED = {
    "no image": ("images.txt", "# nothing\n", "at least one image"),
    "a word for a number": ("images.txt", "1 one 0 0 0 0 0 0 7 a.jpg\n\n", "line 1"),
    "too few words": ("images.txt", "1 1 0 0 0 0 0 7\n\n", "line 1"),
    "no line of points": ("images.txt", lines_of(POSE) + lines_of(OTHER_POSE, "b.jpg"), "line 2"),
    "another camera": ("images.txt", lines_of(POSE, camera=8) + "\n", "camera 8"),
    "a quaternion of zeros": ("images.txt", "1 0 0 0 0 0 0 0 7 a.jpg\n\n", "no rotation"),
    "a translation without end": ("images.txt", "1 1 0 0 0 inf 0 0 7 a.jpg\n\n", "finite"),
    "a camera of one word": ("cameras.txt", "7\n", "line 1"),
    "a missing parameter": ("cameras.txt", "7 PINHOLE 60 40 70 70 30\n", "4 parameters; got 3"),
    "a focal length of 0": ("cameras.txt", "7 PINHOLE 60 40 0 70 30 20\n", "focal lengths"),
    "a model that is not known": ("cameras.txt", "7 LENS 60 40 70\n", "got LENS"),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_malformed_text_is_refused_in_a_sentence(tmp_path: Path, case: str) -> None:
    file, content, words = MALFORMED[case]
    write_text(tmp_path, FRAMES)
    (tmp_path / file).write_text(content, "utf-8")
    message = refusal(lambda: read_colmap(tmp_path).view(0, SIZE))
    assert message.startswith(str(tmp_path))
    assert words in message


def test_what_is_no_text_is_refused(tmp_path: Path) -> None:
    write_text(tmp_path, FRAMES)
    (tmp_path / "images.txt").write_bytes(b"\xff\xfe\x00")
    assert "expected a text file" in refusal(lambda: read_colmap(tmp_path))


def test_more_points_than_there_can_be_are_refused(tmp_path: Path) -> None:
    folder = write_binary(tmp_path, FRAMES)
    data = (folder / "images.bin").read_bytes()
    name = data.index(b"\0", data.index(b"left")) + 1
    (folder / "images.bin").write_bytes(data[:name] + b"\xff" * 8 + data[name + 8 :])
    assert "ends too soon" in refusal(lambda: read_colmap(folder))
