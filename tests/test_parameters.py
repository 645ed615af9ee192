"""Domains of parameters and their declarations."""

from __future__ import annotations

import math

import pytest
import torch

from matest.brdf import MODELS, CookTorrance, LiTorrance, OrenNayar
from matest.parameters import Domain, interval, non_negative, options_of, parameters_of, unit_interval
from tests import tolerances

DOMAINS = pytest.mark.parametrize(
    "domain", [unit_interval, non_negative, interval(0, math.pi / 2), interval(1e-3, 1), interval(2, math.inf)], ids=str
)


def inside(domain: Domain, dtype: torch.dtype) -> torch.Tensor:
    share = torch.tensor([0.001, 0.1, 0.5, 0.9, 0.999], dtype=dtype)
    return domain.lower + share * (domain.width if math.isfinite(domain.width) else 100.0)


@DOMAINS
@pytest.mark.parametrize(
    ("dtype", "tolerance"),
    [(torch.float64, tolerances.ROUND_TRIP), (torch.float32, tolerances.ROUND_TRIP_FLOAT32)],
    ids=["float64", "float32"],
)
def test_unconstrained_and_back_is_where_one_started(domain: Domain, dtype: torch.dtype, tolerance: float) -> None:
    values = inside(domain, dtype)
    torch.testing.assert_close(domain.physical(domain.unconstrained(values)), values, rtol=tolerance, atol=0)


@DOMAINS
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32], ids=["float64", "float32"])
def test_the_real_line_maps_into_the_domain(domain: Domain, dtype: torch.dtype) -> None:
    raw = torch.tensor([-1e30, -1e3, -50.0, -1.0, 0.0, 1.0, 50.0, 1e3, 1e30], dtype=dtype)
    values = domain.physical(raw)
    assert values.isfinite().all()
    assert domain.contains(values)
    assert domain.contains(values.double())  # as numbers they are checked in float64
    assert (values.diff() >= 0).all()


@DOMAINS
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32], ids=["float64", "float32"])
def test_ends_of_the_domain_start_a_millionth_inside(domain: Domain, dtype: torch.dtype) -> None:
    width = domain.width if math.isfinite(domain.width) else 1.0
    ends = torch.tensor([end for end in (domain.lower, domain.upper) if math.isfinite(end)], dtype=dtype)
    raw = domain.unconstrained(ends).requires_grad_()
    assert raw.isfinite().all()
    values = domain.physical(raw)
    torch.testing.assert_close(values.detach(), ends, rtol=0, atol=tolerances.END_OF_DOMAIN * max(width, 1.0))
    values.sum().backward()
    assert raw.grad is not None
    assert (raw.grad > 0).all()


@pytest.mark.parametrize(
    ("value", "contained"),
    [(0.0, True), (1.0, True), (0.5, True), (-1e-9, False), (1.1, False), (math.nan, False), (math.inf, False)],
)
def test_the_unit_interval_is_closed_and_has_no_nan(value: float, contained: bool) -> None:
    assert unit_interval.contains(torch.tensor(value, dtype=torch.float64)) is contained


def test_one_value_outside_is_enough() -> None:
    assert not unit_interval.contains(torch.tensor([0.5, 0.5, 1.5]))


def test_lifted_domain_keeps_its_lower_end_only() -> None:
    assert interval(0.1, 1).lifted() == interval(0.1, math.inf)


def test_domains_read_as_intervals() -> None:
    assert str(interval(0, math.pi / 2)) == "[0, 1.57]"
    assert str(non_negative) == "[0, inf)"


def test_declarations_keep_their_order_and_leave_options_out() -> None:
    assert list(parameters_of(CookTorrance)) == [
        *("diffuse", "specular", "slope", "f0", "f0_mean", "eta", "k"),
        *("slope_2", "slope_3", "weight_2", "weight_3"),
    ]
    assert list(options_of(CookTorrance)) == [
        *("distribution", "lobes", "masking", "fresnel", "weights", "normalisation"),
    ]
    assert options_of(OrenNayar) == {}


@pytest.mark.parametrize("name", MODELS)
def test_defaults_lie_in_their_domains(name: str) -> None:
    brdf = MODELS[name]()
    for key, declared in parameters_of(MODELS[name]).items():
        assert declared.domain.contains(torch.as_tensor(getattr(brdf, key)))
        assert declared.doc
        assert declared.unit in ("1", "rad", "µm", "sr")
        if declared.held is not None:
            assert declared.domain.contains(torch.tensor(declared.held))


@pytest.mark.parametrize("name", MODELS)
def test_defaults_of_options_are_choices(name: str) -> None:
    brdf = MODELS[name]()
    for key, choices in options_of(MODELS[name]).items():
        assert getattr(brdf, key) in choices


def test_slopes_of_a_derived_quantity_are_its_derivatives_by_what_it_depends_on() -> None:
    quantity = LiTorrance().derived["slope_ratio"]
    values = {name: torch.tensor(value).double() for name, value in (("height_rms", 0.5), ("correlation_length", 4.0))}
    assert float(quantity.value(values)) == 0.125
    assert quantity.slopes(values) == pytest.approx({"height_rms": 0.25, "correlation_length": -0.5 / 16})
    beside = {f"rough.{name}": value for name, value in values.items()} | {"height_rms": torch.tensor(9.0)}
    inside = quantity.within("rough")
    assert inside.slopes(beside).keys() == {"rough.height_rms", "rough.correlation_length"}
    assert float(inside.inverse(inside.value(beside), beside)) == 4.0
