"""`matest export` of results with maps, one view or several, as people use it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import trimesh

from tests.commands.conftest import Run
from tests.export.two_tone import results, to_edge, truth

pytest.importorskip("xatlas")


@pytest.fixture
def views(tmp_path: Path) -> list[Path]:
    """Copies of results of three views of a vase of two colours, with their captures."""
    root = results()[0].parents[1]
    copy = shutil.copytree(root, tmp_path / "work")
    return [copy / result.relative_to(root) for result in results()]


def exported(folder: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Value and standard error at the vertices of a folder of textures [V, 3], and where they are [V, 3]."""
    mesh = trimesh.load(folder / "mesh.obj", process=False)
    value, std = (
        OpenEXR.File(str(folder / f"{name}.exr")).channels()["RGB"].pixels for name in ("albedo", "albedo_std")
    )
    u, v = mesh.visual.uv.T
    size = len(value)
    row, column = (np.floor(size * part).astype(int).clip(0, size - 1) for part in (1 - v, u))
    return value[row, column], std[row, column], mesh.vertices


def test_views_merge_into_textures_that_agree_with_the_truth(run: Run, views: list[Path], tmp_path: Path) -> None:
    for count in (1, 3):
        out = tmp_path / f"textures-{count}"
        code, text, _ = run("export", *views[:count], "--to", "textures", "-o", out, "--json")
        assert code == 0
        content = json.loads(text)
        assert content["texels"] == 256
        value, std, points = exported(out)
        known = (std > 0).all(axis=1) & (to_edge(points) > 0.06)
        assert known.mean() == pytest.approx(content["coverage"]["seen"] * (to_edge(points) > 0.06).mean(), abs=0.1)
        error = value[known] - truth(points[known])
        assert (np.abs(error) < 1.96 * std[known]).mean() > 0.93
        assert np.median(np.abs(error)) < 0.01
    assert content["coverage"]["seen"] > 0.9
    assert 0 < content["coverage"]["repeated"] < 0.5


def test_one_result_says_what_it_covers(run: Run, views: list[Path]) -> None:
    code, out, err = run("export", views[0], "--to", "textures")
    assert code == 0
    assert not err
    assert f"Written to {views[0]}-textures: albedo.exr, albedo_std.exr, albedo_status.png, mesh.obj." in out
    assert "% of the surface with 256×256 texels; the mesh has no texture coordinates: unwrapped by xatlas." in out


def test_gltf_has_the_mesh_and_a_texture(run: Run, views: list[Path]) -> None:
    pytest.importorskip("pygltflib")
    code, out, err = run("export", *views, "--to", "gltf", "--size", "128")
    assert code == 0
    assert not err
    assert "error of the conversion" in out
    (mesh,) = trimesh.load_scene(views[0].with_suffix(".glb")).geometry.values()
    assert mesh.visual.material.baseColorTexture.size == (128, 128)


def test_mitsuba_has_bitmaps_and_the_mesh(run: Run, views: list[Path]) -> None:
    code, out, _ = run("export", *views[:2], "--to", "mitsuba", "-o", views[0].with_name("vase.xml"))
    assert code == 0
    files = {file.name for file in views[0].parent.glob("vase*")}
    assert files == {"vase.xml", "vase_lobe_0_albedo.exr", "vase.obj"}
    assert "lobe_0_sigma = 0.40" in out
    assert 'filename" value="vase_lobe_0_albedo.exr"' in views[0].with_name("vase.xml").read_text()


def test_results_of_unknown_scale_follow_the_others(run: Run, views: list[Path], tmp_path: Path) -> None:
    code, _, err = run("export", *views[::-1], "--to", "textures", "-o", tmp_path / "all")
    assert code == 0
    assert "known up to a scale" not in err
    value, std, points = exported(tmp_path / "all")
    known = (std > 0).all(axis=1) & (to_edge(points) > 0.06)
    assert abs(np.median(value[known] / truth(points[known])) - 1) < 0.01


