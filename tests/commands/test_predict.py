"""`matest predict` as people and scripts use it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import matest
from matest.photographs.images import read_image, write_image
from matest.simulate import simulate
from tests import scenes
from tests.commands.conftest import Run


def test_prediction_lies_beside_the_result_and_survives_the_next_estimate(run: Run, capture: Path) -> None:
    assert run("estimate", capture, "--model", "lambert")[0] == 0
    assert run("predict", capture / "matest", capture)[0] == 0
    assert (capture / "matest-predict-ball" / "00.exr").is_file()
    assert run("estimate", capture, "--model", "lambert")[0] == 0
    assert (capture / "matest-predict-ball" / "00.exr").is_file()


def test_a_prediction_without_pictures_is_its_radiance_and_errors(run: Run, capture: Path, tmp_path: Path) -> None:
    assert run("estimate", capture, "--model", "lambert", "--pictures", "none")[0] == 0
    assert run("predict", capture / "matest", capture, "-o", tmp_path / "out", "--pictures", "none")[0] == 0
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"00.exr", "01.exr", "02.exr", "profile.csv", "prediction.json"}


def test_a_folder_of_results_is_refused_with_their_names(run: Run, made: Path, tmp_path: Path) -> None:
    for name in ("vase", "ball"):
        (tmp_path / "results" / name).mkdir(parents=True)
        (tmp_path / "results" / name / "material.json").touch()
    code, _, err = run("predict", tmp_path / "results", made)
    assert (code, "it holds those of ball, vase: name one" in err) == (2, True)


def test_a_material_of_other_channels_is_refused(run: Run, capture: Path, tmp_path: Path) -> None:
    grey = scenes.material("lambert", albedo=0.5)
    lights = scenes.distant(scenes.LIGHTS[:2])
    scenes.write(tmp_path / "grey", grey, scenes.sphere(64), lights)
    simulate(tmp_path / "grey")
    assert run("estimate", capture, "--model", "lambert")[0] == 0
    code, _, err = run("predict", capture / "matest", tmp_path / "grey")
    assert code == 2
    assert "1 channel" in err


def test_a_result_with_maps_shades_every_pixel_with_its_own_value(run: Run, capture: Path, tmp_path: Path) -> None:
    assert run("estimate", capture, "--model", "oren-nayar", "--maps", "albedo", "-o", tmp_path / "result")[0] == 0
    code, out, err = run("predict", tmp_path / "result", capture, "-o", tmp_path / "out")
    assert (code, err) == (0, "")
    assert "Every pixel is shaded with its own albedo; " in " ".join(out.split())
    assert json.loads((tmp_path / "out" / "prediction.json").read_text("utf-8"))["maps"] == ["albedo"]
    code, out, _ = run("predict", tmp_path / "result", capture, "-o", tmp_path / "out", "--json")
    assert {*json.loads(out)["median_error"]} == {"00.png", "01.png", "02.png"}
    material = matest.with_maps(
        matest.load_material(tmp_path / "result"),
        matest.load_maps(tmp_path / "result", matest.load_capture(capture).scene.surface),
    )
    images, errors = matest.predict(material, matest.load_capture(capture))
    np.testing.assert_allclose(read_image(tmp_path / "out" / "02.exr"), images[2], rtol=1e-5, atol=1e-7)
    assert [*json.loads(out)["relative_rmse"].values()] == pytest.approx(errors)


def test_of_another_view_the_means_are_used_and_a_note_says_so(run: Run, capture: Path, tmp_path: Path) -> None:
    assert run("estimate", capture, "--model", "oren-nayar", "--maps", "albedo", "-o", tmp_path / "result")[0] == 0
    parts = scenes.material("oren-nayar", albedo=[0.6, 0.5, 0.4], sigma=0.4), scenes.sphere(48), scenes.noise()
    scenes.write(tmp_path / "other", *parts, scenes.distant(scenes.LIGHTS[3:5]))
    simulate(tmp_path / "other")
    code, out, err = run("predict", tmp_path / "result", tmp_path / "other", "-o", tmp_path / "out")
    assert code == 0
    assert "images of 64×64 pixels, and these have 48×48. Maps belong to the view" in err
    assert "their means are used" in err
    assert "with its own" not in out
    assert json.loads((tmp_path / "out" / "prediction.json").read_text("utf-8"))["maps"] == []


def test_under_ambient_light_a_shape_has_its_own_value_too(run: Run, capture: Path, tmp_path: Path) -> None:
    result = tmp_path / "result"
    assert run("estimate", capture, "--model", "oren-nayar", "--maps", "albedo", "-o", result)[0] == 0
    for kind in (".exr", "_std.exr", "_status.png"):
        # Of a map of the albedo one of a shape is made: a roughness of one channel.
        image = read_image(result / "maps" / f"albedo{kind}")[..., :1]
        write_image(result / "maps" / f"sigma{kind}", image if image.dtype == np.float32 else image[..., 0])
    described = (capture / "capture.toml").read_text("utf-8")
    (capture / "capture.toml").write_text(described.replace("[[image]]", "[[image]]\nambient = [0.1, 0.1, 0.1]"))
    code, out, err = run("predict", result, capture, "-o", tmp_path / "out")
    assert (code, err) == (0, "")
    assert "its own albedo and sigma" in " ".join(out.split())


def test_a_table_of_a_result_with_maps_is_of_their_means(run: Run, capture: Path, tmp_path: Path) -> None:
    assert run("estimate", capture, "--model", "lambert", "--maps", "albedo", "-o", tmp_path / "result")[0] == 0
    code, _, err = run("export", tmp_path / "result", "--to", "merl")
    assert code == 0
    assert "a table is of one reflectance: what was written has their means" in err
