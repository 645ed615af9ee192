"""`matest lights` as people and scripts use it."""

from __future__ import annotations

import json
import math
import os
import shutil
import sys
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.captures import put_image
from tests.commands.conftest import Run
from tests.lights import matte_ball
from tests.lights.mirror_ball import Ball, Lamp, degrees_between, unit
from tests.shared_data import measurement

LIGHTS = [unit(0.4, 0.1, 0.8), unit(-0.3, 0.5, 0.8), unit(0.1, -0.4, 0.9)]
BALL = Ball(160, (81.0, 79.0, 70.0))


@pytest.fixture
def chrome(tmp_path: Path) -> Path:
    """Photographs of a mirror ball under three lights, and its mask."""
    folder = tmp_path / "chrome"
    folder.mkdir()
    for number, light in enumerate(LIGHTS):
        image = BALL.photograph([Lamp(light, math.radians(4), 3)], noise=0.002, seed=number)
        put_image(folder / f"{number:02d}.png", np.round(255 * image).astype(np.uint8))
    put_image(folder / "mask.png", np.round(255 * BALL.mask()).astype(np.uint8))
    return folder


def directions(out: str) -> np.ndarray:
    return np.array([light["direction"] for light in json.loads(out)["lights"]])


def test_lights_go_to_a_list_and_to_tables_of_a_capture(run: Run, chrome: Path, tmp_path: Path) -> None:
    code, out, err = run("lights", chrome, "-o", tmp_path / "out.lp")
    assert (code, err) == (0, "")
    assert "01.png" in out
    rows = (tmp_path / "out.lp").read_text("utf-8").splitlines()
    assert rows[0] == "3"
    listed = np.array([row.split()[1:] for row in rows[1:]], dtype=float)
    assert degrees_between(listed, LIGHTS).max() < 0.3
    tables = tomllib.loads((tmp_path / "out.toml").read_text("utf-8"))
    assert 0 < tables["uncertainty"]["direction"] < 0.01
    assert [image["file"] for image in tables["image"]] == ["00.png", "01.png", "02.png"]


def test_json_holds_lights_spheres_and_errors(run: Run, chrome: Path, tmp_path: Path) -> None:
    code, out, _ = run("lights", chrome, chrome, "-o", tmp_path / "out.lp", "--json")
    record = json.loads(out)
    assert code == 0
    assert record["schema"] == "matest.lights/1"
    assert record["spheres"][1]["circle"] == pytest.approx(BALL.circle, abs=0.05)
    light = record["lights"][0]
    assert light["apart"] == 0
    assert 0 < light["std"] < 0.01
    assert light["position"] is None
    assert len(light["highlights"]) == 2
    assert record["files"] == [str(tmp_path / "out.lp"), str(tmp_path / "out.toml")]


def test_two_spheres_give_positions(run: Run, tmp_path: Path) -> None:
    places, at = ((-0.15, 0.02, -1.3), (0.15, -0.05, -1.3)), (0.35, 0.4, -0.5)
    balls = [Ball(300, fov=0.5, centre=place, radius=0.12) for place in places]
    for name, ball in zip("ab", balls, strict=True):
        (tmp_path / name).mkdir()
        image = ball.photograph([Lamp(at, math.radians(2), 5)], at=at)
        put_image(tmp_path / name / "0.png", np.round(255 * image).astype(np.uint8))
        put_image(tmp_path / name / "mask.png", np.round(255 * ball.mask()).astype(np.uint8))
    arguments = ("lights", tmp_path / "a", tmp_path / "b", "--fov-y", 0.5, "--radius", 0.12, "-o", tmp_path / "out.lp")
    code, out, _ = run(*arguments, "--json")
    assert code == 0
    # The camera of a plain folder is one unit before the origin.
    np.testing.assert_allclose(json.loads(out)["lights"][0]["position"], np.add(at, (0, 0, 1)), atol=0.03)
    assert "position = [" in (tmp_path / "out.toml").read_text("utf-8")
    assert "position" in run(*arguments)[1]


@pytest.fixture
def grey(tmp_path: Path) -> Path:
    """Photographs of a matte ball under the lights of `LIGHTS`, whose strengths are 1, 2 and 3."""
    folder = tmp_path / "grey"
    folder.mkdir()
    for number, light in enumerate(LIGHTS):
        image = matte_ball.photograph(np.array(light), np.array([1.0, 1.1, 0.9]) * (number + 1), noise=0.002)
        put_image(folder / f"{number:02d}.png", image)
    return folder


