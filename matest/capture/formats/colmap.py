"""COLMAP's sparse models, text and binary: cameras.txt and images.txt, or cameras.bin and images.bin."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from matest.capture.formats.view import View, lens
from matest.errors import InputError

# Camera models by their number in binary files, with how many parameters each has.
_MODELS = (
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
)
# Models whose parameters begin with one focal length, and with two; others have no distortion of OpenCV's.
_ONE_FOCAL = ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
_TWO_FOCALS = ("PINHOLE", "OPENCV", "FULL_OPENCV")
_PARAMETERS = dict(_MODELS)
# Pose of an image in binary files: number, quaternion, translation, camera.
_POSE = struct.Struct("<I4d3dI")
# Camera in binary files before its parameters: number, model, width, height.
_CAMERA = struct.Struct("<IiQQ")
_COUNT = struct.Struct("<Q")
# Bytes of a point of an image in binary files: x, y, number.
_POINT_BYTES = 24


@dataclass(frozen=True)
class _Camera:
    model: str
    size: tuple[int, int]
    parameters: tuple[float, ...]


@dataclass(frozen=True)
class _Image:
    """An image: quaternion (w first) and translation from the world to its camera."""

    name: str
    quaternion: tuple[float, ...]
    translation: tuple[float, ...]
    camera: int


@dataclass(frozen=True)
class Colmap:
    """The cameras of a sparse model."""

    path: Path
    cameras: dict[int, _Camera]
    images: tuple[_Image, ...]

    @property
    def names(self) -> list[str]:
        return [image.name for image in self.images]

    def view(self, place: int, size: tuple[int, int]) -> View:  # noqa: ARG002
        image = self.images[place]
        label = f"{self.path}: image '{image.name}'"
        if image.camera not in self.cameras:
            raise InputError(
                f"{label}: its camera {image.camera} is not among the cameras of the model; export it anew."
            )
        camera = self.cameras[image.camera]
        model, values = camera.model, camera.parameters
        if model not in (*_ONE_FOCAL, *_TWO_FOCALS):
            raise InputError(
                f"{label}: expected a camera of the models {', '.join((*_ONE_FOCAL, *_TWO_FOCALS))}; got {model}. "
                "Undistort the images with 'colmap image_undistorter' and give the model that it writes."
            )
        if len(values) != _PARAMETERS[model]:
            raise InputError(
                f"{label}: a camera of the model {model} has {_PARAMETERS[model]} parameters; got {len(values)}. "
                "Export the model anew."
            )
        if model in _ONE_FOCAL:
            # Radial terms only: OpenCV's k1 and k2, before p1 and p2.
            pinhole, distortion = (values[0], *values[:3]), (*values[3:], 0.0, 0.0, 0.0, 0.0)[:4]
        else:
            pinhole, distortion = values[:4], values[4:]
        to_camera = _rotation(image.quaternion, label)
        # COLMAP's cameras look along z with y downward.
        axes = to_camera * np.array([[1], [-1], [-1]])
        if not np.isfinite(image.translation).all():
            raise InputError(f"{label}: its translation must be finite; export the model anew.")
        position = -to_camera.T @ np.array(image.translation)
        return View(axes, position, lens(label, camera.size, pinhole, distortion))


def model_files(folder: Path) -> tuple[str, str]:
    """Names of the two files of a model: binary where it is whole, as COLMAP prefers, or else text."""
    binary = ("cameras.bin", "images.bin")
    return binary if all((folder / name).is_file() for name in binary) else ("cameras.txt", "images.txt")


def read_colmap(folder: Path) -> Colmap:
    """Read the cameras of a sparse model.

    Raises:
        InputError: a file is damaged, or there is no image.
    """
    cameras_path, images_path = (folder / name for name in model_files(folder))
    if cameras_path.suffix == ".bin":
        cameras, images = _binary_cameras(cameras_path), _binary_images(images_path)
    else:
        cameras, images = dict(_text_cameras(cameras_path)), tuple(_text_images(images_path))
    if not images:
        raise InputError(f"{images_path}: expected at least one image; got none.")
    return Colmap(folder, cameras, images)


def _rotation(quaternion: tuple[float, ...], label: str) -> np.ndarray:
    """Rotation [3, 3] of a quaternion (w first) of any length.

    Raises:
        InputError: the length is 0 or not finite.
    """
    length = float(np.linalg.norm(quaternion))
    if not 0 < length < np.inf:
        raise InputError(f"{label}: its quaternion is {list(quaternion)}, which is no rotation; export the model anew.")
    w, x, y, z = (value / length for value in quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _lines(path: Path) -> list[str]:
    try:
        # splitlines also breaks at characters that a name may have.
        return path.read_text("utf-8-sig").split("\n")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: expected a text file of COLMAP; {error}. Export the model as text anew.") from None


def _malformed(path: Path, number: int, expected: str) -> InputError:
    return InputError(f"{path}: line {number}: expected {expected}; export the model as text anew.")


def _text_cameras(path: Path) -> Iterator[tuple[int, _Camera]]:
    for number, line in enumerate(_lines(path), start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        try:
            name, model, width, height = int(words[0]), words[1], int(words[2]), int(words[3])
            yield name, _Camera(model, (width, height), tuple(map(float, words[4:])))
        except (ValueError, IndexError):
            raise _malformed(path, number, "the camera's number, model, width, height and parameters") from None


def _text_images(path: Path) -> Iterator[_Image]:
    """Images have two lines each: the pose, and points of the image, of which there may be none."""
    lines = iter(enumerate(_lines(path), start=1))
    for number, line in lines:
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        # The name is the rest of the line: it may have blanks.
        words = line.strip().split(maxsplit=9)
        try:
            pose, camera, name = tuple(map(float, words[1:8])), int(words[8]), words[9]
        except (ValueError, IndexError):
            raise _malformed(path, number, "the image's number, qw qx qy qz, tx ty tz, camera and name") from None
        yield _Image(name, pose[:4], pose[4:], camera)
        number, points = next(lines, (number, ""))
        if not _is_points(points):
            raise _malformed(path, number, f"the points of image '{name}', x y number each, or an empty line")


def _is_points(line: str) -> bool:
    """Whether a line has triples of numbers; beyond a few it is taken for granted."""
    words = line.split()
    try:
        return len(words) % 3 == 0 and all(map(math.isfinite, map(float, words[:12])))
    except ValueError:
        return False


@contextmanager
def _whole(path: Path) -> Iterator[bytes]:
    """The content of a binary file; refused where the block reads beyond its end."""
    try:
        yield path.read_bytes()
    except (struct.error, OSError, ValueError, OverflowError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            f"{path}: expected a whole binary file of COLMAP; it ends too soon or is damaged. Copy or export it again."
        ) from None


def _binary_cameras(path: Path) -> dict[int, _Camera]:
    cameras = {}
    with _whole(path) as data:
        (count,), place = _COUNT.unpack_from(data), _COUNT.size
        for _ in range(count):
            name, model, width, height = _CAMERA.unpack_from(data, place)
            if not 0 <= model < len(_MODELS):
                raise InputError(
                    f"{path}: camera {name} is of model number {model}, which is not known; export the model as text."
                )
            model_name, parameters = _MODELS[model]
            values = struct.unpack_from(f"<{parameters}d", data, place + _CAMERA.size)
            cameras[name] = _Camera(model_name, (width, height), values)
            place += _CAMERA.size + 8 * parameters
    return cameras


def _binary_images(path: Path) -> tuple[_Image, ...]:
    images = []
    with _whole(path) as data:
        (count,), place = _COUNT.unpack_from(data), _COUNT.size
        for _ in range(count):
            _, *pose, camera = _POSE.unpack_from(data, place)
            # ValueError where the zero behind the name is missing.
            end = data.index(b"\0", place + _POSE.size)
            images.append(_Image(data[place + _POSE.size : end].decode(), tuple(pose[:4]), tuple(pose[4:]), camera))
            (points,) = _COUNT.unpack_from(data, end + 1)
            place = end + 1 + _COUNT.size + _POINT_BYTES * points
        if place > len(data):
            raise struct.error
    return tuple(images)
