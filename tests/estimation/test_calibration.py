"""Which errors of the calibration are refined, which are allowed for, and what the result says of them."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

import matest
from matest import InputError
from matest.benchmark.instruments import miscalibration as off
from matest.brdf import CookTorrance, Lambert, OrenNayar
from matest.report.calibration import error_rows, legend
from matest.scene import EnvironmentLight
from matest.scene.environment import environment_of
from tests.environments import studio_map
from tests.miscalibrated import STUDIO, brighter, normal_deviates, photographed, under_sky
from tests.simulated import Studio

MATERIAL = OrenNayar([0.7, 0.5, 0.3], 0.4)
SMALL = Studio(size=40, lights=STUDIO.lights)


def test_stated_errors_of_single_lights_have_no_effect_under_a_map_and_the_result_says_so() -> None:
    light = EnvironmentLight(environment_of(studio_map(16, channels=3), 32))
    studio = Studio(size=20, lights=((light,),))
    estimate = matest.estimate(
        studio.photograph(Lambert([0.6, 0.5, 0.4])), "lambert", uncertainty={"direction": 0.02, "scale": 0.03}
    )
    (said,) = (warning for warning in estimate.warnings if "has no effect" in warning)
    assert "uncertainty of direction" in said
    assert "state rotation instead" in said
    assert [*estimate.nuisance] == ["scale"]


def test_a_result_says_what_was_refined_and_what_was_allowed_for() -> None:
    errors = 0.03 * normal_deviates(8, seed=1)
    estimate = matest.estimate(
        photographed(MATERIAL, brighter(errors), 1),
        "oren-nayar",
        uncertainty={"intensity": 0.03, "pose": (0.5, 0.01)},
        refine="intensity",
    )
    content = json.loads(json.dumps(estimate.to_dict()))["nuisance"]
    # The turn of a sphere has no effect.
    assert [*content] == ["intensity", "shift"]
    assert content["intensity"]["refined"]
    assert content["intensity"]["prior_std"] == pytest.approx(0.03)
    assert len(content["intensity"]["value"]) == len(content["intensity"]["std"]) == 8
    assert content["shift"]["value"] is None
    assert content["shift"]["adds"]["sigma"] > 0
    assert [cells[0] for cells in error_rows(estimate)] == ["intensity", "shift (pose)"]


def test_all_stands_for_what_has_an_effect_and_is_no_special_case() -> None:
    capture = photographed(MATERIAL, under_sky(0.02), 1, SMALL)
    refined = {*matest.estimate(capture, "oren-nayar", refine="all").nuisance}
    assert {"direction", "intensity", "ambient", "black", "albedo_field", "normals", "blur"} < refined
    assert not refined & {"tilt", "rotation", "scale", "exposure", "normal_noise"}


@pytest.mark.parametrize(
    ("family", "error", "size"),
    [("albedo_field", off.smooth_albedo(0.1), 0.1), ("normals", off.smooth_normals(0.02), 0.02)],
)
def test_the_size_of_a_smooth_field_is_its_rms_over_the_object(family: str, error: off.Error, size: float) -> None:
    generator = np.random.default_rng(5)
    stated = off.Setting(off.ball(), torch.stack([light.direction for (light,) in STUDIO.lights]).numpy(), np.ones(8))
    capture = off.photograph(stated, error(stated, generator), MATERIAL, "albedo", generator)
    estimate = matest.estimate(capture, "oren-nayar", refine=family.removesuffix("_field"))
    assert estimate.nuisance[family].size == pytest.approx(size, rel=0.1)


def test_errors_are_refined_by_the_name_of_the_option_or_of_the_result() -> None:
    capture = photographed(MATERIAL, under_sky(0.0), 1, SMALL)
    by_option, by_result = (matest.estimate(capture, "oren-nayar", refine=name) for name in ("pose", "shift"))
    assert [*by_option.nuisance] == [*by_result.nuisance] == ["shift"]
    assert by_option.parameters == by_result.parameters


def test_errors_that_cannot_be_refined_are_refused_with_the_reason() -> None:
    capture = photographed(MATERIAL, under_sky(0.0), 1, SMALL)
    with pytest.raises(InputError, match="--refine normal_noise: errors of the normals of single pixels"):
        matest.estimate(capture, "oren-nayar", refine="normal_noise")
    with pytest.raises(InputError, match="--refine albedo: the model has no diffuse body"):
        matest.estimate(capture, "torrance-sparrow", refine="albedo")
    with pytest.raises(InputError, match="--refine albedo_field: the model has no diffuse body"):
        matest.estimate(capture, "torrance-sparrow", refine="albedo_field")


def test_a_body_under_gloss_may_vary_and_a_metal_may_not() -> None:
    gloss = CookTorrance([0.4, 0.2, 0.1], 0.8, 0.25, f0=0.04)
    capture = photographed(gloss, under_sky(0.0), 1, SMALL)
    assert "albedo_field" in matest.estimate(capture, "cook-torrance", fix={"f0": 0.04}, refine="albedo").nuisance


def test_lights_of_unknown_scale_have_errors_that_are_zero_on_average() -> None:
    capture = photographed(Lambert([0.7, 0.5, 0.3]), brighter(0.05 * normal_deviates(8, seed=3)), 1)
    relative = replace(capture, photographs=replace(capture.photographs, relative=True))
    estimate = matest.estimate(relative, "lambert", refine="intensity")
    assert abs(sum(estimate.nuisance["intensity"].value)) < 1e-3


def test_a_misfit_that_refining_does_not_explain_is_told() -> None:
    gloss = CookTorrance([0.4, 0.2, 0.1], 0.8, 0.2, f0=0.04)
    estimate = matest.estimate(photographed(gloss, under_sky(0.0), 1), "lambert", refine="intensity,black,pose")
    assert not estimate.fit.message.endswith("to their noise.")
    assert "due to a lobe that the model does not have" in estimate.warnings[0]


def test_a_misfit_that_nothing_explains_is_told_beside_refined_errors() -> None:
    capture = photographed(MATERIAL, under_sky(0.0), 1)
    # The photographs are of something else: their pixels are in any order.
    shuffled = tuple(np.random.default_rng(0).permutation(image) for image in capture.photographs.stored)
    capture = replace(capture, photographs=replace(capture.photographs, stored=shuffled))
    estimate = matest.estimate(capture, "lambert", refine="intensity,black,pose")
    said = "does not hold with errors of intensity, black and shift (pose) refined either"
    assert any(said in warning for warning in estimate.warnings)


def test_a_blur_is_told_by_its_width() -> None:
    capture = photographed(MATERIAL, under_sky(0.0), 1, SMALL)
    estimate = matest.estimate(capture, "oren-nayar", uncertainty={"blur": 0.5})
    (cells,) = error_rows(estimate)
    assert cells[3] == "0.5 px (stated)"
    assert "Size" not in legend(estimate)


def test_nothing_is_said_of_the_calibration_where_nothing_is_asked() -> None:
    assert matest.estimate(photographed(MATERIAL, under_sky(0.0), 1, SMALL), "oren-nayar").nuisance == {}
