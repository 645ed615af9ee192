"""Camera files of other programs, written independently of the readers from one pose."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tests.shared_data import measurement

WIDTH, HEIGHT = 60, 40
# fx, fy, cx, cy in pixels with centres at +0.5.
PINHOLE = (70.0, 70.0, 30.0, 20.0)
DISTORTION = (-0.2, 0.05, 0.001, -0.002)
MODELS = {"SIMPLE_PINHOLE": 0, "PINHOLE": 1, "SIMPLE_RADIAL": 2, "RADIAL": 3, "OPENCV": 4, "OPENCV_FISHEYE": 5}


@dataclass(frozen=True)
class Pose:
    """Turns of a camera that looks along −z with y up, and its position."""

    turns: Rotation
    position: np.ndarray

    @property
    def to_world(self) -> np.ndarray:
        """OpenGL's axes, 4×4."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.turns.as_matrix(), self.position
        return matrix

    @property
    def to_camera(self) -> tuple[np.ndarray, np.ndarray]:
        """Quaternion (w first) and translation from the world to a camera that looks along z with y down."""
        inverse = (self.turns * Rotation.from_euler("x", 180, degrees=True)).inv()
        return inverse.as_quat(scalar_first=True), -inverse.apply(self.position)

    def toml(self) -> dict[str, Any]:
        """The pose in our own terms."""
        forward, up = self.turns.apply([[0, 0, -1], [0, 1, 0]])
        return {
            "kind": "perspective",
            "position": self.position.tolist(),
            "target": (self.position + 3 * forward).tolist(),
            "up": up.tolist(),
        }

    def directions(self, points: np.ndarray) -> np.ndarray:
        """Unit directions [N, 3] of the rays through places [N, 2] of the image of `PINHOLE` without distortion."""
        fx, fy, cx, cy = PINHOLE
        own = np.stack([(points[:, 0] - cx) / fx, -(points[:, 1] - cy) / fy, -np.ones(len(points))], axis=1)
        return self.turns.apply(own / np.linalg.norm(own, axis=1, keepdims=True))


POSE = Pose(Rotation.from_euler("yxz", [0.3, -0.2, 0.1]), np.array([0.9, 0.6, 3.0]))
OTHER_POSE = Pose(Rotation.from_euler("yxz", [-0.5, 0.1, 0.0]), np.array([-1.5, -0.3, 2.8]))


def blender(frames: dict[str, Pose], **keys: Any) -> dict[str, Any]:
    """The content of a transforms.json as Blender's scripts write it."""
    angle = 2 * np.arctan(WIDTH / 2 / PINHOLE[0])
    listed = [{"file_path": n, "rotation": 0.01, "transform_matrix": p.to_world.tolist()} for n, p in frames.items()]
    return {"camera_angle_x": angle, "frames": listed} | keys


def nerfstudio(frames: dict[str, Pose], applied: np.ndarray | None = None, **keys: Any) -> dict[str, Any]:
    """The content of a transforms.json of nerfstudio; `applied` (4×4) turns the world that it has its poses in."""
    lens = dict(zip(("fl_x", "fl_y", "cx", "cy"), PINHOLE, strict=True)) | {"w": WIDTH, "h": HEIGHT}
    turned = {name: (np.eye(4) if applied is None else applied) @ pose.to_world for name, pose in frames.items()}
    listed = [{"file_path": name, "transform_matrix": matrix.tolist()} for name, matrix in turned.items()]
    extra = {} if applied is None else {"applied_transform": applied[:3].tolist()}
    return lens | {"camera_model": "OPENCV", "frames": listed} | extra | keys


def write_json(path: Path, content: dict[str, Any]) -> Path:
    path.write_text(json.dumps(content), "utf-8")
    return path


def write_text(
    folder: Path, frames: dict[str, Pose], model: str = "PINHOLE", values: tuple[float, ...] = PINHOLE
) -> Path:
    """A model of COLMAP as text; every second image has points."""
    folder.mkdir(parents=True, exist_ok=True)
    numbers = " ".join(f"{value:.17e}" for value in values)
    (folder / "cameras.txt").write_text(f"# Camera list\n7 {model} {WIDTH} {HEIGHT} {numbers}\n", "utf-8")
    lines = ["# Image list with two lines of data per image:"]
    for number, (name, pose) in enumerate(frames.items(), start=1):
        quaternion, translation = pose.to_camera
        words = " ".join(f"{value:.17e}" for value in (*quaternion, *translation))
        lines += [f"{number} {words} 7 {name}", "1.5 2.5 -1 3.25 4.5 17" if number % 2 else ""]
    (folder / "images.txt").write_text("\n".join(lines) + "\n", "utf-8")
    return folder


def write_binary(
    folder: Path, frames: dict[str, Pose], model: str = "PINHOLE", values: tuple[float, ...] = PINHOLE
) -> Path:
    """The same model in binary."""
    folder.mkdir(parents=True, exist_ok=True)
    camera = struct.pack("<IiQQ", 7, MODELS[model], WIDTH, HEIGHT) + struct.pack(f"<{len(values)}d", *values)
    (folder / "cameras.bin").write_bytes(struct.pack("<Q", 1) + camera)
    data = struct.pack("<Q", len(frames))
    for number, (name, pose) in enumerate(frames.items(), start=1):
        quaternion, translation = pose.to_camera
        data += struct.pack("<I7dI", number, *quaternion, *translation, 7) + name.encode() + b"\0"
        points = [(1.5, 2.5, 2**64 - 1), (3.25, 4.5, 17)] if number % 2 else []
        data += struct.pack("<Q", len(points)) + b"".join(struct.pack("<ddQ", *point) for point in points)
    (folder / "images.bin").write_bytes(data)
    return folder


def shared_rays() -> tuple[Path, np.ndarray, dict[tuple[float, float], list[float]]]:
    """A folder with one camera in several formats, its position, and directions of rays by place in the image."""
    path = measurement("layouts", "rays.json")
    content = json.loads(path.read_text("utf-8"))
    directions = {tuple(map(float, k.split(","))): v for k, v in content["direction_at_pixel_centre"].items()}
    return path.parent, np.array(content["centre"]), directions
