"""Records of run time are there and make sense; how fast anything is, is never asserted."""

from __future__ import annotations

import pytest
import torch

from matest.benchmark import Effort
from matest.benchmark.instruments import passes
from matest.benchmark.suite import Record
from matest.benchmark.suites import models
from matest.brdf import Lambert
from tests.sampling import named, random_pairs

# Few pairs of directions, and no waiting for a quiet moment of the machine.
PAIRS = 2000


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(passes, "SPELL", 0.0)


def measured(expression: str, compiled: bool = False) -> dict[str, Record]:
    return {record.metric: record for record in models.times_of(expression, PAIRS, compiled)}


@pytest.mark.parametrize("expression", ["lambert", "cook-torrance(masking=smith)"])
def test_every_figure_is_there_and_positive(expression: str) -> None:
    found = measured(expression)
    for mode in ("tiled", "one call"):
        for metric in ("forward", "forward + backward"):
            assert found[f"{mode} {metric}"].unit == "pass"
            assert found[f"{mode} {metric} time"].unit == "ns"
        assert found[f"{mode} gradient"].limit == 4
    assert found["pairs"].value == PAIRS
    assert all(record.value > 0 for record in found.values())
    assert {record.case for record in found.values()} == {expression}
    limit = 3 if expression.startswith("cook") else None
    assert found["time per pass"].limit == found["time of its own passes"].limit == limit


def test_model_that_does_not_compile_is_a_record_without_value(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("no\nway")

    monkeypatch.setattr(torch, "compile", lambda _: fail)
    monkeypatch.setenv("CXX", "sh")
    record = measured("lambert", compiled=True)["compiled forward"]
    assert record.value is None
    assert record.note == "torch.compile failed: no"
    monkeypatch.setenv("CXX", "no-such-compiler")
    assert "no-such-compiler" in measured("lambert", compiled=True)["compiled forward"].note


def test_passes_are_the_operations_that_write_whole_tensors() -> None:
    x = torch.rand(3000, 1)

    def run() -> None:
        y = (x * 2).exp()  # two passes
        y.reshape(3, 1000)[0].add_(1)  # two views and a pass over a third
        torch.ones(10) * 3  # too short

    written, seconds = passes.element_wise(run)
    assert written == 2 * 3000 + 1000
    assert seconds > 0


def test_sums_over_facets_are_told_from_closed_forms() -> None:
    facets = torch.linspace(0.1, 1, 2000)

    def many(wi: torch.Tensor, wo: torch.Tensor) -> torch.Tensor:
        return (wi[:, 2:] * wo[:, 2:] * facets).sum(-1)

    assert passes.heavy(many)
    assert not passes.heavy(named("cook-torrance"))


def test_directions_are_above_the_horizon() -> None:
    wi, wo = passes.random_directions(1000)
    assert wi.dtype == torch.float32
    assert (wi[:, 2] >= 0).all()
    assert (wo[:, 2] >= 0).all()
    torch.testing.assert_close(wi.norm(dim=-1), torch.ones(1000))


def test_times_are_the_shortest_of_each() -> None:
    wi, wo = random_pairs(1000, seed=1)
    once, often = passes.seconds(lambda: Lambert()(wi, wo), lambda: [Lambert()(wi, wo) for _ in range(50)])
    assert 0 < once < often


def test_no_model_is_compiled_after_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(models, "variants", lambda: ["lambert"])
    monkeypatch.setattr(models, "PAIRS", 1000)
    monkeypatch.setattr(models.table4, "measure", lambda *_: iter(()))
    found = list(models.SUITE.run(Effort(seconds=0.0)))
    assert "one call forward" in {record.metric for record in found}
    assert not [record.metric for record in found if "compiled" in record.metric]
