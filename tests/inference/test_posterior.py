"""The posterior of small captures: a number, a bound, or nothing for every parameter."""

from __future__ import annotations

import ast
from dataclasses import FrozenInstanceError
from functools import cache
from pathlib import Path

import pytest
import torch

from matest import inference
from matest.brdf import CookTorrance, Lambert, OrenNayar
from matest.inference.expansion import Expansion
from matest.inference.posterior import foresee, judge, judge_to_first_order
from matest.inference.quantities import ParameterEstimate
from tests.inference.judged import Judged, judged, solved, source
from tests.simulated import Studio, coloured

STUDIO = Studio(size=24)


@pytest.fixture(scope="module")
def rough() -> Judged:
    capture = Studio(size=24, lights=coloured()).photograph(OrenNayar([0.6, 0.5, 0.3], 0.4), 0)
    return judged(capture, "oren-nayar")


def test_a_determined_parameter_has_a_value_an_error_bar_and_an_interval(rough: Judged) -> None:
    sigma = rough.posterior.estimates["sigma"]
    assert sigma.status == "determined"
    assert (sigma.unit, sigma.doc) == ("rad", "std. deviation of the facet slope angle")
    assert sigma.value == pytest.approx(0.4, abs=4 * sigma.std)
    low, high = sigma.interval95
    assert (high - low) / 2 == pytest.approx(1.96 * sigma.std, rel=1e-3)


def test_a_value_on_a_bound_that_nothing_holds_there_has_a_one_sided_interval() -> None:
    metal = judged(Studio(size=32).photograph(CookTorrance(0.0, 1.0, 0.2), 5), "cook-torrance")
    position, diffuse = next(iter(metal.positions("diffuse"))), metal.posterior.estimates["diffuse"]
    assert float(metal.solution.unknowns[position]) == 0
    assert not bool(metal.posterior.bars.bound[position])
    assert (diffuse.value, diffuse.std, diffuse.status) == (0.0, None, "at bound")
    low, high = diffuse.interval95
    assert low == 0
    assert 0 < high < 0.001


def test_a_parameter_per_channel_is_a_list(rough: Judged) -> None:
    albedo = rough.posterior.estimates["albedo"]
    assert len(albedo.value) == len(albedo.std) == len(albedo.interval95) == 3


def test_a_gauge_of_absolute_radiometry_is_not_reported(rough: Judged) -> None:
    assert [*rough.posterior.estimates] == ["albedo", "sigma"]


def test_a_gauge_that_drops_the_second_bounce_is_reported_as_fixed() -> None:
    found = judged(STUDIO.photograph(Lambert(0.6), 0), "oren-nayar", fix={"interreflection": 0.0, "sigma": 0.3})
    assert found.posterior.estimates["interreflection"].status == "fixed"
    assert found.posterior.estimates["sigma"] == ParameterEstimate(
        0.3, None, None, "rad", "fixed", "std. deviation of the facet slope angle"
    )


def test_a_tied_parameter_has_the_numbers_of_its_source() -> None:
    material = OrenNayar(0.5, 0.3)
    tie = {"torrance-sparrow.sigma": "oren-nayar.sigma"}
    found = judged(STUDIO.photograph(material, 0), "oren-nayar+torrance-sparrow", tie=tie).posterior.estimates
    tied, source = found["torrance-sparrow.sigma"], found["oren-nayar.sigma"]
    assert (tied.value, tied.std, tied.interval95) == (source.value, source.std, source.interval95)
    assert (tied.status, source.status) == ("tied", "determined")


def test_a_value_at_its_bound_has_an_interval_and_no_error_bar() -> None:
    bright = STUDIO.photograph(Lambert(0.9), 2, brightness=1.3)
    albedo = judged(bright, "lambert").posterior.estimates["albedo"]
    assert (albedo.value, albedo.std, albedo.status) == (1.0, None, "at bound")
    assert albedo.interval95[1] == 1.0


