"""Every key of capture and scene files with values that it was not made for: read, or refused in words of the file."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest
import trimesh

from matest import load_capture
from matest.capture import schema
from matest.errors import InputError
from matest.samples.uncertainty import NAMES
from matest.scene import mesh
from matest.simulate import load_scene
from tests.captures import sphere_folder, toml

# Values, as they stand in a file.
VALUES = (
    "nan", "-inf", "0", "-1", "1e308", "1e-320", "9" * 5000, str(2**64), '""', '"text"', '"\\u001b[2J"', "true", "[]",
    "[[]]", "{}", "[nan]", "[1e308, 1e308, 1e308]", "[1, 2]",
)  # fmt: skip
LIGHT = {"direction": [0.3, 0.2, 0.9], "irradiance": [1.2, 1.0, 0.8]}
CAMERA = {"kind": "perspective", "position": [0.0, 0.0, 5.0], "target": [0.0, 0.0, 0.0], "fov_y": 0.5}
# Stands for a value while the rest of a file is made.
_PLACE = "the value"


def bases(folder: Path) -> dict[str, tuple[Callable[[Path], object], dict[str, Any]]]:
    """Files that are read as they are, which together have every table, by a name; and who reads them."""
    sphere = sphere_folder(folder).tables
    trimesh.creation.icosphere(subdivisions=1).export(folder / "ball.ply")
    cv2.imwrite(str(folder / "sky.hdr"), np.ones((4, 8, 3), np.float32))
    sphere |= {"camera": {}, "encoding": {"transfer": "linear"}, "noise": {"read": 0.01}, "uncertainty": {}}
    ball = {
        "geometry": {"mesh": "ball.ply"}, "camera": {**CAMERA, "resolution": [12, 8]}, "material": {"model": "lambert"},
        "noise": {"bits": 16}, "encoding": {"scale": 1.0},
        "image": [{"lights": [{"position": [0.0, 1.0, 4.0], "intensity": 9.0}]}, {"lights": [LIGHT]}],
    }  # fmt: skip
    objects = {
        "camera": {**CAMERA, "resolution": [12, 8]}, "image": [{"lights": [LIGHT]}],
        "object": [
            {"name": "a", "mesh": "ball.ply", "material": {"model": "oren-nayar", "sigma": 0.3}},
            {"name": "b", "shape": "sphere", "radius": 0.5, "material": {"model": "lambert"}},
        ],
    }  # fmt: skip
    sky = {
        "geometry": {"mesh": "ball.ply"}, "camera": {**CAMERA, "resolution": [12, 8]}, "material": {"model": "lambert"},
        "image": [{"lights": [{"environment": "sky.hdr", "directions": 16}]}],
    }  # fmt: skip
    return {
        "capture": (load_capture, sphere), "mesh": (load_scene, ball), "objects": (load_scene, objects),
        "sky": (load_scene, sky),
    }  # fmt: skip


def tables(content: dict[str, Any]) -> Iterator[tuple[dict[str, Any], list[str]]]:
    """The tables of a file with the keys that each may have."""
    kind = schema.SceneFile if "material" in content or "object" in content else schema.CaptureFile
    yield content, [field.name for field in msgspec.structs.fields(kind)]
    parts = {"geometry": schema.GeometryTable, "camera": schema.CameraTable, "encoding": schema.EncodingTable,
             "noise": schema.NoiseTable, "image": schema.ImageTable, "object": schema.ObjectTable}  # fmt: skip
    for name, kind in parts.items():
        value = content.get(name, [])
        for table in value if isinstance(value, list) else [value]:
            yield table, [field.name for field in msgspec.structs.fields(kind)]
            for light in table.get("lights", []):
                yield light, [field.name for field in msgspec.structs.fields(schema.LightTable)]
            if "material" in table:
                yield table["material"], ["model", "preset", *table["material"], "albedo"]
    if "material" in content:
        yield content["material"], ["model", "preset", "albedo"]
    if "uncertainty" in content:
        yield content["uncertainty"], [*NAMES]


def files(content: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """A key, and the text of the file with a hole for its value, for every key of every table."""
    count = len([*tables(content)])
    for number in range(count):
        for key in [*tables(content)][number][1]:
            changed = copy.deepcopy(content)
            table = [*tables(changed)][number][0]
            table[key] = _PLACE
            yield key, toml(changed)


@pytest.mark.parametrize("name", ["capture", "mesh", "objects", "sky"])
def test_any_value_of_any_key_is_read_or_refused_by_file_and_key(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A sphere of few facets is read or refused as one of many is.
    monkeypatch.setattr(mesh, "_SUBDIVISIONS", 2)
    load, content = bases(tmp_path)[name]
    file = tmp_path / ("capture.toml" if load is load_capture else "scene.toml")
    file.write_text(toml(content), "utf-8")
    load(file)
    troubles = []
    for key, text in files(content):
        for value in VALUES:
            file.write_text(text.replace(f'"{_PLACE}"', value), "utf-8")
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("error")
                    load(file)
            except InputError as error:
                words = str(error)
                fine = words.startswith(str(tmp_path)) and "\n" not in words and words[-1] in ".?" and len(words) < 1000
                # A file without objects needs a geometry.
                if not fine or (key.rstrip("s") not in words and (key, value) != ("object", "[]")):
                    troubles.append(f"{key} = {value[:30]}: {words[:300]}")
            except Exception as error:
                troubles.append(f"{key} = {value[:30]}: {type(error).__name__}: {error}")
    assert not troubles, "\n".join(troubles)