def test_a_matte_sphere_tells_how_strong_the_lights_are(run: Run, chrome: Path, grey: Path, tmp_path: Path) -> None:
    circle = ",".join(map(str, matte_ball.CIRCLE))
    arguments = ("lights", chrome, "--diffuse", grey, "--diffuse-circle", circle, "-o", tmp_path / "out.lp")
    code, out, _ = run(*arguments, "--json")
    assert code == 0
    record = json.loads(out)
    power = np.array([light["power"] for light in record["lights"]])
    np.testing.assert_allclose(power / power[0], [[1.0] * 3, [2.0] * 3, [3.0] * 3], rtol=0.02)
    np.testing.assert_allclose(power[0] / power[0, 0], [1.0, 1.1, 0.9], rtol=0.01)
    assert 0 < record["uncertainty"]["intensity"] < 0.04
    tables = tomllib.loads((tmp_path / "out.toml").read_text("utf-8"))
    assert len(tables["image"][0]["lights"][0]["irradiance"]) == 3
    assert tables["encoding"]["radiometry"] == "relative"
    # The circle is seen without being stated.
    assert run("lights", chrome, "--diffuse", grey, "-o", tmp_path / "out.lp")[0] == 0


def test_a_white_target_tells_how_strong_the_lights_are(run: Run, chrome: Path, tmp_path: Path) -> None:
    folder = tmp_path / "white"
    folder.mkdir()
    for number, light in enumerate(LIGHTS):
        level = 0.2 * (number + 1) * light[2] * np.array([1.0, 1.1, 0.9])
        put_image(folder / f"{number:02d}.png", np.round(65535 * np.broadcast_to(level, (32, 40, 3))).astype(np.uint16))
    arguments = ("lights", chrome, "--white", folder, "--white-normal", "0,0,1", "-o", tmp_path / "out.lp")
    code, out, err = run(*arguments, "--json")
    assert (code, err) == (0, "")
    record = json.loads(out)
    power = np.array([light["power"] for light in record["lights"]])
    np.testing.assert_allclose(power / power[0], [[1.0] * 3, [2.0] * 3, [3.0] * 3], rtol=0.01)
    np.testing.assert_allclose(power[0] / power[0, 0], [1.0, 1.1, 0.9], rtol=1e-3)
    assert record["white"]["normal"] == [0, 0, 1]
    assert record["matte"] is None
    assert "irradiance" in (tmp_path / "out.toml").read_text("utf-8")
    assert "green" in run(*arguments)[1]


def test_a_light_that_is_not_clipped_has_a_solid_angle(run: Run, tmp_path: Path) -> None:
    folder = tmp_path / "dark"
    folder.mkdir()
    for number, light in enumerate(LIGHTS):
        image = BALL.photograph([Lamp(light, math.radians(6), 0.8)], noise=0.002, seed=number)
        put_image(folder / f"{number:02d}.png", np.round(255 * image).astype(np.uint8))
    code, out, _ = run("lights", folder, "--circle", "81,79,70", "-o", tmp_path / "out.lp", "--json")
    assert code == 0
    true = 2 * math.pi * (1 - math.cos(math.radians(6)))
    for light in json.loads(out)["lights"]:
        assert light["extent"]["solid_angle"] == pytest.approx(true, abs=3 * light["extent"]["std"])
    tables = tomllib.loads((tmp_path / "out.toml").read_text("utf-8"))
    stated = {image["lights"][0]["solid_angle"] for image in tables["image"]}
    # Lights that are alike have one in common, as mirror-like models need it.
    assert len(stated) == 1
    assert stated.pop() == pytest.approx(true, rel=0.03)


