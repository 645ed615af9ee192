"""Growth of the time: the fit of the exponents, and captures that are what they say."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from rich.console import Console

from matest.benchmark import Effort, load
from matest.benchmark.suites import limits, scaling


@pytest.mark.parametrize("exponent", [0.5, 1.0, 2.0])
def test_the_exponent_of_a_power_law_is_found_exactly(exponent: float) -> None:
    sizes = [10, 20, 50, 100]
    law = scaling.power_law(sizes, [3.0 * size**exponent for size in sizes])
    assert law.slope == pytest.approx(exponent)
    assert law.stderr == pytest.approx(0, abs=1e-7)


def test_the_standard_error_is_the_scatter_of_the_exponent() -> None:
    generator = np.random.default_rng(0)
    sizes = np.array([1.0, 2, 4, 8, 16])
    laws = [scaling.power_law(sizes, sizes * np.exp(0.1 * generator.standard_normal(5))) for _ in range(2000)]
    scatter = np.std([law.slope for law in laws])
    assert np.sqrt(np.mean([law.stderr**2 for law in laws])) == pytest.approx(scatter, rel=0.05)


def test_every_series_has_its_times_exponent_and_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scaling, "SIDES_QUICK", (16, 20, 24))
    monkeypatch.setattr(scaling, "TIMES", (1, 2, 4))
    monkeypatch.setattr(scaling, "IMAGES", 2)
    monkeypatch.setattr(limits, "machine", lambda: limits.Limits(1e-10, 1e-7, 1e-9, 1e-9))
    found = list(load("scaling").run(Effort(quick=True)))
    names = [(record.case, record.metric) for record in found]
    assert len(set(names)) == len(names)
    for case, sizes in (("images", ["2", "4", "8"]), ("parameters", ["1", "4", "7"])):
        assert [metric.removeprefix("time of ") for c, metric in names if c == case and "time of" in metric] == sizes
    exponents = {record.case: record.limit for record in found if record.metric == "exponent"}
    assert exponents == {"pixels": 1.05, "images": 1.05, "parameters": None}
    terminal = Console(width=80, record=True)
    terminal.print(load("scaling").table(found))
    shown = terminal.export_text()
    assert "…" not in shown
    assert "parameters" in shown


def test_the_table_fits_the_largest_sizes() -> None:
    found = []
    for case in ("pixels", "images", "parameters"):
        times = {174_320: 12.34, 348_640: 123.4, 697_280: 12.34, 1_393_200: 12.34}
        found += scaling._series(case, "", times, 0.1234, 1.0)
    for name in ("time per sample", "time / copying the pixels"):
        found.append(scaling.Record("scaling", "pixels", name, 1234.5, "1"))
    terminal = Console(width=80, record=True)
    terminal.print(load("scaling").table(found))
    assert "…" not in terminal.export_text()


def test_every_second_photograph_keeps_its_light() -> None:
    whole, half = (scaling.spheres("oren-nayar", images=4, side=16, step=step) for step in (1, 2))
    assert len(half) == 2
    for lights, same in zip(half.scene.lights, whole.scene.lights[::2], strict=True):
        assert torch.equal(lights[0].direction, same[0].direction)
    assert len(half.samples()) < len(whole.samples())
