"""With maps, `auto` chooses by photographs left out of fits in which every pixel has its own values."""

from __future__ import annotations

import pytest

import matest
from matest import InputError
from matest.benchmark.instruments import miscalibration as off
from matest.benchmark.instruments.photographs import vase
from matest.estimation.map_selection import CANDIDATES
from tests.estimation.test_diagnosis import GLOSS, capture_of


def test_a_gloss_is_found_though_the_body_varies() -> None:
    capture = capture_of(off.two_regions(0.4), 1, vase(off.SIZE), GLOSS, "diffuse")
    estimate = matest.estimate(capture, maps="albedo")
    assert "cook-torrance" in estimate.model
    assert estimate.fit.reduced_chi2 < 1.2
    (chosen,) = [each for each in estimate.candidates if each.chosen]
    assert chosen.model == estimate.model
    assert "predicts images left out better than" in chosen.reason or "meets images left out" in chosen.reason


def test_a_matte_body_that_varies_is_not_given_a_gloss() -> None:
    estimate = matest.estimate(capture_of(off.two_regions(0.4), 1), maps="albedo")
    assert estimate.model == "oren-nayar"
    lambert, chosen = estimate.candidates[:2]
    assert chosen.chosen
    # Of photographs left out, albedos of a pixel by the others.
    assert chosen.score < 1.35 < lambert.score
    low, high = estimate.parameters["sigma"].interval95
    assert low < 0.4 < high


def test_a_map_that_no_candidate_has_is_refused_with_those_that_there_are() -> None:
    sentence = r"--maps gloss: no model that 'auto' tries can have these maps; name some of albedo, .*sigma, slope"
    with pytest.raises(InputError, match=sentence):
        matest.estimate(capture_of(off.two_regions(0.4), 1), maps="gloss")


def test_a_value_that_no_candidate_takes_is_refused_for_what_is_wrong_with_it() -> None:
    with pytest.raises(InputError, match=r"no model that 'auto' tries takes what was said of sigma \(.*rad.*\)"):
        matest.estimate(capture_of(off.two_regions(0.4), 1), maps="albedo", fix={"sigma": 7.0})


def test_with_too_few_photographs_the_model_is_chosen_without_maps_which_is_said() -> None:
    capture = capture_of(off.two_regions(0.4), 1)
    few = matest.estimate(capture, maps="albedo", holdout=range(2, len(capture)))
    assert any("chosen with one value of albedo for all pixels" in note for note in few.warnings)
    # The map has its say after that choice: what one albedo leaves is no fault of the capture.
    assert not any("look for an albedo that varies" in note for note in few.warnings)
    more = matest.estimate(capture, maps="albedo", holdout=range(3, len(capture)))
    assert not any("for all pixels" in note for note in more.warnings)
    assert [each.model for each in more.candidates] == [*CANDIDATES]
