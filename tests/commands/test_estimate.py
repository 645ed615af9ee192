"""`matest estimate` as people and scripts use it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests import scenes
from tests.commands.conftest import Run

ROOT = Path(__file__).parents[2]


def edit(folder: Path, old: str, new: str) -> None:
    file = folder / "capture.toml"
    text = file.read_text("utf-8")
    assert old in text
    file.write_text(text.replace(old, new, 1), "utf-8")


def test_estimate_writes_a_complete_result_folder(run: Run, capture: Path) -> None:
    code, out, _ = run("estimate", capture, "--model", "oren-nayar")
    assert code == 0
    assert "sigma" in out
    assert "degrees" in out
    result = capture / "matest"
    content = json.loads((result / "result.json").read_text("utf-8"))
    assert content["schema"] == "matest.estimate/1"
    assert content["model"] == "oren-nayar"
    assert set(content["provenance"]["inputs"]) == {"00.png", "01.png", "02.png", "mask.png", "capture.toml"}
    expected = {"schema", "capture", "model", "parameters", "correlation", "fit", "candidates", "skipped", "timing_s"}
    assert expected | {"provenance", "warnings"} <= set(content)
    for name in ("report.html", "material.json", "profile.csv", "images/00_render.png", "images/02_residual.png"):
        assert (result / name).stat().st_size > 0
    skipped = content["skipped"]["samples"]
    assert sum(skipped.values()) + content["fit"]["samples"] == 3 * 64 * 64


def test_each_of_several_objects_has_its_result_or_says_why_not(run: Run, tmp_path: Path) -> None:
    ball = '[[object]]\nname = "{}"\nposition = {}\nshape = "sphere"\nradius = 0.4\nmaterial.model = "lambert"\n'
    camera = "[camera]\nheight = 2\nresolution = [32, 32]\n"
    objects = ball.format("here", [0, 0, 0]) + ball.format("far", [50, 0, 0])
    scene = scenes.write(tmp_path / "scene", objects, camera, scenes.distant(scenes.LIGHTS[:2]))
    assert run("render", scene, "-o", tmp_path / "cap")[0] == 0
    code, out, err = run("estimate", tmp_path / "cap", "--model", "lambert", "--json")
    here, far = json.loads(out).values()
    assert here["model"] == "lambert"
    assert (code, err) == (2, f"matest: {far['error']}\n")
    assert "far" in far["error"]
    assert (tmp_path / "cap" / "matest" / "here" / "result.json").is_file()
    assert not (tmp_path / "cap" / "matest" / "far").exists()


def test_pictures_are_drawn_as_asked(run: Run, capture: Path) -> None:
    for size, expected in (("preview", True), ("full", True), ("none", False)):
        assert run("estimate", capture, "--model", "lambert", "--pictures", size)[0] == 0
        assert (capture / "matest" / "images" / "00_render.png").is_file() == expected
        assert (capture / "matest" / "report.html").is_file()
    code, _, err = run("estimate", capture, "--pictures", "large")
    assert code == 2
    assert "preview" in err


def test_json_on_standard_output_is_the_result_file(run: Run, capture: Path) -> None:
    code, out, err = run("estimate", capture, "--model", "lambert", "--json")
    assert code == 0
    assert err == ""
    assert json.loads(out) == json.loads((capture / "matest" / "result.json").read_text("utf-8"))


def test_several_captures_go_to_folders_of_their_names(run: Run, capture: Path, tmp_path: Path) -> None:
    other = Path(shutil.copytree(capture, tmp_path / "other"))
    code, out, _ = run("estimate", capture, other, "--model", "lambert", "-o", tmp_path / "out")
    assert code == 0
    assert (tmp_path / "out" / "ball" / "result.json").is_file()
    assert (tmp_path / "out" / "other" / "result.json").is_file()
    assert "rms error" in out
    assert "2 captures: 2 converged." in out


def test_a_bad_capture_among_several_does_not_stop_the_others(run: Run, capture: Path, tmp_path: Path) -> None:
    other = Path(shutil.copytree(capture, tmp_path / "other"))
    (other / "01.png").unlink()
    code, _, err = run("estimate", other, capture, "--model", "lambert", "-o", tmp_path / "out")
    assert code == 2
    assert "01.png" in err
    assert (tmp_path / "out" / "ball" / "result.json").is_file()


def spoil_missing(folder: Path) -> None:
    (folder / "01.png").unlink()


def spoil_truncated(folder: Path) -> None:
    data = (folder / "01.png").read_bytes()
    (folder / "01.png").write_bytes(data[: len(data) // 2])


def spoil_unreadable(folder: Path) -> None:
    (folder / "01.png").write_bytes(b"no image at all" * 100 + b"IEND\xaeB`\x82")


def spoil_size(folder: Path) -> None:
    cv2.imwrite(str(folder / "mask.png"), np.full((32, 64), 255, np.uint8))


def spoil_no_light(folder: Path) -> None:
    text = (folder / "capture.toml").read_text("utf-8")
    lines = ["direction = [0.0, 0.0, -1.0]" if line.startswith("direction") else line for line in text.splitlines()]
    (folder / "capture.toml").write_text("\n".join(lines), "utf-8")


SPOILS = {
    "missing image": (spoil_missing, ("01.png", "no such file")),
    "truncated image": (spoil_truncated, ("01.png", "truncated")),
    "unreadable image": (spoil_unreadable, ("01.png", "cannot be read")),
    "other size": (spoil_size, ("mask.png", "64×64", "32×64")),
    "no transfer": (lambda f: edit(f, 'transfer = "linear"', ""), ("capture.toml", "transfer", "--transfer")),
    "zero light": (
        lambda f: edit(f, "direction = [0.1, 0.2, 0.97]", "direction = [0.0, 0.0, 0.0]"),
        ("capture.toml", "image 0", "direction"),
    ),
    "NaN light": (
        lambda f: edit(f, "direction = [0.1, 0.2, 0.97]", "direction = [nan, 0.0, 1.0]"),
        ("capture.toml", "direction"),
    ),
    "no lit pixel": (spoil_no_light, ("no lit pixel", "direction")),
    "outside": (lambda f: edit(f, 'file = "00.png"', 'file = "../00.png"'), ("../00.png", "outside")),
    "typo": (lambda f: edit(f, "exposure", "expsure"), ("capture.toml", "expsure", "exposure")),
}


@pytest.mark.parametrize("case", SPOILS)
def test_bad_input_gets_one_sentence_exit_2_and_leaves_nothing(
    run: Run, capture: Path, tmp_path: Path, case: str
) -> None:
    edit(capture, "[[image]]\n", "[[image]]\nexposure = 1.0\n")
    spoil, words = SPOILS[case]
    spoil(capture)
    before = sorted(tmp_path.rglob("*"))
    code, out, err = run("estimate", capture, "--model", "oren-nayar")
    assert code == 2
    assert out == ""
    assert len(err.strip().splitlines()) == 1
    assert "Traceback" not in err
    for word in words:
        assert word in err
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--model", "orennayar"), ("orennayar", "did you mean 'oren-nayar'?")),
        (("--model", "oren-nayar", "--fix", "sigmma=0.3"), ("sigmma", "did you mean 'sigma'?")),
        (("--model", "oren-nayar", "--fix", "sigma=40"), ("sigma", "radians")),
        (("--model", "oren-nayar", "--free", "slope"), ("slope",)),
        (("--model", "oren-nayar", "--holdout", "7"), ("7", "0 to 2")),
        (("--refine", ""), ("--refine: it names no errors",)),
        (("--refine", "shfit"), ("--refine: unknown uncertainty",)),
        (("--uncertainty", "direction=0.5"), ("--uncertainty: direction", "0.5° is 0.00873 rad.")),
        (("--uncertainty", "direction"), ("--uncertainty", "NAME=VALUE")),
        (("--model", "oren-nayar", "--holdout", "0,1,2"), ("at least one",)),
        (("--transfer", "rec709"), ("rec709", "srgb")),
        (("--device", "cuda:9"), ("cuda:9", "cpu")),
    ],
)
def test_bad_options_get_one_sentence_and_exit_2(run: Run, capture: Path, arguments: tuple, words: tuple) -> None:
    code, _, err = run("estimate", capture, *arguments)
    assert code == 2
    assert len(err.strip().splitlines()) == 1
    for word in words:
        assert word in err
    assert not (capture / "matest").exists()


def test_a_folder_that_is_no_result_is_not_replaced(run: Run, capture: Path, tmp_path: Path) -> None:
    precious = tmp_path / "precious"
    precious.mkdir()
    (precious / "thesis.txt").write_text("years of work", "utf-8")
    code, _, err = run("estimate", capture, "--model", "lambert", "-o", precious)
    assert code == 2
    assert "precious" in err
    assert (precious / "thesis.txt").read_text("utf-8") == "years of work"


def test_an_earlier_result_is_replaced_whole(run: Run, capture: Path) -> None:
    run("estimate", capture, "--model", "lambert")
    (capture / "matest" / "images" / "99_render.png").touch()
    assert run("estimate", capture, "--model", "oren-nayar")[0] == 0
    assert not (capture / "matest" / "images" / "99_render.png").exists()
    assert [p.name for p in capture.iterdir() if p.name.startswith(".")] == []


@pytest.mark.parametrize("marker", ["{}", '{"schema": "matest.estimate/1"}'])
def test_a_folder_with_other_things_in_it_is_not_an_earlier_result(run: Run, capture: Path, marker: str) -> None:
    result = capture / "matest"
    result.mkdir()
    (result / "result.json").write_text(marker, "utf-8")
    (result / "notes.txt").write_text("mine", "utf-8")
    code, _, err = run("estimate", capture, "--model", "lambert")
    assert code == 2
    assert "would be replaced" in err
    assert (result / "notes.txt").read_text("utf-8") == "mine"


@pytest.mark.parametrize("name", ["images/mine.png", "maps/notes.txt", "99.exr", "images/deep/00_photo.png"])
def test_own_files_in_an_earlier_result_stay(run: Run, capture: Path, name: str) -> None:
    run("estimate", capture, "--model", "lambert")
    mine = capture / "matest" / name
    mine.parent.mkdir(parents=True, exist_ok=True)
    mine.write_text("mine", "utf-8")
    code, _, err = run("estimate", capture, "--model", "lambert")
    assert code == 2
    assert "holds what matest did not write" in err
    assert mine.read_text("utf-8") == "mine"


def test_a_result_with_maps_is_replaced_by_one_without(run: Run, capture: Path) -> None:
    run("estimate", capture, "--model", "lambert", "--maps", "albedo", "--smooth-maps", "2")
    assert run("estimate", capture, "--model", "lambert")[0] == 0
    assert not (capture / "matest" / "maps").exists()


def test_a_link_to_the_place_of_a_result_stays_a_link(run: Run, capture: Path, tmp_path: Path) -> None:
    (tmp_path / "out").symlink_to("disk")
    for _ in range(2):
        assert run("estimate", capture, "--model", "lambert", "-o", tmp_path / "out")[0] == 0
        assert (tmp_path / "out").is_symlink()
        assert (tmp_path / "disk" / "result.json").is_file()
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


def test_a_place_whose_name_is_no_text_takes_a_result(run: Run, capture: Path, tmp_path: Path) -> None:
    assert run("estimate", capture, "--model", "lambert", "-o", os.fsdecode(bytes(tmp_path) + b"/o\xff"))[0] == 0


def test_links_out_of_a_capture_are_followed_only_where_it_is_allowed(run: Run, capture: Path, tmp_path: Path) -> None:
    (capture / "00.png").rename(tmp_path / "00.png")
    (capture / "00.png").symlink_to("../00.png")
    code, _, err = run("estimate", capture, "--model", "lambert")
    assert code == 2
    assert "leads outside" in err
    assert "by a link" in err
    assert run("estimate", capture, "--model", "lambert", "--allow-outside")[0] == 0


def test_paths_with_dots_in_them_are_the_paths_they_lead_to(run: Run, capture: Path, tmp_path: Path) -> None:
    code, _, err = run("estimate", capture / ".." / "ball", "--model", "lambert", "-o", tmp_path / "out")
    assert (code, err) == (0, "")


def test_a_constraint_narrows_what_auto_tries(run: Run, capture: Path) -> None:
    code, out, _ = run("estimate", capture, "--fix", "sigma=0.4", "--json")
    assert code == 0
    content = json.loads(out)
    tried = [candidate["model"] for candidate in content["candidates"]]
    assert tried == ["oren-nayar"]
    untried = [warning for warning in content["warnings"] if warning.startswith("Not tried")]
    assert all(model in untried[0] for model in ("lambert, ", "cook-torrance(fresnel=schlick,diffuse=0)"))


def test_real_photographs_give_honest_error_bars(run: Run, tmp_path: Path) -> None:
    data = ROOT.parent / "shared" / "data" / "gray_sphere"
    if not data.is_dir():
        pytest.skip("the photographs of the grey sphere are not here")
    code, out, _ = run("estimate", data, "--model", "oren-nayar", "-o", tmp_path / "grey", "--json")
    assert code == 0
    content = json.loads(out)
    assert content["fit"]["status"] == "converged"
    assert content["fit"]["relative_rmse"] <= 0.075
    assert content["fit"]["errors"] == "jackknife over images"
    assert content["parameters"]["sigma"]["std"] > np.deg2rad(0.4)
    assert any("up to that scale" in warning for warning in content["warnings"])


def test_progress_is_silent_in_a_pipe(capture: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "matest", "estimate", str(capture), "--model", "lambert"],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "COLUMNS": "80"},
    )
    assert done.returncode == 0
    assert done.stderr == ""


def test_what_is_no_capture_is_refused_before_the_folder_of_its_result(run: Run, tmp_path: Path) -> None:
    (tmp_path / "README.md").write_text("words")
    (tmp_path / "matest").mkdir()
    (tmp_path / "matest" / "mine.txt").write_text("words")
    code, _, err = run("estimate", tmp_path / "README.md")
    assert code == 2
    assert "capture.toml" in err
    assert "mine.txt" not in err
