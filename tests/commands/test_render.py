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


def test_an_object_outside_the_view_is_told(run: Run, tmp_path: Path) -> None:
    ball = '[[object]]\nname = "{}"\nposition = {}\nshape = "sphere"\nradius = 0.4\nmaterial.model = "lambert"\n'
    camera = '[camera]\nkind = "orthographic"\nheight = 1\nposition = [0, 0, 5]\nresolution = [16, 16]\n'
    objects = ball.format("here", [0, 0, 0]) + ball.format("far", [50, 0, 0])
    scene = scenes.write(tmp_path / "scene", objects, camera, scenes.distant(scenes.LIGHTS[:1]))
    code, _, err = run("render", scene)
    assert (code, "No pixel shows far: outside the image" in err) == (0, True)


def test_a_quiet_command_writes_and_prints_nothing(run: Run, scene: Path, tmp_path: Path) -> None:
    assert run("render", scene, "-o", tmp_path / "out", "--quiet") == (0, "", "")
    assert (tmp_path / "out" / "capture.toml").is_file()
    scene.unlink()
    assert run("render", scene, "-q")[0] == 2