def test_the_scale_of_relative_light_has_no_upper_end() -> None:
    bright = Studio(size=24, relative=True).photograph(Lambert(0.9), 2, brightness=1.3)
    albedo = judged(bright, "lambert").posterior.estimates["albedo"]
    assert albedo.status == "determined"
    assert albedo.value > 1.1


def test_what_is_seen_only_together_is_not_determined() -> None:
    found = judged(STUDIO.photograph(Lambert(0.6), 0), "lambert+cook-torrance", free=("diffuse",),
                   fix={"specular": 0.0, "slope": 0.3})  # fmt: skip
    both = {"lambert.albedo", "cook-torrance.diffuse"}
    assert {name for name, estimate in found.posterior.estimates.items() if estimate.status == "not determined"} == both
    assert found.posterior.seen_together == both


def test_a_posterior_is_complete_when_it_is_made(rough: Judged) -> None:
    posterior = rough.posterior
    assert posterior.bars.holds
    assert posterior.not_determined == []
    assert [*posterior.labels] == ["albedo[0]", "albedo[1]", "albedo[2]", "sigma"]
    assert len(posterior.correlation) == 4
    with pytest.raises(FrozenInstanceError):
        posterior.estimates = {}  # type: ignore[misc]


def test_to_first_order_a_parameter_far_from_bounds_and_valleys_is_the_same(rough: Judged) -> None:
    first = judge_to_first_order(rough.solution, rough.samples)
    assert first.estimates == rough.posterior.estimates


def test_what_is_foreseen_is_what_samples_that_hold_the_model_would_say(rough: Judged) -> None:
    foreseen = foresee(Expansion.of(rough.solution))
    for name, estimate in foreseen.estimates.items():
        assert estimate.value == rough.posterior.estimates[name].value
        assert estimate.std == pytest.approx(rough.posterior.estimates[name].std)
        assert estimate.status == "determined"


def test_whatever_fulfils_the_protocol_of_samples_can_be_judged() -> None:
    posterior = judge(solved(torch.zeros(6, 2)), source(6))
    assert posterior.estimates["albedo"].std == pytest.approx(600**-0.5)


@pytest.mark.parametrize("file", sorted(Path(inference.__file__).parent.glob("*.py")), ids=lambda file: file.name)
def test_inference_knows_no_files_and_no_photographs(file: Path) -> None:
    nodes = [node for node in ast.walk(ast.parse(file.read_text("utf-8"))) if isinstance(node, ast.ImportFrom)]
    assert not [node.module for node in nodes if str(node.module).startswith(("matest.capture", "matest.photographs"))]


@cache
def smooth(expression: str, seed: int, fixed: bool = False) -> ParameterEstimate:
    """The albedo of a smooth surface under lights of unknown strength."""
    capture = Studio(size=24, relative=True).photograph(OrenNayar(0.6, 0.0), seed)
    found = judged(capture, expression, fix={"interreflection": 0.0} if fixed else {}).posterior.estimates
    assert fixed or found["interreflection"].status == "not determined"
    return found["albedo"]


@pytest.mark.parametrize("seed", [1, 3])
def test_a_gauge_without_effect_takes_nothing_from_an_albedo(seed: int) -> None:
    # Two facets that face the same way send no light to each other: at sigma = 0 there is no second bounce.
    albedo = smooth("oren-nayar-exact", seed)
    assert albedo.status == "determined"
    assert albedo.std == pytest.approx(smooth("oren-nayar-exact", seed, fixed=True).std, rel=0.3)


def test_near_a_smooth_surface_error_bars_hang_little_on_where_a_gauge_ends() -> None:
    # By chance sigma ends at 0 or a little above it, and the gauge at either end of its domain.
    errors = [smooth("oren-nayar", seed).std for seed in (0, 4, 5, 7, 8)]
    assert max(errors) < 2 * min(errors)
