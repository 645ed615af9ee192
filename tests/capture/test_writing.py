from __future__ import annotations

import tomllib

from matest.capture.schema import CameraTable, GeometryTable, ImageTable, LightTable
from matest.capture.writing import as_toml, changes


def test_only_what_differs_from_the_defaults_is_written() -> None:
    light = LightTable(direction=(0.1, 0.2, 0.97))
    assert changes(GeometryTable(normals="n.exr")) == {"normals": "n.exr"}
    assert changes(CameraTable(file="transforms.json")) == {"file": "transforms.json"}
    assert changes(ImageTable(file="a.png", lights=[light])) == {
        "file": "a.png",
        "lights": [{"direction": (0.1, 0.2, 0.97)}],
    }


def test_lists_of_numbers_take_one_line_and_come_back_exactly() -> None:
    content = {"image": [{"file": "a.png", "lights": [{"direction": [0.1, -1e-17, 1 / 3]}]}]}
    text = as_toml(content)
    assert "direction = [0.1, -1e-17, 0.3333333333333333]" in text
    assert tomllib.loads(text) == content
