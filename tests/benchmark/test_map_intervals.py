"""Intervals of maps are counted by what they hold."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
import torch

from matest.benchmark.instruments.map_intervals import (
    SMOOTH,
    TWO_MATERIALS,
    Coverage,
    Hits,
    coverage_of,
    records,
    trial,
)
from matest.benchmark.instruments.varying import KINDS
from matest.benchmark.suite import Record
from matest.brdf import OrenNayar
from matest.estimation.parameter_map import ParameterMap, TexelStatus
from matest.inference.quantities import ParameterEstimate

KIND = KINDS["oren-nayar, albedo"]
TRUTH = OrenNayar(torch.full((4, 1), 0.5, dtype=torch.float64), 0.4)


def estimate(sigma: ParameterEstimate) -> Any:
    """With a map whose first and last pixels are right, one of them of its region, and one that nobody sees."""
    status = torch.tensor([TexelStatus.DETERMINED, TexelStatus.DETERMINED, TexelStatus.UNSEEN, TexelStatus.SHARED])
    value = torch.tensor([[0.5 + 0.0195], [0.5 + 0.0197], [torch.nan], [0.5]])
    maps = {"albedo": ParameterMap("albedo", value, torch.full((4, 1), 0.01), status)}
    return SimpleNamespace(maps=maps, parameters={"sigma": sigma}, fit=SimpleNamespace(reduced_chi2=1.5))


def test_pixels_count_by_1_96_standard_errors_and_unseen_ones_not_at_all() -> None:
    sigma = ParameterEstimate(0.41, 0.01, [0.39, 0.43], "rad", "determined")
    one = coverage_of(KIND, estimate(sigma), TRUTH)
    assert one.own == {"albedo": Hits(1, 2)}
    assert one.every == {"albedo": Hits(2, 3)}
    assert one.shared == {"sigma": Hits(1, 1)}
    assert one.deviations["sigma"] == pytest.approx([1.0])
    assert one.chi2 == 1.5


def test_a_shared_parameter_without_interval_is_not_covered() -> None:
    one = coverage_of(KIND, estimate(ParameterEstimate(None, None, None, "rad", "not determined")), TRUTH)
    assert one.shared == {"sigma": Hits(0, 1)}
    assert one.deviations == {"sigma": []}


def test_channels_of_a_shared_parameter_count_each() -> None:
    kind, truth = KINDS["cook-torrance"], SimpleNamespace(parameters={"specular": torch.full((3,), 0.9)})
    specular = ParameterEstimate(
        [0.9, 0.8, 1.0], [0.01, 0.01, None], [[0.88, 0.92], [0.78, 0.82], None], "1", "at bound"
    )
    found = SimpleNamespace(maps={}, parameters={"specular": specular}, fit=SimpleNamespace(reduced_chi2=1.0))
    one = coverage_of(kind, found, truth)  # type: ignore[arg-type]
    assert one.shared == {"specular": Hits(1, 3)}
    assert one.deviations["specular"] == pytest.approx([0.0, -10.0], abs=1e-5)


def pooled(share: float, captures: int) -> dict[str, Record]:
    hits = {"albedo": Hits(round(1000 * share), 1000)}
    one = Coverage(hits, hits, {"sigma": Hits(1, 1)}, {"sigma": [2.0]}, 1.0)
    return {record.metric: record for record in records("maps", "case", [one] * captures)}


@pytest.mark.parametrize(
    ("share", "missed"), [(0.92, "albedo, own: coverage"), (0.95, ""), (0.98, "albedo, own: coverage, not above")]
)
def test_coverage_misses_the_limit_on_its_side(share: float, missed: str) -> None:
    found = pooled(share, 30)
    assert [name for name, record in found.items() if record.misses and "own" in name] == [missed] * bool(missed)
    assert found["sigma: rms error / std"].value == pytest.approx(2)


def test_few_captures_are_held_to_no_limit() -> None:
    assert not any(record.limit is not None for record in pooled(0.5, 5).values())


def test_the_worst_capture_is_named_by_its_seed() -> None:
    good, bad = (Coverage({}, {}, {}, {}, chi2) for chi2 in (1.0, 7.0))
    found = {record.metric: record for record in records("maps", "case", [good, good, bad])}
    assert found["largest reduced chi2"].value == 7
    assert "seed 2" in found["largest reduced chi2"].note


@pytest.mark.parametrize("setting", [SMOOTH[1], TWO_MATERIALS[1]])
def test_most_intervals_of_a_capture_hold_the_truth(setting) -> None:
    one = trial(setting, 48, 1)
    assert one.chi2 == pytest.approx(1, abs=0.1)
    for hits in (*one.own.values(), *one.every.values()):
        assert 0.9 < hits.inside / hits.total < 0.99
