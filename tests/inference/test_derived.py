"""Derived quantities: ratios, and what stands for a parameter of which only a ratio is seen."""

from __future__ import annotations

import pytest

from matest.brdf import LiTorrance
from matest.inference.derived import reported_correlation, reported_labels, reported_name, shows_only_in_derived
from matest.inference.expansion import Expansion
from tests.inference.judged import Judged, judged
from tests.problems import problem
from tests.simulated import Studio


@pytest.fixture(scope="module")
def corrugated() -> Judged:
    return judged(Studio(size=24).photograph(LiTorrance(), 0), "li-torrance")


def test_a_length_of_which_only_the_ratio_has_an_effect_is_reported_as_that_ratio(corrugated: Judged) -> None:
    model, found = corrugated.solution.problem, corrugated.posterior.estimates
    ratio = found["slope_ratio"]
    assert ratio.status == "determined"
    assert (ratio.unit, ratio.doc) == ("1", "height_rms / correlation_length")
    truth = float(LiTorrance().height_rms / LiTorrance().correlation_length)
    assert ratio.value == pytest.approx(truth, abs=4 * ratio.std)
    assert ratio.interval95[0] < ratio.value < ratio.interval95[1]
    for length in ("height_rms", "correlation_length"):
        assert found[length].status == "not determined"
        assert found[length].value is None
    assert shows_only_in_derived(model, "correlation_length")
    assert shows_only_in_derived(model, "height_rms")
    assert not shows_only_in_derived(model, "k_dd")
    assert reported_name(model, "correlation_length") == "slope_ratio"
    assert reported_name(model, "k_dd") == "k_dd"


def test_the_correlation_of_a_length_is_that_of_the_ratio_it_stands_for(corrugated: Judged) -> None:
    labels = reported_labels(corrugated.solution.problem)
    assert "slope_ratio" in labels
    matrix = reported_correlation(Expansion.of(corrugated.solution), corrugated.posterior.bars)
    ratio, other = labels.index("slope_ratio"), labels.index("k_dd")
    assert matrix[ratio][ratio] == pytest.approx(1)
    assert matrix[ratio][other] == pytest.approx(-float(corrugated.posterior.bars.covariance.correlation[ratio, other]))


def test_labels_name_channels() -> None:
    colours = problem("oren-nayar", channels=3)
    assert reported_labels(colours) == ["albedo[0]", "albedo[1]", "albedo[2]", "sigma"]
