"""`matest export` as people and scripts use it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.commands.conftest import Run


@pytest.fixture
def result(tmp_path: Path) -> Path:
    folder = tmp_path / "ball"
    folder.mkdir()
    content = {"model": "lambert", "radiometry": "relative", "parameters": {"albedo": [0.5, 0.4, 0.3]}}
    (folder / "material.json").write_text(json.dumps(content))
    return folder


def test_a_material_is_written_with_its_error(run: Run, result: Path) -> None:
    code, out, err = run("export", result, "--to", "merl")
    assert code == 0
    assert "error of the conversion 0.00%" in out
    assert "up to a scale only" in err
    assert result.with_name("ball.binary").stat().st_size == 34_992_012


def test_json_names_the_file_and_the_error(run: Run, result: Path, tmp_path: Path) -> None:
    code, out, _ = run("export", result, "--to", "merl", "-o", tmp_path / "a.binary", "--json")
    assert code == 0
    assert json.loads(out)["file"] == str(tmp_path / "a.binary")
    assert json.loads(out)["error"]["relative_rmse"] < 1e-6


@pytest.mark.parametrize(("target", "suffix"), [("mitsuba", ".xml"), ("materialx", ".mtlx"), ("gltf", ".glb")])
def test_every_target_has_its_file_and_says_what_it_wrote(run: Run, result: Path, target: str, suffix: str) -> None:
    code, out, _ = run("export", result, "--to", target)
    assert code == 0
    assert result.with_name(f"ball{suffix}").is_file()
    assert "error of the conversion 0.00% of the rms brightness" in out
    assert "0.5 0.4 0.3" in out
    code, out, _ = run("export", result, "--to", target, "--json")
    assert code == 0
    content = json.loads(out)
    assert content["files"] == [str(result.with_name(f"ball{suffix}"))]
    assert content["parameters"]
    assert content["notes"]


def test_maps_that_stay_behind_are_named(run: Run, result: Path) -> None:
    (result / "maps").mkdir()
    assert "do not travel: what was written has their means" in run("export", result, "--to", "materialx")[2]


def test_parameters_that_no_data_determine_are_named(run: Run, result: Path) -> None:
    assert "does not determine" not in run("export", result, "--to", "materialx")[2]
    content = json.loads((result / "material.json").read_text()) | {"not_determined": ["albedo"]}
    (result / "material.json").write_text(json.dumps(content))
    assert f"{result} does not determine albedo: what was written" in run("export", result, "--to", "materialx")[2]


def test_a_plugin_is_written_unless_own_lobes_are_asked_for(run: Run, result: Path) -> None:
    content = {"model": "oren-nayar", "parameters": {"albedo": 0.5, "sigma": 0.4, "interreflection": 1.0}}
    (result / "material.json").write_text(json.dumps(content))
    _, out, _ = run("export", result, "--to", "mitsuba")
    assert "import matest_bsdf after set_variant()" in out
    assert result.with_name("matest_bsdf.py").is_file()
    code, out, _ = run("export", result, "--to", "mitsuba", "--fitted", "--json")
    assert code == 0
    assert json.loads(out)["error"]["relative_rmse"] > 0.05
    assert len(json.loads(out)["files"]) == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--to", "gltf", "--fitted"), "--fitted goes with --to mitsuba"),
        (("--to", "gltf", "-o", "ball.obj"), "ball.obj: expected a name that ends in .glb or .gltf"),
        (("--to", "merle"), "did you mean 'merl'?"),
        (("--to", "merl", "-o", "/nowhere/a.binary"), "expected a file name in a folder that exists"),
    ],
)
def test_what_cannot_be_written_is_refused(run: Run, result: Path, arguments: tuple[str, ...], words: str) -> None:
    code, _, err = run("export", result, *arguments)
    assert code == 2
    assert words in err


def test_a_folder_without_a_material_is_named(run: Run, tmp_path: Path) -> None:
    code, _, err = run("export", tmp_path, "--to", "merl")
    assert code == 2
    assert str(tmp_path) in err


@pytest.mark.parametrize(("target", "suffix"), [("mitsuba", ".xml"), ("materialx", ".mtlx"), ("gltf", ".glb")])
def test_a_file_of_the_user_is_not_replaced(run: Run, result: Path, target: str, suffix: str) -> None:
    own = result.with_name(f"ball{suffix}")
    for place in ([], ["-o", own]):
        own.write_bytes(b"the mesh that the photographs show")
        code, _, err = run("export", result, "--to", target, *place)
        assert code == 2
        assert f"{own}: exists and may not be from an earlier export" in err
        assert own.read_bytes() == b"the mesh that the photographs show"


def test_a_table_is_not_replaced(run: Run, result: Path) -> None:
    own = result.with_name("ball.binary")
    own.write_bytes(b"measured")
    assert run("export", result, "--to", "merl")[0] == 2
    assert own.read_bytes() == b"measured"
