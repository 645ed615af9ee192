"""`matest fit` as people and scripts use it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from matest.brdf import CookTorrance
from matest.estimation.result import load_material
from tests.commands.conftest import Run
from tests.tables.dome import Dome
from tests.tables.goniometer import hemispherical, measured, write_csv

MATERIAL = CookTorrance([0.3, 0.2, 0.1], 1.0, 0.15)
DECLARED = ("--azimuth", "retro", "--quantity", "f")
NAMED = ("--model", "cook-torrance", "--fix", "f0=0.04")


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    wi, wo = hemispherical()
    return write_csv(measured(MATERIAL, (wi[::6], wo[::6])), tmp_path_factory.mktemp("table") / "gloss.csv")


def test_a_table_becomes_a_result_folder(run: Run, table: Path, tmp_path: Path) -> None:
    code, out, err = run("fit", table, *DECLARED, *NAMED, "--noise", "0.01", "-o", tmp_path / "out")
    assert (code, err) == (0, "")
    assert "diffuse R" in out
    assert "incidence" in out
    assert "report.html" in out.replace("\n", "")
    written = {str(path.relative_to(tmp_path / "out")) for path in (tmp_path / "out").rglob("*") if path.is_file()}
    pictures = {f"images/{name}.png" for name in ("slices", "incidences", "posterior")}
    assert written == {"result.json", "material.json", "report.html", *pictures}
    result = json.loads((tmp_path / "out" / "result.json").read_text("utf-8"))
    assert result["schema"] == "matest.fit/1"
    assert result["table"] == "gloss.csv"
    assert result["parameters"]["slope"]["value"] == pytest.approx(0.15, abs=0.002)
    assert result["noise"]["stated"]
    assert result["provenance"]["inputs"]["gloss.csv"].startswith("sha256:")
    material = load_material(tmp_path / "out")
    torch.testing.assert_close(material.parameters["diffuse"], MATERIAL.diffuse, rtol=0.01, atol=0)
    # It may be replaced by another.
    assert run("fit", table, *DECLARED, *NAMED, "-o", tmp_path / "out")[0] == 0


def test_json_is_the_content_of_the_result(run: Run, table: Path, tmp_path: Path) -> None:
    arguments = ("fit", table, *DECLARED, *NAMED, "--loss", "cube-root", "--json", "-o", tmp_path / "out")
    code, out, _ = run(*arguments)
    assert code == 0
    assert json.loads(out) == json.loads((tmp_path / "out" / "result.json").read_text("utf-8"))
    assert json.loads(out)["loss"] == "cube-root"


def test_without_a_place_the_result_lies_beside_the_table(run: Run, table: Path, tmp_path: Path) -> None:
    copy = tmp_path / "gloss.csv"
    copy.write_bytes(table.read_bytes())
    assert run("fit", copy, *DECLARED, "--model", "lambert")[0] == 0
    assert (tmp_path / "gloss-fit" / "report.html").is_file()
    assert "lambert misses the measurements by" in (tmp_path / "gloss-fit" / "report.html").read_text("utf-8")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--model", "lambert"), "declare --quantity"),
        ((*DECLARED, "--units", "grad"), "units must be one of rad, deg"),
        ((*DECLARED, "--loss", "squares"), "--loss must be one of likelihood, li-torrance, log, cube-root"),
        ((*DECLARED, "--noise", "much"), "--noise takes R or R,FLOOR"),
        ((*DECLARED, "--noise", "2"), "noise is a share of the value between 0 and 1"),
        ((*DECLARED, "--model", "lambart"), "did you mean 'lambert'?"),
    ],
)
def test_what_cannot_be_done_is_refused_in_a_sentence(
    run: Run, table: Path, tmp_path: Path, arguments: tuple[str, ...], words: str
) -> None:
    code, out, err = run("fit", table, *arguments, "-o", tmp_path / "out")
    assert (code, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_folders_of_others_are_not_replaced(run: Run, table: Path, tmp_path: Path) -> None:
    (tmp_path / "letter.txt").write_text("dear")
    code, _, err = run("fit", table, *DECLARED, "-o", tmp_path)
    assert code == 2
    assert "would be replaced, but holds what matest did not write" in err


def test_the_command_fits_measurements_and_says_that_albedo_has_no_scale(run: Run, tmp_path: Path) -> None:
    path = Dome(noise=4.0).write(tmp_path / "dome.csv")
    code, out, err = run("fit", path, "--model", "lambert", "-o", tmp_path / "fit", "--json")
    assert (code, err) == (0, "")
    content = json.loads(out)
    assert any("reported up to that scale" in warning for warning in content["warnings"])
    assert content["skipped"]["samples"]["below the horizon"] > 0
