"""The values that errors are predicted for."""

from __future__ import annotations

import pytest
import torch

from matest.brdf import CookTorrance, Lambert
from matest.estimation.options import Options
from matest.estimation.specification import specify
from matest.identifiability import check
from matest.identifiability.nominal import Nominal
from tests.captures import refusal
from tests.identifiability.subjects import studio
from tests.simulated import DIRECTIONS


@pytest.mark.usefixtures("without_advice")
def test_shape_parameters_that_nobody_gave_are_tried_at_other_values() -> None:
    capture = studio(DIRECTIONS).photograph(Lambert(0.5), 1)
    found = check(capture, "oren-nayar")
    assert found.levels == {"sigma": pytest.approx([0.15, 0.3, 0.6])}
    several = [check(capture, "oren-nayar", at={"sigma": value}) for value in (0.15, 0.3, 0.6)]
    assert all(one.levels == {} and one.parameters["sigma"].range is None for one in several)
    relative = [one.parameters["sigma"].relative for one in several]
    assert found.parameters["sigma"].range == pytest.approx((min(relative), max(relative)), rel=1e-6)


def test_values_that_make_no_sense_are_refused() -> None:
    capture = studio(DIRECTIONS).photograph(CookTorrance(), 1)
    assert "did you mean" in refusal(lambda: check(capture, "cook-torrance", at={"slop": 0.1}))
    assert "must lie in" in refusal(lambda: check(capture, "cook-torrance", at={"slope": 3.0}))
    assert "fixed" in refusal(lambda: check(capture, "cook-torrance", fix={"slope": 0.1}, at={"slope": 0.2}))
    assert "takes 1 value" in refusal(lambda: check(capture, "cook-torrance", at={"slope": [0.1, 0.2]}))


def test_assumed_values_come_before_the_scenes_and_these_before_the_defaults() -> None:
    specification = specify("cook-torrance", Options(), channels=1, relative=False)
    scene = {"diffuse": torch.tensor(0.3), "specular": torch.tensor(0.7), "f0": torch.tensor(0.06)}
    nominal = Nominal.of(specification, scene, {"diffuse": 0.2})
    default = float(specification.problem.brdf.parameters["slope"])
    values = {"diffuse": 0.2, "specular": 0.7, "slope": default, "f0": 0.06}
    assert {name: float(value) for name, value in nominal.values.items()} == pytest.approx(values)
    # A parameter that is held by default is held at the scene's value.
    assert float(nominal.problem.held["f0"]) == pytest.approx(0.06)
    assert nominal.tried == {"slope": pytest.approx([default / 2, default, 2 * default])}


def test_tied_parameters_take_the_values_of_their_sources_at_every_level() -> None:
    options = Options(tie={"torrance-sparrow.sigma": "oren-nayar.sigma"})
    nominal = Nominal.of(specify("oren-nayar+torrance-sparrow", options, channels=1, relative=False), {}, {})
    levels = [nominal.values, *nominal.levels]
    assert len(levels) == 3
    assert all(level["torrance-sparrow.sigma"] == level["oren-nayar.sigma"] for level in levels)