def test_tables_of_lights_fit_an_eighty_column_terminal(
    run: Run, chrome: Path, grey: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    (tmp_path / "light_directions.txt").write_text("0.4 0.1 0.8\n-0.3 0.5 0.8\n0.1 -0.4 0.9\n")
    against = ["--against", tmp_path / "light_directions.txt"]
    for captures in ([chrome], [chrome, chrome], [chrome, "--diffuse", grey], [chrome, *against]):
        _, out, _ = run("lights", *captures, "-o", tmp_path / "out.lp")
        assert max(len(line.rstrip()) for line in out.splitlines() if str(tmp_path) not in line) <= 80


def test_another_list_is_compared_with_what_was_found(run: Run, chrome: Path, tmp_path: Path) -> None:
    swapped = tmp_path / "other.lp"
    rows = [f"{name} {' '.join(map(str, LIGHTS[k]))}" for name, k in (("00.png", 1), ("01.png", 0), ("02.png", 2))]
    swapped.write_text("\n".join(["3", *rows]))
    code, out, err = run("lights", chrome, "-o", tmp_path / "out.lp", "--against", swapped)
    assert (code, err) == (0, "")
    words = " ".join(out.split())
    # A long path is folded.
    assert f"Against{swapped},pairedbyname:median" in "".join(out.split())
    assert "in another order the list fits better, median 0.0" in words
    assert "00.png the light of 01.png, 01.png the light of 00.png." in words
    code, _, err = run("lights", chrome, "-o", swapped, "--against", swapped)
    assert code == 2
    assert swapped.read_text().startswith("3\n00.png")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--white-normal", "0,0,1"), "--white-normal is that of --white FOLDER"),
        (("--white", ".", "--white-normal", "0,0,0"), "--white-normal takes a direction X,Y,Z"),
        (("--white", ".", "--diffuse", "."), "--white and --diffuse both measure how strong"),
        (("--white", "missing"), "missing: no such folder; give one with photographs"),
        (("--against", "none.lp"), "none.lp: no such list of lights; give a .lp"),
        (("--circle", "1,2"), "--circle takes X,Y,R in pixels"),
        (("--centre", "1,2,3"), "--centre needs --radius"),
        (("--diffuse-circle", "1,2,3"), "--diffuse-circle is that of --diffuse FOLDER"),
        (("--radius", "1"), "from two spheres or more"),
        (("-o", "missing/lights.lp"), "missing/lights.lp: expected the name of a light list"),
        (("-o", "lights.toml"), "lights.toml: expected the name of a light list"),
    ],
)
def test_options_that_make_no_sense_are_refused(
    run: Run, chrome: Path, arguments: tuple[str, ...], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(chrome.parent)
    code, out, err = run("lights", chrome, *arguments)
    assert (code, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1


def test_captures_of_different_lengths_and_dark_images_are_refused(run: Run, chrome: Path, tmp_path: Path) -> None:
    other = Path(shutil.copytree(chrome, tmp_path / "other"))
    put_image(other / "03.png", np.zeros((160, 160), np.uint8))
    code, _, err = run("lights", chrome, other, "-o", tmp_path / "out.lp")
    assert code == 2
    assert f"{other}: expected as many photographs as in {chrome}, 3" in err
    code, _, err = run("lights", other, "-o", tmp_path / "out.lp")
    assert code == 2
    assert f"{other / '03.png'}: no highlight on the sphere" in err
    assert not (tmp_path / "out.lp").exists()


def test_the_capture_file_is_not_overwritten(run: Run, chrome: Path) -> None:
    text = 'mask = "mask.png"\n[geometry]\nshape = "sphere"\n[[image]]\nfile = "00.png"\n'
    (chrome / "capture.toml").write_text(text)
    code, _, err = run("lights", chrome, "-o", chrome / "capture.lp")
    assert code == 2
    assert "would be overwritten" in err
    assert (chrome / "capture.toml").read_text() == text


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are bytes on Linux")
def test_photographs_whose_names_are_no_text_are_listed(run: Run, chrome: Path, tmp_path: Path) -> None:
    (chrome / "00.png").rename(chrome / os.fsdecode(b"\xff.png"))
    assert run("lights", chrome, "-o", tmp_path / "out.lp")[0] == 0
    assert b"\xff.png 0." in (tmp_path / "out.lp").read_bytes()
    assert len(tomllib.loads((tmp_path / "out.toml").read_text("utf-8"))["image"]) == 3


def test_a_real_mirror_sphere_gives_lights_near_the_published_ones(run: Run, tmp_path: Path) -> None:
    folder = measurement("chrome_sphere", "mask.png").parent
    published = measurement("gray_sphere", "capture.toml")
    code, out, _ = run("lights", folder, "-o", tmp_path / "out.lp", "--against", published, "--json")
    assert code == 0
    against = json.loads(out)["against"]
    stated = [image["lights"][0]["direction"] for image in tomllib.loads(published.read_text("utf-8"))["image"]]
    assert np.degrees(against["angles"]) == pytest.approx(degrees_between(directions(out), stated), abs=1e-5)
    # The list is known to a few degrees.
    assert math.degrees(against["median"]) < 3
    assert math.degrees(against["worst"]) < 10
    assert against["by_name"]
    assert against["order"] == [*range(12)]


def test_a_mask_that_is_a_pixel_smaller_changes_lights_by_less_than_half_a_degree(run: Run, tmp_path: Path) -> None:
    folder = measurement("chrome_sphere", "mask.png").parent
    copy = tmp_path / "copy"
    copy.mkdir()
    for file in folder.iterdir():
        shutil.copyfile(file, copy / file.name)
    mask = cv2.imread(str(copy / "mask.png"), cv2.IMREAD_UNCHANGED)
    put_image(copy / "mask.png", cv2.erode(mask, np.ones((3, 3), np.uint8)))
    found = [directions(run("lights", one, "-o", tmp_path / "out.lp", "--json")[1]) for one in (folder, copy)]
    assert degrees_between(*found).max() < 0.5


def test_two_real_mirror_spheres_see_the_same_lights(run: Run, tmp_path: Path) -> None:
    probes = [measurement(f"psbox_chrome/{name}", "circle_data.txt").parent for name in ("probe1", "probe2")]
    code, out, _ = run("lights", *probes, "-o", tmp_path / "out.lp", "--json")
    assert code == 0
    apart = np.degrees([light["apart"] for light in json.loads(out)["lights"]])
    assert np.median(apart) < 1
    assert apart.max() < 1.5
