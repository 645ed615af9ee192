"""What error bars make of each parameter: a number, a bound, or nothing; ratios and the names of what is known."""

from __future__ import annotations

import pytest

from matest.brdf import Lambert, LiTorrance, OrenNayar
from matest.inference.parameter_estimates import (
    known_by_ratio,
    numerator_of,
    reported_correlation,
    reported_labels,
    reported_name,
    seen_together,
)
from matest.inference.quantities import ParameterEstimate
from tests.inference.judged import Judged, judged
from tests.simulated import Studio, coloured

STUDIO = Studio(size=24)


@pytest.fixture(scope="module")
def rough() -> Judged:
    capture = Studio(size=24, lights=coloured()).photograph(OrenNayar([0.6, 0.5, 0.3], 0.4), 0)
    return judged(capture, "oren-nayar")


@pytest.fixture(scope="module")
def corrugated() -> Judged:
    return judged(STUDIO.photograph(LiTorrance(), 0), "li-torrance")


def test_a_determined_parameter_has_a_value_an_error_bar_and_an_interval(rough: Judged) -> None:
    sigma = rough.estimates["sigma"]
    assert sigma.status == "determined"
    assert (sigma.unit, sigma.doc) == ("rad", "std. deviation of the facet slope angle")
    assert sigma.value == pytest.approx(0.4, abs=4 * sigma.std)
    low, high = sigma.interval95
    assert (high - low) / 2 == pytest.approx(1.96 * sigma.std, rel=1e-3)


def test_a_parameter_per_channel_is_a_list(rough: Judged) -> None:
    albedo = rough.estimates["albedo"]
    assert len(albedo.value) == len(albedo.std) == len(albedo.interval95) == 3


def test_a_gauge_of_absolute_radiometry_is_not_reported(rough: Judged) -> None:
    assert [*rough.estimates] == ["albedo", "sigma"]


def test_a_gauge_that_drops_the_second_bounce_is_reported_as_fixed() -> None:
    found = judged(STUDIO.photograph(Lambert(0.6), 0), "oren-nayar", fix={"interreflection": 0.0, "sigma": 0.3})
    assert found.estimates["interreflection"].status == "fixed"
    assert found.estimates["sigma"] == ParameterEstimate(
        0.3, None, None, "rad", "fixed", "std. deviation of the facet slope angle"
    )


def test_a_tied_parameter_has_the_numbers_of_its_source() -> None:
    material = OrenNayar(0.5, 0.3)
    tie = {"torrance-sparrow.sigma": "oren-nayar.sigma"}
    found = judged(STUDIO.photograph(material, 0), "oren-nayar+torrance-sparrow", tie=tie).estimates
    tied, source = found["torrance-sparrow.sigma"], found["oren-nayar.sigma"]
    assert (tied.value, tied.std, tied.interval95) == (source.value, source.std, source.interval95)
    assert (tied.status, source.status) == ("tied", "determined")


def test_a_value_at_its_bound_has_an_interval_and_no_error_bar() -> None:
    bright = STUDIO.photograph(Lambert(0.9), 2, brightness=1.3)
    albedo = judged(bright, "lambert").estimates["albedo"]
    assert (albedo.value, albedo.std, albedo.status) == (1.0, None, "at bound")
    assert albedo.interval95[1] == 1.0


def test_the_scale_of_relative_light_has_no_upper_end() -> None:
    bright = Studio(size=24, relative=True).photograph(Lambert(0.9), 2, brightness=1.3)
    albedo = judged(bright, "lambert").estimates["albedo"]
    assert albedo.status == "determined"
    assert albedo.value > 1.1


def test_what_is_seen_only_together_is_not_determined() -> None:
    found = judged(STUDIO.photograph(Lambert(0.6), 0), "lambert+cook-torrance", free=("diffuse",),
                   fix={"specular": 0.0, "slope": 0.3})  # fmt: skip
    both = {"lambert.albedo", "cook-torrance.diffuse"}
    assert {name for name, estimate in found.estimates.items() if estimate.status == "not determined"} == both
    assert seen_together(found.solution, found.bars) == both


def test_a_length_of_which_only_the_ratio_has_an_effect_is_reported_as_that_ratio(corrugated: Judged) -> None:
    problem, found = corrugated.solution.problem, corrugated.estimates
    ratio = found["slope_ratio"]
    assert ratio.status == "determined"
    assert (ratio.unit, ratio.doc) == ("1", "height_rms / correlation_length")
    truth = float(LiTorrance().height_rms / LiTorrance().correlation_length)
    assert ratio.value == pytest.approx(truth, abs=4 * ratio.std)
    assert ratio.interval95[0] < ratio.value < ratio.interval95[1]
    for length in ("height_rms", "correlation_length"):
        assert found[length].status == "not determined"
        assert found[length].value is None
    assert known_by_ratio(problem, "correlation_length")
    assert known_by_ratio(problem, "height_rms")
    assert not known_by_ratio(problem, "k_dd")
    assert numerator_of(problem, "correlation_length") == "height_rms"
    assert reported_name(problem, "correlation_length") == "slope_ratio"
    assert reported_name(problem, "k_dd") == "k_dd"


def test_the_correlation_of_a_length_is_that_of_the_ratio_it_stands_for(corrugated: Judged) -> None:
    labels = reported_labels(corrugated.solution.problem)
    assert "slope_ratio" in labels
    matrix = reported_correlation(corrugated.solution, corrugated.bars)
    ratio, other = labels.index("slope_ratio"), labels.index("k_dd")
    assert matrix[ratio][ratio] == pytest.approx(1)
    assert matrix[ratio][other] == pytest.approx(-float(corrugated.bars.covariance.correlation[ratio, other]))


def test_labels_name_channels(rough: Judged) -> None:
    assert reported_labels(rough.solution.problem) == ["albedo[0]", "albedo[1]", "albedo[2]", "sigma"]
