"""Every model is finite everywhere, and in float32 close to float64: a small version of the suite `stress`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import pytest
import torch
from torch import Tensor

from matest.benchmark.instruments.adversarial import direction_pairs, parameter_values
from matest.benchmark.instruments.passes import heavy
from matest.benchmark.suite import Record
from matest.benchmark.suites.stress import POINTS_QUICK, TILE, examine
from matest.brdf import Brdf, Lambert, Term, variants
from matest.directions import Directions
from matest.parameters import parameter, unit_interval
from tests import tolerances
from tests.sampling import named

DECLARED = named("cook-torrance").declared


@dataclass(frozen=True, eq=False)
class Broken(Brdf):
    """Finite everywhere, but not its derivative at normal incidence: acos has none at 1."""

    albedo: Tensor = parameter(unit_interval, unit="1", doc="albedo", default=0.5)

    name: ClassVar[str] = "broken"
    source: ClassVar[str] = "none"

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        return (Term(("albedo",), torch.acos(directions.cos_i.clamp(max=1)) + directions.cos_o),)


@dataclass(frozen=True, eq=False)
class Cancelling(Brdf):
    """Loses digits in float32: 1 − cos θ of a small angle."""

    albedo: Tensor = parameter(unit_interval, unit="1", doc="albedo", default=0.5)

    name: ClassVar[str] = "cancelling"
    source: ClassVar[str] = "none"

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        return (Term(("albedo",), (1000 + directions.cos_i) - 1000),)


@dataclass(frozen=True, eq=False)
class Untransformable(Lambert):
    """Branches on its values, which vmap cannot follow."""

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        assert bool((directions.cos_i > 0).all())
        return super().terms(directions)


def by_metric(brdf: Brdf, points: int) -> dict[str, Record]:
    return {record.metric: record for record in examine(brdf, points)}


@pytest.mark.parametrize("expression", variants())
def test_everything_is_finite_and_float32_is_close(expression: str) -> None:
    brdf = named(expression)
    found = by_metric(brdf, 2000 if heavy(brdf) else POINTS_QUICK)
    missed = [f"{r.metric} = {r.value}, limit {r.limit}\n{r.note}" for r in found.values() if r.misses]
    assert not missed, "\n".join(missed)
    assert sum(record.limit == 0 for record in found.values()) == 10
    assert found["float32 error"].limit == 1


def test_derivative_that_is_not_finite_is_reported_with_its_place() -> None:
    found = by_metric(Broken(), 5000)
    assert found["float64 non-finite values"].value == 0
    for dtype in ("float32", "float64"):
        record = found[f"{dtype} non-finite first derivatives"]
        assert record.misses
        assert record.note.startswith("by wi")
        assert "albedo = " in record.note
        assert "wi = [" in record.note
        assert "1.0]" in record.note


def test_examination_goes_on_after_a_transform_that_fails() -> None:
    found = by_metric(Untransformable(), 4000)
    assert found["float64 non-finite batched derivatives"].value == 4
    assert "vmap" in found["float64 non-finite batched derivatives"].note
    assert found["float64 non-finite forward derivatives"].value == 0
    assert found["float32 error"].value < 1


def test_lost_digits_are_reported_with_their_place() -> None:
    record = by_metric(Cancelling(), 5000)["float32 error"]
    assert record.misses
    assert "wo = [" in record.note


def test_same_points_every_time() -> None:
    first, second = (direction_pairs(100, torch.Generator().manual_seed(3)) for _ in range(2))
    assert all(torch.equal(a, b) for a, b in zip(first, second, strict=True))


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_adversarial_directions_are_unit_vectors_that_reach_every_boundary(dtype: torch.dtype) -> None:
    wi, wo = (vector.to(dtype) for vector in direction_pairs(20_000, torch.Generator().manual_seed(4)))
    for vector in (wi, wo):
        length = vector.double().norm(dim=-1)
        torch.testing.assert_close(length, torch.ones_like(length), rtol=0, atol=4 * torch.finfo(dtype).eps)
        cos, sin = vector[:, 2], vector[:, :2].norm(dim=-1)
        assert (cos == 0).any()
        assert ((cos > 0) & (cos < 1e-28)).any()
        assert ((cos < 0) & (cos > -1e-28)).any()
        assert (sin == 0).any()
        assert ((sin > 0) & (sin < 1e-18)).any()
    assert ((wi[:, 2] > 0) & (wo[:, 2] > 0)).float().mean() > 0.7
    opposite = torch.tensor([-1.0, -1.0, 1.0], dtype=dtype)
    for view in (wi, wi * opposite):
        distance = (wo - view).norm(dim=-1)
        assert (distance == 0).any()
        assert ((distance > 0) & (distance < 1e-6)).any()
    assert (((wi + wo).norm(dim=-1) < 1e-20) & (wi[:, 2] > 0) & (wo[:, 2] > 0)).any()


def test_adversarial_parameters_reach_both_ends_and_stay_inside() -> None:
    values = parameter_values(DECLARED, 5000, torch.Generator().manual_seed(5))
    for name, declared in DECLARED.items():
        lower, upper = declared.domain.lower, min(declared.domain.upper, 10.0)
        value = values[name]
        assert value.shape == (5000, 1)
        assert value.min() == lower
        assert value.max() == upper
        inside = value[(value > lower) & (value < upper)]
        assert inside.min() < lower + 1e-12
        assert inside.max() > upper - 1e-12
        assert ((value > lower + 0.3 * (upper - lower)) & (value < lower + 0.7 * (upper - lower))).any()


def test_limits_are_those_of_the_tests() -> None:
    from matest.benchmark.instruments import adversarial

    assert adversarial.RELATIVE == tolerances.FLOAT32
    assert adversarial.OF_PEAK == tolerances.FLOAT32_OF_PEAK
    assert adversarial.NEARLY_GRAZING == tolerances.NEARLY_GRAZING


def test_points_end_with_the_time_and_the_record_says_where() -> None:
    found = examine(Lambert(), 10 * TILE, seconds=0.0)
    assert found[0].metric == "points"
    assert found[0].value == TILE
