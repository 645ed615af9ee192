"""With maps, `auto` chooses by photographs left out of fits in which every pixel has its own values."""

from __future__ import annotations

import pytest

import matest
from matest import InputError
from matest.benchmark.instruments import miscalibration as off
from matest.benchmark.instruments.photographs import vase
from tests.estimation.test_diagnosis import GLOSS, capture_of


def test_a_gloss_is_found_though_the_body_varies() -> None:
    capture = capture_of(off.two_regions(0.4), 1, vase(off.SIZE), GLOSS, "diffuse")
    estimate = matest.estimate(capture, maps="albedo")
    assert "cook-torrance" in estimate.model
    assert estimate.fit.reduced_chi2 < 1.2
    (chosen,) = [each for each in estimate.candidates if each.chosen]
    assert chosen.model == estimate.model
    assert "as well as any" in chosen.reason


def test_a_matte_body_that_varies_is_not_given_a_gloss() -> None:
    estimate = matest.estimate(capture_of(off.two_regions(0.4), 1), maps="albedo")
    assert estimate.model == "oren-nayar"
    low, high = estimate.parameters["sigma"].interval95
    assert low < 0.4 < high


def test_a_map_that_no_candidate_has_is_refused() -> None:
    with pytest.raises(InputError, match="--maps gloss"):
        matest.estimate(capture_of(off.two_regions(0.4), 1), maps="gloss")