def test_the_means_are_written_where_the_capture_is_gone(run: Run, views: list[Path]) -> None:
    shutil.rmtree(views[0].parents[1] / "0")
    code, out, err = run("export", views[0], "--to", "mitsuba")
    assert code == 0
    assert "its capture, which has the mesh and the camera, is not at" in err
    assert "What was written has the means of its maps." in err
    assert "matest_bsdf.py" in out
    code, _, err = run("export", *views, "--to", "mitsuba")
    assert code == 2
    assert "put it there or estimate it again" in err


def edited(folder: Path, old: str, new: str) -> None:
    for name in ("material.json", "result.json"):
        file = folder / name
        file.write_text(file.read_text("utf-8").replace(old, new), "utf-8")


def test_results_that_are_not_views_of_one_mesh_are_refused(run: Run, views: list[Path]) -> None:
    mesh = views[0].parents[1] / "vase.obj"
    other = trimesh.load(mesh, process=False)
    other.vertices = other.vertices * (1, 1.0003, 1)
    other.export(mesh.with_name("other.obj"))
    toml = views[0].parents[1] / "120" / "capture.toml"
    toml.write_text(toml.read_text().replace("vase.obj", "other.obj"))
    code, _, err = run("export", *views[:2], "--to", "textures")
    assert code == 2
    assert f"{views[1]}: has not the mesh of {views[0]}" in err


def test_results_of_several_models_are_refused(run: Run, views: list[Path]) -> None:
    edited(views[1], '"oren-nayar"', '"oren-nayar-qualitative"')
    edited(views[1], '"interreflection"', '"unknown"')
    content = json.loads((views[1] / "material.json").read_text())
    content["parameters"].pop("unknown")
    (views[1] / "material.json").write_text(json.dumps(content))
    code, _, err = run("export", *views[:2], "--to", "textures")
    assert code == 2
    assert "views that are merged have one model and the same maps" in err


def test_a_capture_that_has_changed_is_refused(run: Run, views: list[Path]) -> None:
    toml = views[0].parents[1] / "0" / "capture.toml"
    toml.write_text(toml.read_text().replace("height = 2.4", "height = 2.9"))
    code, _, err = run("export", views[0], "--to", "textures")
    assert code == 2
    assert "its maps show the object at other pixels" in err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--to", "textures", "-o", "."), "expected a folder for textures, which is no result"),
        (("--to", "textures", "--size", "0"), "--size is a number of texels from 1 to 16384"),
        (("--to", "merl", "--size", "64"), "--size is that of textures, and --to merl has none"),
        (("--to", "mitsuba", "--fitted", "--size", "64"), "--fitted writes no textures"),
        (("--to", "mitsuba", "-o", "../../vase.xml"), "vase.obj: exists and may not be from an earlier export"),
    ],
)
def test_what_makes_no_textures_is_refused(
    run: Run, views: list[Path], monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], words: str
) -> None:
    monkeypatch.chdir(views[0])
    code, _, err = run("export", ".", *arguments)
    assert code == 2
    assert words in err


def test_several_results_go_with_textures_alone(run: Run, views: list[Path]) -> None:
    code, _, err = run("export", *views, "--to", "materialx")
    assert code == 2
    assert "--to materialx writes one result" in err


def test_a_sphere_has_a_mesh_of_its_own(run: Run, made: Path, tmp_path: Path) -> None:
    code, _, err = run("estimate", made, "--model", "oren-nayar", "--maps", "albedo", "-o", tmp_path / "ball")
    assert code == 0, err
    code, out, _ = run("export", tmp_path / "ball", "--to", "textures")
    assert code == 0
    assert "texels; texture coordinates of the mesh." in out
    value, std, points = exported(tmp_path / "ball-textures")
    known = (std > 0).all(axis=1)
    assert 0.25 < known.mean() < 0.5
    assert points[known][:, 2].min() > -0.05
    assert np.abs(value[known] / (0.6, 0.5, 0.4) - 1).max() < 0.1
