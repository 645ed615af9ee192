"""`matest check` as people and scripts use it."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from tests import scenes
from tests.commands.conftest import Run

PLANNED = """[geometry]
shape = "sphere"
centre = [24, 24]
radius = 21
[camera]
resolution = [48, 48]
[[image]]
file = "later.png"
lights = [ { direction = [0, 0, 1], irradiance = 3.0 } ]
"""


@pytest.fixture
def run(run: Run, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run `matest check ARGUMENTS` at eighty columns."""
    monkeypatch.setenv("COLUMNS", "80")
    return partial(run, "check")


@pytest.fixture
def planned(tmp_path: Path) -> Path:
    """A capture whose photograph has not been taken."""
    (tmp_path / "capture.toml").write_text(PLANNED, "utf-8")
    return tmp_path


def test_photographs_not_yet_taken_are_checked(run: Run, planned: Path) -> None:
    code, out, err = run(planned, "--model", "cook-torrance")
    assert (code, err) == (0, "")
    told = " ".join(out.split())
    assert "f0 and specular appear only as a product here" in told
    assert "Next light: direction = [" in told
    assert "typical camera" in told
    assert "No model was named" not in told
    assert max(len(line) for line in out.splitlines()) <= 80


def test_a_check_begins_with_how_the_files_are_read(run: Run, planned: Path) -> None:
    out = run(planned, "--model", "oren-nayar")[1]
    assert out.index("how it is read") < out.index("standard error")
    understood = json.loads(run(planned, "--model", "oren-nayar", "--json")[1])["understood"]
    assert understood["read from"] == "capture.toml"
    assert {"axes", "transfer", "units", "lights", "scale"} < {*understood}


def test_a_check_without_a_model_says_which_one_it_takes(run: Run, planned: Path) -> None:
    out = run(planned)[1]
    assert "No model was named: oren-nayar+cook-torrance is the largest" in " ".join(out.split())


def test_sums_with_long_names_fit_eighty_columns(run: Run, planned: Path) -> None:
    code, out, _ = run(planned)
    assert code == 0
    assert "cook-torrance.specular" in out
    assert max(len(line) for line in out.splitlines()) <= 80


def test_json_holds_the_whole_check(run: Run, planned: Path) -> None:
    code, out, _ = run(planned, "--model", "oren-nayar", "--at", "sigma=0.4", "--noise", "0.004,0", "--json")
    assert code == 0
    content = json.loads(out)
    assert content["schema"] == "matest.check/1"
    assert content["parameters"]["sigma"]["value"] == pytest.approx(0.4)
    assert content["noise"]["read"] == pytest.approx(0.004, rel=1e-3)
    light = content["light"]
    assert np.linalg.norm(light["direction"]) == pytest.approx(1)
    x, y, z = light["direction"]
    assert light["from_camera"] == pytest.approx(np.arccos(z))
    if light["from_camera"] > 0.01:
        assert light["azimuth"] == pytest.approx(np.arctan2(y, x))
    assert light["std"]["sigma"] < content["parameters"]["sigma"]["std"]


def test_stated_errors_of_the_calibration_widen_the_predicted_ones(run: Run, planned: Path) -> None:
    (planned / "capture.toml").write_text(PLANNED + "[uncertainty]\nradius = 0.5\n", "utf-8")
    arguments = (planned, "--model", "oren-nayar", "--at", "sigma=0.4")
    code, out, _ = run(*arguments, "--uncertainty", "direction=0.01")
    assert code == 0
    assert max(len(line) for line in out.splitlines()) <= 80
    told = " ".join(out.split())
    assert "What errors of the calibration would do" in told
    assert "from radius (0.5 px): known to" in told
    content = json.loads(run(*arguments, "--uncertainty", "direction=0.01", "--json")[1])
    sigma = content["parameters"]["sigma"]
    assert sigma["noise_std"] < 0.5 * sigma["std"]
    assert content["limits"][0]["family"] == "radius"
    assert [name for name, error in content["calibration"].items() if error["stated"]] == ["radius", "direction"]
    ambient = content["calibration"]["ambient"]
    assert (ambient["size"], ambient["unit"], ambient["stated"]) == (0.01, "1", False)
    assert ambient["adds"]["sigma"] == pytest.approx(0.4 * ambient["relative"]["sigma"])


def test_what_each_number_of_photographs_allows_of_maps_fits_eighty_columns(run: Run, tmp_path: Path) -> None:
    material = scenes.material("oren-nayar", albedo=0.6, sigma=0.45)
    file = scenes.write(tmp_path, material, scenes.sphere(48), scenes.noise(), scenes.distant(scenes.LIGHTS[:3]))
    code, out, err = run(file, "--maps", "albedo,sigma")
    assert (code, err) == (0, "")
    assert max(len(line) for line in out.splitlines()) <= 80
    told = " ".join(out.split())
    assert "One photograph tells albedo at" in told
    assert "for a given sigma, which it does not tell" in told
    rows = json.loads(run(file, "--maps", "albedo,sigma", "--json")[1])["maps"]["photographs"]
    assert [len(row["images"]) for row in rows] == [1, 2, 3]
    assert rows[0]["maps"]["sigma"]["known"] == 0
    assert rows[-1]["maps"]["albedo"]["known"] > 0.95 * rows[-1]["lit"]
    assert json.loads(run(file, "--json")[1])["maps"] is None


def test_a_scene_brings_its_own_model_and_values(run: Run, tmp_path: Path) -> None:
    material = scenes.material("oren-nayar", albedo=0.6, sigma=0.45)
    file = scenes.write(tmp_path, material, scenes.sphere(48), scenes.noise(), scenes.distant(scenes.LIGHTS[:2]))
    content = json.loads(run(file, "--json")[1])
    assert content["model"] == "oren-nayar"
    assert content["parameters"]["sigma"]["value"] == pytest.approx(0.45)
    assert content["levels"] == {}
    other = json.loads(run(file, "--model", "lambert", "--json")[1])
    assert any("another model" in warning for warning in other["warnings"])


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--model", "oren-nayer"), "did you mean 'oren-nayar'?"),
        (("--model", "oren-nayar", "--at", "sigma=40"), "radians"),
        (("--model", "oren-nayar", "--at", "sigma=wide"), "--at sigma must be a number"),
        (("--noise", "0.1"), "READ,GAIN"),
        (("--uncertainty", "radios=1"), "--uncertainty: unknown uncertainty 'radios'"),
        (("--uncertainty", "direction=1"), "1° is 0.0175 rad"),
        (("--noise", "0,0"), "both zero"),
        (("--model", "oren-nayar", "--maps", "gloss"), "--maps gloss: oren-nayar estimates no such parameter"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(run: Run, planned: Path, options: tuple[str, ...], expected: str) -> None:
    code, out, err = run(planned, *options)
    assert code == 2
    assert out == ""
    assert expected in err
    assert err.count("\n") == 1


def test_a_capture_of_which_a_photograph_is_missing_is_refused(run: Run, planned: Path) -> None:
    (planned / "capture.toml").write_text(PLANNED + '[[image]]\nfile = "there.npy"\n', "utf-8")
    np.save(planned / "there.npy", np.ones((48, 48, 1), np.float32))
    code, _, err = run(planned)
    assert code == 2
    assert "later.png" in err


def test_a_plan_that_does_not_say_how_large_its_images_are_is_refused(run: Run, planned: Path) -> None:
    (planned / "capture.toml").write_text(PLANNED.replace("resolution = [48, 48]", ""), "utf-8")
    code, _, err = run(planned)
    assert code == 2
    assert "resolution" in err
