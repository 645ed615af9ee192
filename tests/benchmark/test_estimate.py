"""Times of an estimate of photographs on disk are there and make sense; how fast anything is, is never asserted."""

from __future__ import annotations

import numpy as np
import pytest
from rich.console import Console

import matest
from matest.benchmark import Effort, load
from matest.benchmark.instruments.photographs import MATERIALS, in_files, ring
from matest.benchmark.suites import estimate


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimate, "SIZE_QUICK", 48)
    monkeypatch.setattr(estimate, "IMAGES", 3)


@pytest.mark.parametrize("quick", [True, False])
def test_every_stage_has_a_record_and_the_ratio_of_a_full_run_a_limit(
    quick: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(estimate, "SIZE", 48)
    found = list(load("estimate").run(Effort(quick)))
    by_metric = {(record.case, record.metric): record for record in found}
    assert len(by_metric) == len(found)
    for case, limit in (("oren-nayar", 1), ("cook-torrance", 3)):
        values = {
            metric: by_metric[case, metric].value for metric in ("decode", "read", "geometry", "fit", "first fit")
        }
        assert all(value > 0 for value in values.values())
        assert values["fit"] <= values["first fit"]
        ratio = by_metric[case, "fit / decode"]
        assert ratio.value == pytest.approx(values["fit"] / values["decode"])
        assert ratio.limit == (None if quick else limit)
        assert by_metric[case, "photographs"].value == 3
    terminal = Console(width=80, record=True)
    terminal.print(load("estimate").table(found))
    shown = terminal.export_text()
    assert "…" not in shown
    assert "fit / decode" in shown


def test_the_photographs_are_of_the_stated_material_and_size() -> None:
    with in_files("oren-nayar", images=3, size=64) as folder:
        capture = matest.load_capture(folder)
    assert len(capture) == 3
    assert capture.photographs.stored[0].dtype == np.uint16
    assert capture.photographs.stored[0].shape[1] == 3
    assert len(capture.scene.surface) == pytest.approx(0.8e6 / 1024**2 * 64**2, rel=0.02)
    found = matest.estimate(capture, "oren-nayar")
    for name, truth in MATERIALS["oren-nayar"].items():
        assert found.parameters[name].value == pytest.approx(truth, rel=0.02)


def test_lights_stand_on_all_sides_within_60_degrees_of_the_camera() -> None:
    directions = ring(12)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
    assert (directions[:, 2] > 0.5).all()
    assert np.linalg.norm(directions[:, :2].mean(axis=0)) < 0.2
