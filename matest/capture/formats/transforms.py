"""transforms.json: cameras of Blender scenes and NeRF's programs, with the keys of nerfstudio and instant-ngp."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from matest.capture.formats.view import Lens, View, lens, rotation
from matest.errors import InputError

# Values of camera_model that are pinholes, with or without OpenCV's distortion.
_PINHOLES = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "PERSPECTIVE")
# Keys of lenses that bend light in other ways, and of which a value of 0 says nothing.
_OTHER_LENSES = ("k4", "is_fisheye")


class _LensKeys(msgspec.Struct):
    """Keys that the file has for all frames, and a frame for itself."""

    camera_model: str | None = None
    camera_angle_x: float | None = None
    camera_angle_y: float | None = None
    w: float | None = None
    h: float | None = None
    fl_x: float | None = None
    fl_y: float | None = None
    cx: float | None = None
    cy: float | None = None
    k1: float | None = None
    k2: float | None = None
    k3: float | None = None
    k4: float | None = None
    p1: float | None = None
    p2: float | None = None
    is_fisheye: bool | None = None


class _Frame(_LensKeys, kw_only=True):
    file_path: str
    transform_matrix: list[list[float]]


class _File(_LensKeys, kw_only=True):
    frames: list[_Frame]
    applied_transform: list[list[float]] | None = None
    applied_scale: float = 1.0


@dataclass(frozen=True)
class Transforms:
    """The cameras of a transforms.json."""

    path: Path
    content: _File

    @property
    def names(self) -> list[str]:
        return [frame.file_path for frame in self.content.frames]

    def view(self, place: int, size: tuple[int, int]) -> View:
        """The camera of a frame in the world before `applied_transform` and `applied_scale`."""
        frame = self.content.frames[place]
        label = f"{self.path}: frame '{frame.file_path}'"
        to_world = _matrix(frame.transform_matrix, f"{label}: transform_matrix")
        if not (math.isfinite(self.content.applied_scale) and self.content.applied_scale > 0):
            raise InputError(f"{self.path}: applied_scale must be positive; got {self.content.applied_scale}.")
        # What is beyond all numbers is refused by `rotation`, or by the ranges of a camera.
        with np.errstate(over="ignore", invalid="ignore"):
            to_world[:3, 3] /= self.content.applied_scale
            if self.content.applied_transform is not None:
                applied = _matrix(self.content.applied_transform, f"{self.path}: applied_transform")
                if not abs(np.linalg.det(applied)) > 0:
                    raise InputError(f"{self.path}: applied_transform cannot be undone; its determinant is 0.")
                to_world = np.linalg.inv(applied) @ to_world
        axes, notes = rotation(label, to_world[:3, :3])
        return View(axes.T, to_world[:3, 3], self._lens(frame, label, size), notes)

    def _lens(self, frame: _Frame, label: str, image_size: tuple[int, int]) -> Lens:
        def stated(key: str) -> Any:
            own = getattr(frame, key)
            return getattr(self.content, key) if own is None else own

        model = stated("camera_model") or _PINHOLES[0]
        if model not in _PINHOLES or any(stated(key) for key in _OTHER_LENSES):
            what = f"camera_model {model}" if model not in _PINHOLES else " or ".join(_OTHER_LENSES)
            raise InputError(
                f"{label}: expected a pinhole with or without k1, k2, k3, p1, p2; got {what}. Undistort the images and "
                "give the camera of the result."
            )
        size: list[float] = []
        focal: list[float] = []
        centre: list[float] = []
        for axis, extent, pixels in (("x", "w", image_size[0]), ("y", "h", image_size[1])):
            size.append(pixels if stated(extent) is None else stated(extent))
            middle, angle = stated(f"c{axis}"), stated(f"camera_angle_{axis}")
            centre.append(size[-1] / 2 if middle is None else middle)
            if stated(f"fl_{axis}") is not None:
                focal.append(stated(f"fl_{axis}"))
            elif angle is not None:
                focal.append(_focal(size[-1], angle, f"{label}: camera_angle_{axis}"))
        if not focal:
            raise InputError(f"{label}: expected a focal length, fl_x or camera_angle_x; got neither.")
        distortion = [stated(key) or 0.0 for key in ("k1", "k2", "p1", "p2", "k3")]
        # Pixels are square where one focal length is stated.
        return lens(label, (size[0], size[1]), (focal[0], focal[-1], *centre), distortion)


def read_transforms(path: Path) -> Transforms:
    """Read a transforms.json.

    Raises:
        InputError: no JSON, a key that is missing or of the wrong type, no frame.
    """
    try:
        content = msgspec.json.decode(path.read_bytes(), type=_File)
    except msgspec.ValidationError as error:
        text, _, where = str(error).replace("`", "'").partition(" - at '$")
        place = where.rstrip("'").lstrip(".")
        raise InputError(
            f"{path}: expected a transforms.json; {place + ': ' if place else ''}{text[0].lower()}{text[1:]}. Export "
            "it anew."
        ) from None
    except (ValueError, OSError, RecursionError) as error:
        raise InputError(f"{path}: expected a transforms.json; {error}. Export it anew.") from None
    if not content.frames:
        raise InputError(f"{path}: expected at least one frame; got none.")
    return Transforms(path, content)


def _matrix(rows: list[list[float]], label: str) -> np.ndarray:
    """A matrix of 3 or 4 rows of 4 numbers as 4×4; the last row is 0 0 0 1."""
    lengths = [len(row) for row in rows]
    if lengths not in ([4] * 3, [4] * 4) or (len(rows) == 4 and rows[3] != [0, 0, 0, 1]):
        raise InputError(f"{label} must have 3 rows of 4 numbers, and 0 0 0 1 as a fourth or none; export it anew.")
    matrix = np.vstack([np.array(rows[:3], dtype=float), [0, 0, 0, 1]])
    if not np.isfinite(matrix).all():
        raise InputError(f"{label} must have finite numbers; export it anew.")
    return matrix


def _focal(pixels: float, angle: float, label: str) -> float:
    """Focal length of an angle of view in rad over so many pixels."""
    if not 0 < angle < math.pi:
        raise InputError(f"{label} must lie between 0 and π rad; got {angle:g}.")
    return pixels / 2 / math.tan(angle / 2)
