"""Result folders: whole or not at all."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from matest.brdf import OrenNayar
from matest.capture import Capture
from matest.estimation.prediction import PredictionErrors
from matest.photographs.images import read_image
from matest.report.folder import check_destination, write_prediction, write_result
from matest.report.picture_size import PictureSize
from matest.shading import render
from tests.captures import refusal
from tests.estimates import clay
from tests.simulated import Studio, coloured


def tree(path: Path) -> dict[str, bytes]:
    """Every file below a folder, hidden ones too."""
    return {str(file.relative_to(path)): file.read_bytes() for file in sorted(path.rglob("*")) if file.is_file()}


@pytest.fixture
def capture() -> Capture:
    return Studio(size=16, lights=coloured()[:2]).photograph(OrenNayar([0.7, 0.6, 0.5], 0.5236), seed=1)


def test_new_places_empty_folders_and_earlier_results_are_good_destinations(tmp_path: Path) -> None:
    check_destination(tmp_path / "new", "result.json")
    (tmp_path / "empty").mkdir()
    check_destination(tmp_path / "empty", "result.json")
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "result.json").write_text('{"schema": "matest.estimate/1"}')
    check_destination(tmp_path / "old", "result.json")


def test_an_earlier_result_that_someone_added_to_is_refused(tmp_path: Path) -> None:
    (tmp_path / "result.json").write_text('{"schema": "matest.estimate/1"}')
    (tmp_path / "notes.txt").write_text("precious")
    assert "notes.txt" in refusal(lambda: check_destination(tmp_path, "result.json"))


@pytest.mark.parametrize("text", ["", "{}", "[]", '{"schema": 3}', '{"schema": "other/1"}', '"matest."'])
def test_a_result_of_another_program_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "result.json").write_text(text)
    assert str(tmp_path) in refusal(lambda: check_destination(tmp_path, "result.json"))


def test_foreign_folders_and_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "photo.jpg").write_text("precious")
    message = refusal(lambda: check_destination(tmp_path, "result.json"))
    assert str(tmp_path) in message
    assert "-o" in message
    assert "photo.jpg" in refusal(lambda: check_destination(tmp_path / "photo.jpg", "result.json"))


def test_a_result_of_another_kind_is_refused(tmp_path: Path) -> None:
    (tmp_path / "result.json").write_text('{"schema": "matest.estimate/1"}')
    refusal(lambda: check_destination(tmp_path, "prediction.json"))


def test_a_result_has_every_file_of_the_contract(tmp_path: Path, capture: Capture) -> None:
    said: list[str] = []
    write_result(clay(), capture, tmp_path / "matest", said.append)
    pictures = {f"images/{k:02d}_{kind}.png" for k in range(2) for kind in ("photo", "render", "residual")}
    expected = {"result.json", "material.json", "report.html", "profile.csv"} | {
        "manifest.json",
        "images/mean_residual.png",
    }
    assert set(tree(tmp_path / "matest")) == expected | pictures
    assert said == ["writing the report"]


def test_a_result_without_pictures_has_every_other_file(tmp_path: Path, capture: Capture) -> None:
    write_result(clay(), capture, tmp_path / "matest", pictures=PictureSize.NONE)
    assert set(tree(tmp_path / "matest")) == {"result.json", "material.json", "report.html", "profile.csv"} | {
        "manifest.json"
    }
    assert "<img" not in (tmp_path / "matest" / "report.html").read_text("utf-8")


def test_result_json_and_material_json_are_those_of_the_estimate(tmp_path: Path, capture: Capture) -> None:
    written = write_result(clay(), capture, tmp_path / "matest")
    content = json.loads((tmp_path / "matest" / "result.json").read_text("utf-8"))
    assert content == json.loads(json.dumps(written.to_dict()))
    assert json.loads((tmp_path / "matest" / "material.json").read_text("utf-8")) == clay().material_dict()


def test_what_differs_between_two_runs_comes_last_in_result_json(tmp_path: Path, capture: Capture) -> None:
    provenance = {"matest": "0.1.0", "inputs": {"00.png": "sha256:0"}}
    texts = []
    for run, seconds in (("first", 1.0), ("second", 2.0)):
        one = clay(provenance={**provenance, "command": run}, timing_s={"fit": seconds})
        write_result(one, capture, tmp_path / run)
        texts.append((tmp_path / run / "result.json").read_text("utf-8"))
    first, second = (text.partition('"command"') for text in texts)
    assert first[0] == second[0]
    assert "warnings" in first[0]
    assert first[2] != second[2]


def test_the_manifest_names_what_was_asked_for_and_every_file(tmp_path: Path, capture: Capture) -> None:
    write_result(clay(), capture, tmp_path / "matest", request={"model": "oren-nayar"})
    content = json.loads((tmp_path / "matest" / "manifest.json").read_text("utf-8"))
    assert content["request"] == {"model": "oren-nayar"}
    assert content["inputs"] == capture.digests()
    assert {*content["files"], "manifest.json"} == set(tree(tmp_path / "matest"))


def test_timing_is_completed(tmp_path: Path, capture: Capture) -> None:
    timing = write_result(clay(), capture, tmp_path / "matest").timing_s
    assert list(timing) == ["read", "geometry", "fit", "report", "total"]
    assert timing["report"] > 0
    assert timing["total"] == pytest.approx(sum(timing.values()) - timing["total"])


def test_a_result_replaces_an_earlier_one(tmp_path: Path, capture: Capture) -> None:
    write_result(clay(), capture, tmp_path / "matest")
    write_result(clay(capture="second"), capture, tmp_path / "matest")
    assert json.loads((tmp_path / "matest" / "result.json").read_text("utf-8"))["capture"] == "second"
    assert [path.name for path in tmp_path.iterdir()] == ["matest"]


def test_a_foreign_folder_is_refused_before_anything_is_computed(tmp_path: Path, capture: Capture) -> None:
    (tmp_path / "thesis.tex").write_text("precious")
    said: list[str] = []
    refusal(lambda: write_result(clay(), capture, tmp_path, said.append))
    assert said == []
    assert tree(tmp_path) == {"thesis.tex": b"precious"}


def test_a_prediction_has_linear_radiance_and_its_errors(tmp_path: Path, capture: Capture) -> None:
    material = clay().material
    write_prediction(material, PredictionErrors([0.01, 0.02], 0.015, [0.008, 0.01], 0.009), capture, tmp_path / "out")
    images = render(capture.scene, material).numpy()
    for number in range(2):
        np.testing.assert_allclose(read_image(tmp_path / "out" / f"{number:02d}.exr"), images[number], rtol=1e-6)
    content = json.loads((tmp_path / "out" / "prediction.json").read_text("utf-8"))
    assert content["schema"] == "matest.prediction/1"
    assert content["images"] == [
        {"image": "00.exr", "prediction": "00.exr", "relative_rmse": 0.01, "median_error": 0.008},
        {"image": "01.exr", "prediction": "01.exr", "relative_rmse": 0.02, "median_error": 0.01},
    ]


def test_the_radiance_of_a_prediction_is_full_whatever_its_pictures(tmp_path: Path) -> None:
    large = Studio(size=500, lights=coloured()[:1]).photograph(OrenNayar([0.7, 0.6, 0.5], 0.5236))
    image = render(large.scene, clay().material).numpy()[0]
    sides = {PictureSize.PREVIEW: 250, PictureSize.FULL: 500, PictureSize.NONE: None}
    for size, side in sides.items():
        write_prediction(
            clay().material, PredictionErrors([0.01], 0.01, [0.01], 0.01), large, tmp_path / size, pictures=size
        )
        np.testing.assert_allclose(read_image(tmp_path / size / "00.exr"), image, rtol=1e-6)
        drawn = tmp_path / size / "images" / "00_render.png"
        assert (read_image(drawn).shape[0] if drawn.is_file() else None) == side


def test_a_prediction_does_not_replace_an_estimate(tmp_path: Path, capture: Capture) -> None:
    write_result(clay(), capture, tmp_path / "matest")
    before = tree(tmp_path)
    refusal(
        lambda: write_prediction(
            clay().material, PredictionErrors([0.0, 0.0], 0.0, [0.0, 0.0], 0.0), capture, tmp_path / "matest"
        )
    )
    assert tree(tmp_path) == before
