"""Small captures with known answers, in memory and on disk."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from matest import InputError, load_capture
from matest.capture import Capture
from matest.scene import DirectionalLight, PointLight, Scene, Surface
from matest.scene.surface import from_sphere

ALBEDO = (0.7, 0.5, 0.3)
SHAPE = (40, 48)
CENTRE = (23.5, 20.25)
RADIUS = 15.0


@dataclass
class CaptureFolder:
    """A folder that becomes a capture: change `tables` or the files, then `load`."""

    path: Path
    tables: dict[str, Any]

    @property
    def file(self) -> Path:
        return self.path / "capture.toml"

    def save(self) -> Path:
        self.file.write_text(toml(self.tables), "utf-8")
        return self.path

    def load(self, **options: Any) -> Capture:
        return load_capture(self.save(), **options)

    def put(self, name: str, image: np.ndarray) -> None:
        put_image(self.path / name, image)


def put_image(path: Path, image: np.ndarray) -> None:
    """Write RGB or grey values without using matest."""
    if path.suffix == ".npy":
        np.save(path, image)
        return
    assert cv2.imwrite(str(path), image[..., ::-1] if image.ndim == 3 else image)


def sphere_folder(path: Path) -> CaptureFolder:
    """Two float RGB images of a Lambertian sphere of albedo `ALBEDO`, each under one distant light."""
    lights = [
        [{"direction": [0.3, 0.2, 0.9], "irradiance": [1.2, 1.0, 0.8]}],
        [{"direction": [-0.5, 0.1, 0.8], "irradiance": [0.9, 1.0, 1.1]}],
    ]
    tables = {
        "mask": "mask.png",
        "geometry": {"shape": "sphere", "centre": list(CENTRE), "radius": RADIUS},
        "image": [{"file": f"{k:02d}.npy", "lights": lit} for k, lit in enumerate(lights)],
    }
    folder = CaptureFolder(path, tables)
    folder.put("mask.png", (255 * inside_sphere()).astype(np.uint8))
    for table in tables["image"]:
        folder.put(table["file"], lambert_sphere(table["lights"]))
    return folder


def encode_as_png(folder: CaptureFolder, dtype: type[np.unsignedinteger]) -> None:
    """Replace the float images of `sphere_folder` by linear PNG files, full scale = radiance 1."""
    full = np.iinfo(dtype).max
    for k, table in enumerate(folder.tables["image"]):
        codes = np.round(full * lambert_sphere(table["lights"])).astype(dtype)
        table["file"] = f"{k:02d}.png"
        folder.put(table["file"], codes)
    folder.tables["encoding"] = {"transfer": "linear"}


def sphere_normals() -> np.ndarray:
    """Normals H×W×3 of the sphere, zero outside: x right, y up, z toward the viewer."""
    rows, columns = np.indices(SHAPE)
    x = (columns + 0.5 - CENTRE[0]) / RADIUS
    y = -(rows + 0.5 - CENTRE[1]) / RADIUS
    squared = x**2 + y**2
    normals = np.stack([x, y, np.sqrt(np.clip(1 - squared, 0, None))], axis=-1)
    return np.where((squared < 1)[..., None], normals, 0.0)


def inside_sphere() -> np.ndarray:
    return sphere_normals().any(axis=2)


def lambert_sphere(lights: list[dict[str, Any]], ambient: float = 0.0) -> np.ndarray:
    """Radiance H×W×3 of the Lambertian sphere under distant lights and an even sky, float32."""
    normals = sphere_normals()
    radiance = np.full((*SHAPE, 3), ambient) * inside_sphere()[..., None]
    for light in lights:
        direction = np.array(light["direction"]) / np.linalg.norm(light["direction"])
        radiance += np.clip(normals @ direction, 0, None)[..., None] * np.array(light["irradiance"]) / math.pi
    return (radiance * ALBEDO).astype(np.float32)


def sphere_surface(size: int = 24) -> Surface:
    """A sphere of radius 1 filling most of a square image."""
    return from_sphere((size, size), (size / 2, size / 2), 0.45 * size, None)


def directional(direction: tuple[float, ...], *irradiance: float) -> DirectionalLight:
    vector = torch.tensor(direction, dtype=torch.float64)
    return DirectionalLight(vector / vector.norm(), torch.tensor(irradiance or (1.0,), dtype=torch.float64))


def point(position: tuple[float, ...], *intensity: float) -> PointLight:
    return PointLight(
        torch.tensor(position, dtype=torch.float64), torch.tensor(intensity or (1.0,), dtype=torch.float64)
    )


def scene_of(surface: Surface, *lights: DirectionalLight | PointLight, ambient: float = 0.0) -> Scene:
    """One image under all the lights."""
    channels = len(lights[0].at(surface.positions)[1][0]) if lights else 1
    return Scene(surface, (lights,), torch.full((1, channels), ambient, dtype=torch.float64))


def changed(capture: Capture, **attributes: Any) -> Capture:
    """The capture with some attributes of its photographs changed."""
    return replace(capture, photographs=replace(capture.photographs, **attributes))


def refusal(call: Callable[[], object]) -> str:
    """The one sentence with which `call` refuses its input."""
    with pytest.raises(InputError) as caught:
        call()
    message = str(caught.value)
    assert "\n" not in message
    assert message[-1] in ".?"
    return message


def toml(tables: dict[str, Any]) -> str:
    """TOML text of a capture's tables."""
    plain = [f"{key} = {_value(value)}" for key, value in tables.items() if not _is_table(value)]
    for key, value in tables.items():
        if isinstance(value, dict):
            plain += [f"[{key}]", *(f"{k} = {_value(v)}" for k, v in value.items())]
        elif _is_table(value):
            for entry in value:
                plain += [f"[[{key}]]", *(f"{k} = {_value(v)}" for k, v in entry.items())]
    return "\n".join(plain) + "\n"


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and bool(value) and isinstance(value[0], dict))


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{k} = {_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else repr(value)
