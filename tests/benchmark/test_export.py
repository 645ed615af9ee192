"""What exports cost, as docs/conventions.md has it, and that Mitsuba's renders are ours."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest
from rich.console import Console

from matest.benchmark import Effort, Record, load
from matest.benchmark.instruments.rendition import difference
from matest.benchmark.instruments.rendition import load as load_scene
from matest.benchmark.suites.export import GLOSS, MAPPED, MATERIALS, SIZE, SLOPE, slopes
from matest.export import mitsuba
from matest.scene import Camera
from matest.scene.surface import from_sphere
from tests.tolerances import CONVERSION, CONVERSION_DIGIT

pytest.importorskip("mitsuba")
PAGE = (Path(__file__).parents[2] / "docs" / "conventions.md").read_text("utf-8")
COLUMNS = ("mitsuba", "pixels", "mitsuba --fitted", "materialx", "gltf", "merl")


@pytest.fixture(scope="module")
def records() -> list[Record]:
    return list(load("export").run(Effort(quick=True)))


@pytest.mark.parametrize("case", [*MATERIALS, MAPPED])
def test_conversions_cost_what_the_page_says(case: str, records: list[Record]) -> None:
    values = {record.metric: record.value for record in records if record.case == case}
    line = next(line for line in PAGE.splitlines() if line.startswith(f"| {case}:"))
    stated = dict(zip(COLUMNS, [cell.strip() for cell in line.strip("|").split("|")][1:], strict=True))
    # To the one digit that is given: last digits depend on the processor's arithmetic.
    assert values["mitsuba: rendered pixel"] < 2 * numbers(stated.pop("pixels"))[0] / 100
    for way, cell in stated.items():
        if cell == "means":
            assert f"{way}: error" not in values
        elif cell == "plugin":
            assert values[f"{way}: error"] == 0
        else:
            measured = [100 * (values[f"{way}: {metric}"] or 0.0) for metric in ("error", "median")]
            assert numbers(cell) == pytest.approx(measured, rel=CONVERSION, abs=CONVERSION_DIGIT)


def numbers(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"\d+(?:\.\d+)?", text)]


def test_every_render_and_every_slope_is_within_its_limit(records: list[Record]) -> None:
    held = [record for record in records if record.limit is not None]
    assert sorted({record.metric for record in held if record.case == f"slope {SLOPE}"}) == [
        "gltf: slope", "materialx: slope", "mitsuba: slope",
    ]  # fmt: skip
    assert {record.case for record in held if record.metric == "mitsuba: rendered pixel"} == {*MATERIALS, MAPPED}
    assert not [record for record in held if record.misses]


def test_what_mitsuba_fits_is_as_far_off_on_a_sphere_as_is_stated(records: list[Record]) -> None:
    for case in MATERIALS:
        values = {record.metric: record.value or 0.0 for record in records if record.case == case}
        assert values["mitsuba --fitted: rendered rms"] < values["mitsuba --fitted: error"] + 1e-6


def test_a_slope_that_is_two_per_cent_off_shows_in_the_render(tmp_path: Path) -> None:
    files = mitsuba.write(GLOSS.replace({"slope": 1.02 * GLOSS.slope}), tmp_path / "ball.xml").files
    surface = from_sphere((SIZE, SIZE), (SIZE / 2, SIZE / 2), SIZE / 2, None)
    ball = {"type": "sphere", "bsdf": load_scene(files)}
    light = surface.normals[len(surface) // 3].numpy()
    assert difference(ball, GLOSS, surface, Camera((0.0, 0.0, 3.0), height=2.0), [light]).largest > 0.02


def test_a_library_that_is_missing_leaves_the_other_figures(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "pygltflib", None)
    missing, *others = sorted(slopes(tmp_path), key=lambda record: record.metric)
    assert missing.value is None
    assert "pygltflib" in missing.note
    assert all(record.value is not None for record in others)


def test_the_table_fits_eighty_columns(records: list[Record]) -> None:
    terminal = Console(width=80, record=True)
    terminal.print(load("export").table(records))
    shown = terminal.export_text()
    assert "…" not in shown
    assert "mitsuba --fitted" in shown
