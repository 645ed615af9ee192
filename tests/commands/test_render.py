"""`matest render` as people and scripts use it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests import scenes
from tests.commands.conftest import Run


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    material = scenes.material("lambert", albedo=0.5)
    return scenes.write(tmp_path / "scene", material, scenes.sphere(24), scenes.distant(scenes.LIGHTS[:2]))


def test_a_scene_becomes_a_capture_where_it_is_asked_for(run: Run, scene: Path, tmp_path: Path) -> None:
    assert run("render", scene, "-o", tmp_path / "out") == (0, f"Written to {tmp_path / 'out'}\n", "")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"00.exr", "01.exr", "mask.png", "normals.exr", "capture.toml"}


def test_without_a_place_the_capture_lies_beside_its_scene(run: Run, scene: Path) -> None:
    code, out, err = run("render", scene.parent, "--json")
    assert (code, err) == (0, "")
    assert json.loads(out) == {"out": str(scene.parent), "notes": []}
    assert (scene.parent / "capture.toml").is_file()


def test_a_scene_that_cannot_be_read_is_refused_in_one_line(run: Run, scene: Path) -> None:
    scene.write_text(scene.read_text("utf-8").replace("lambert", "lambret"), "utf-8")
    code, out, err = run("render", scene)
    assert (code, out) == (2, "")
    assert "did you mean 'lambert'?" in err
    assert err.count("\n") == 1
