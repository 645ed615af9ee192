"""The pictures of the benchmark, drawn by `renders/benchmark.py`."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

RENDERS = Path(__file__).parent.parent / "renders"


@pytest.fixture
def pictures(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """The script, drawing into an empty folder."""
    monkeypatch.syspath_prepend(str(RENDERS))
    monkeypatch.delitem(sys.modules, "benchmark", raising=False)
    import benchmark

    monkeypatch.setattr(benchmark, "HERE", tmp_path / "pictures")
    yield benchmark
    sys.modules.pop("benchmark", None)


def record(suite: str, case: str, metric: str, value: float | None) -> dict:
    return {"suite": suite, "case": case, "metric": metric, "value": value, "unit": "s"}


def frontier_records() -> list[dict]:
    found = [record("frontier", "vase", "samples", 1000), record("frontier", "vase", "mitsuba: error at the end", None)]
    for estimator, seconds in (("matest", (0.1, 0.2)), ("adam, mini-batches", (1.0, 20.0, 30.0))):
        for number, at in enumerate(seconds):
            found.append(record("frontier", "vase", f"{estimator}: point {number}, seconds", at))
            found.append(record("frontier", "vase", f"{estimator}: point {number}, error", 10.0 / at))
    return found


def test_every_suite_among_the_records_has_its_picture(pictures, tmp_path: Path) -> None:
    stages = [record("estimate", "lambert", stage, 0.5) for stage in pictures.STAGES]
    growth = [record("scaling", "pixels", f"time of {size:,}", 1e-6 * size) for size in (1000, 2000, 4000)]
    lines = [json.dumps(one) for one in (*frontier_records(), *stages, *growth)]
    (tmp_path / "records.jsonl").write_text("\n".join(lines), "utf-8")
    pictures.main([str(tmp_path / "records.jsonl")])
    assert {path.name for path in (tmp_path / "pictures").iterdir()} == {"frontier.png", "stages.png", "growth.png"}


def test_matest_is_the_widest_line_and_lies_above_the_others(pictures) -> None:
    (axes,) = pictures.frontier(frontier_records()).axes
    own, other, _ = sorted(axes.lines, key=lambda line: -line.get_linewidth())
    np.testing.assert_allclose(own.get_xydata(), [(0.1, 100.0), (0.2, 50.0)])
    assert own.get_linewidth() > other.get_linewidth()
    assert own.get_zorder() > other.get_zorder()


def test_legend_names_who_was_there_and_covers_no_curve(pictures) -> None:
    figure = pictures.frontier(frontier_records())
    figure.draw_without_rendering()
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["matest", "Adam, mini-batches"]
    assert not any(legend.get_window_extent().overlaps(axes.get_window_extent()) for axes in figure.axes)


def test_points_are_read_in_their_order(pictures) -> None:
    metrics = {one["metric"]: one["value"] for one in frontier_records()}
    assert pictures.curve(metrics, "matest") == [(0.1, 100.0), (0.2, 50.0)]
    assert pictures.curve(metrics, "l-bfgs") == []
