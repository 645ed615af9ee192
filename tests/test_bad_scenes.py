"""Scene files that cannot be rendered as they are."""

from __future__ import annotations

from pathlib import Path

import pytest

from matest import load_capture
from matest.simulate import load_scene, simulate
from tests import scenes
from tests.captures import refusal

LAMBERT = scenes.material("lambert", albedo=0.5)
LIGHT = scenes.distant(([0.3, 0.2, 0.93],))
SPHERE = scenes.sphere(24)
NAMED = '[[image]]\nfile = "{}"\nlights = [ {{ direction = [0, 0, 1], irradiance = 3.0 }} ]\n'


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        ((SPHERE, LIGHT), "material"),
        (("[material]\nalbedo = 0.5", SPHERE, LIGHT), "model ="),
        (('[material]\nmodel = "lambrt"', SPHERE, LIGHT), "did you mean 'lambert'?"),
        (('[material]\npreset = "foan"', SPHERE, LIGHT), "did you mean 'foam'?"),
        (('[material]\npreset = "rust"', SPHERE, LIGHT), "needs f0"),
        (('[material]\npreset = "foam"\nalbedo = 0.5', SPHERE, LIGHT), "leave out albedo"),
        (('[material]\npreset = "foam"\nmodel = "lambert"', SPHERE, LIGHT), "both model and preset"),
        ((scenes.material("lambert", albdo=0.5), SPHERE, LIGHT), "did you mean 'albedo'?"),
        ((scenes.material("lambert", albedo=1.5), SPHERE, LIGHT), "[0, 1]"),
        ((scenes.material("lambert", albedo=[0.1, 0.2]), SPHERE, LIGHT), "3 values"),
        ((scenes.material("oren-nayar", sigma=30), SPHERE, LIGHT), "radians"),
        ((LAMBERT, SPHERE, "image = []"), "image"),
        ((LAMBERT, LIGHT), "geometry"),
        ((LAMBERT, "[geometry]\nshape = 'sphere'\ncentre = [8, 8]\nradius = 6", LIGHT), "resolution"),
        ((LAMBERT, SPHERE.replace("[24, 24]", "[0, 24]"), LIGHT), "resolution"),
        ((LAMBERT, SPHERE + "supersampling = 0", LIGHT), "supersampling"),
        ((LAMBERT, SPHERE + "supersampling = 99", LIGHT), "supersampling"),
        ((LAMBERT, SPHERE, '[encoding]\nflat = "flat.exr"', LIGHT), "flat field"),
        ((LAMBERT, SPHERE, "[noise]\nbits = 12", LIGHT), "bits"),
        ((LAMBERT, SPHERE, "[noise]\nbots = 8", LIGHT), "did you mean 'bits'?"),
        ((LAMBERT, SPHERE, scenes.distant(([0, 0, 0],))), "direction"),
        ((LAMBERT, SPHERE, "[noise]\nread = -0.1", LIGHT), "noise.read"),
        ((LAMBERT, SPHERE, "[noise]\ngain = nan", LIGHT), "noise.gain"),
        ((LAMBERT, SPHERE, "[noise]\nseed = -1", LIGHT), "noise.seed"),
        ((LAMBERT, SPHERE, "[encoding]\nblack = 1.0", "[noise]\nbits = 8", LIGHT), "encoding.black"),
        ((LAMBERT, SPHERE, "[[image]]\nexposure = 0.0\nlights = []"), "image 0: exposure"),
    ],
)
def test_errors_name_the_file_and_what_to_mend(tmp_path: Path, parts: tuple[str, ...], expected: str) -> None:
    file = scenes.write(tmp_path, *sorted(parts, key=lambda part: part.startswith("[")))
    message = refusal(lambda: simulate(file, tmp_path / "out"))
    assert "scene.toml" in message
    assert expected in message
    assert not (tmp_path / "out").exists()


def test_a_folder_without_a_scene_is_refused(tmp_path: Path) -> None:
    assert "scene.toml" in refusal(lambda: load_scene(tmp_path))


def test_supersampling_a_normal_map_is_refused(tmp_path: Path) -> None:
    first = simulate(scenes.write(tmp_path / "sphere", LAMBERT, SPHERE, LIGHT))
    camera = "[camera]\nresolution = [24, 24]\nsupersampling = 2\n"
    file = scenes.write(first, LAMBERT, '[geometry]\nnormals = "normals.exr"\n', camera, LIGHT)
    assert "normal map" in refusal(lambda: load_scene(file))


def test_images_may_lie_in_a_folder_below(tmp_path: Path) -> None:
    file = scenes.write(tmp_path, LAMBERT, SPHERE, "[noise]\nbits = 8\n", NAMED.format("images/a.png"))
    assert len(load_capture(simulate(file, tmp_path / "out"))) == 1
    assert (tmp_path / "out" / "images" / "a.png").is_file()


def test_images_outside_the_captures_folder_are_refused(tmp_path: Path) -> None:
    file = scenes.write(tmp_path / "scene", LAMBERT, SPHERE, NAMED.format("../escaped.exr"))
    assert "escaped.exr" in refusal(lambda: simulate(file))
    assert not (tmp_path / "escaped.exr").exists()


@pytest.mark.parametrize(("bits", "name"), [("bits = 16\n", "00.exr"), ("bits = 16\n", "00.jpg"), ("", "00.jpg")])
def test_names_that_cannot_hold_such_pixels_are_refused(tmp_path: Path, bits: str, name: str) -> None:
    file = scenes.write(tmp_path, LAMBERT, SPHERE, f"[noise]\n{bits}", NAMED.format(name))
    assert Path(name).suffix in refusal(lambda: simulate(file, tmp_path / "out"))
    assert not (tmp_path / "out" / "capture.toml").exists()


def test_two_images_of_one_name_are_refused(tmp_path: Path) -> None:
    file = scenes.write(tmp_path, LAMBERT, SPHERE, 2 * NAMED.format("a.exr"))
    assert "a.exr" in refusal(lambda: simulate(file, tmp_path / "out"))


@pytest.mark.parametrize("name", ["mask.png", "./Mask.png", "mask.png/00.png"])
def test_an_image_does_not_replace_the_mask(tmp_path: Path, name: str) -> None:
    file = scenes.write(tmp_path, LAMBERT, SPHERE, "[noise]\nbits = 8", NAMED.format(name))
    assert "two files would be called" in refusal(lambda: simulate(file, tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_own_files_in_an_earlier_rendering_stay(tmp_path: Path) -> None:
    file = scenes.write(tmp_path / "scene", LAMBERT, SPHERE, NAMED.format("a.exr"))
    out = simulate(file, tmp_path / "out")
    (out / "mine.exr").write_text("mine", "utf-8")
    simulate(file, out)
    scenes.write(tmp_path / "scene", LAMBERT, SPHERE, NAMED.format("mine.exr"))
    assert "would be overwritten" in refusal(lambda: simulate(file, out))
    assert (out / "mine.exr").read_text("utf-8") == "mine"
