"""`matest predict` as people and scripts use it."""

from __future__ import annotations

from pathlib import Path

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


def test_a_material_of_other_channels_is_refused(run: Run, capture: Path, tmp_path: Path) -> None:
    grey = scenes.material("lambert", albedo=0.5)
    lights = scenes.distant(scenes.LIGHTS[:2])
    scenes.write(tmp_path / "grey", grey, scenes.sphere(64), lights)
    simulate(tmp_path / "grey")
    assert run("estimate", capture, "--model", "lambert")[0] == 0
    code, _, err = run("predict", capture / "matest", tmp_path / "grey")
    assert code == 2
    assert "1 channel" in err
