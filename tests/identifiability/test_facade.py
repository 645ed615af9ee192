"""What is predicted before a fit, against the fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import matest
from matest.brdf import Lambert
from matest.identifiability import check
from matest.simulate import simulate
from tests import scenes
from tests.identifiability.subjects import FIXED, LIGHTS, VALUES, checked, photograph, studio
from tests.inference.judged import judged
from tests.simulated import DIRECTIONS


@pytest.mark.usefixtures("without_advice")
@pytest.mark.parametrize("count", LIGHTS)
@pytest.mark.parametrize("name", VALUES)
def test_predicted_standard_errors_are_those_found_within_ten_per_cent(name: str, count: int) -> None:
    where = studio(LIGHTS[count])
    # The photographs are of something else: only geometry, lights and noise count.
    predicted = checked(where.photograph(Lambert(0.2), seed=1), name, at=VALUES[name]).parameters
    found = matest.estimate(photograph(where, name, seed=2), name, fix=FIXED[name]).parameters
    for parameter in (*VALUES[name], "slope_ratio"):
        if parameter not in predicted or predicted[parameter].status in ("fixed", "not determined"):
            assert name == "li-torrance" or parameter == "slope_ratio"
            continue
        assert np.ravel(predicted[parameter].std) == pytest.approx(np.ravel(found[parameter].std), rel=0.1)
        assert predicted[parameter].status == "determined"


@pytest.mark.usefixtures("without_advice")
def test_predicted_standard_errors_are_the_scatter_of_repeated_photographs() -> None:
    where = studio(DIRECTIONS[:3], size=32)
    predicted = checked(photograph(where, "lambert", 0), "lambert", at=VALUES["lambert"]).parameters["albedo"]
    estimates = [judged(photograph(where, "lambert", k), "lambert").posterior.estimates for k in range(60)]
    values = [estimate["albedo"].value for estimate in estimates]
    # The scatter of 60 is known to 9 %: three times that.
    assert np.std(np.ravel(values), ddof=1) == pytest.approx(np.ravel(predicted.std)[0], rel=0.28)


@pytest.mark.usefixtures("without_advice")
def test_a_scene_is_predicted_as_its_rendered_capture(tmp_path: Path) -> None:
    material = scenes.material("cook-torrance", diffuse=0.4, specular=0.8, slope=0.2, f0=0.04)
    file = scenes.write(tmp_path / "s", material, scenes.sphere(64), scenes.noise(), scenes.distant(scenes.LIGHTS[:3]))
    planned = check(matest.load_plan(file))
    assert planned.model == "cook-torrance"
    assert planned.levels == {}
    rendered = matest.load_plan(simulate(file, tmp_path / "capture"))
    assert rendered.photographs.stored[0].any()
    taken = check(rendered, "cook-torrance", at={"diffuse": 0.4, "specular": 0.8, "slope": 0.2, "f0": 0.04})
    for name, parameter in planned.parameters.items():
        assert taken.parameters[name].status == parameter.status
        if parameter.std is not None:
            assert np.ravel(taken.parameters[name].std) == pytest.approx(np.ravel(parameter.std), rel=0.03)


@pytest.mark.usefixtures("without_advice")
def test_under_unknown_light_strength_albedo_and_light_scale_are_locked() -> None:
    found = check(studio(DIRECTIONS, relative=True).photograph(Lambert(0.5), 1), "lambert")
    assert found.parameters["albedo"].reason.startswith("albedo and the light scale are locked")
    assert any("relative" in warning for warning in found.warnings)
    assert check(studio(DIRECTIONS).photograph(Lambert(0.5), 1), "lambert").parameters["albedo"].reason == ""
