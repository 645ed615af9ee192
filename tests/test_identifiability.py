"""What is predicted before a fit: against the fit, and against what is known to be undetermined."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import matest
from matest.brdf import CookTorrance, Lambert, model
from matest.capture import Capture
from matest.estimation.options import Options
from matest.estimation.specification import specify
from matest.identifiability import Check, Plan, check
from matest.identifiability.forecast import forecast, predicted_samples
from matest.identifiability.highlight import Nearness
from matest.identifiability.next_light import hemisphere
from matest.identifiability.reasons import Reasons
from matest.photographs.noise import Noise
from matest.photographs.photometry import Encoding
from matest.simulate import simulate
from tests import scenes
from tests.captures import changed, directional, refusal
from tests.simulated import CAMERA, DIRECTIONS, Studio

RING = tuple(
    (math.cos(a) * math.sin(tilt), math.sin(a) * math.sin(tilt), math.cos(tilt))
    for tilt in (0.4, 0.9)
    for a in np.arange(6) * math.pi / 3 + tilt
)
LIGHTS = {1: DIRECTIONS[:1], 3: DIRECTIONS[:3], 12: RING}
VALUES: dict[str, dict[str, float]] = {
    "lambert": {"albedo": 0.6},
    "oren-nayar": {"albedo": 0.6, "sigma": 0.5},
    "cook-torrance": {"diffuse": 0.4, "specular": 0.8, "slope": 0.2},
    "li-torrance": {"k_dd": 0.5, "k_uds": 0.5, "correlation_length": 8.0},
}
FIXED = {name: {"f0": 0.04} if "torrance" in name else {} for name in VALUES}


def studio(directions: Any, size: int = 48, irradiance: float = 1.2, **kind: Any) -> Studio:
    return Studio(size=size, lights=tuple((directional(d, irradiance),) for d in directions), **kind)


def photograph(where: Studio, name: str, seed: int) -> Capture:
    return where.photograph(model(name)[0].replace(VALUES[name] | FIXED[name]), seed)


@pytest.fixture
def without_advice(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search for the next light takes longer than all else."""
    monkeypatch.setattr("matest.identifiability.advice.next_light", lambda *_: None, raising=True)


def checked(capture: Capture | Plan, name: str, **options: Any) -> Check:
    return check(capture, name, fix=FIXED.get(name, {}), **options)


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
    values = [matest.estimate(photograph(where, "lambert", k), "lambert").parameters["albedo"].value for k in range(60)]
    # The scatter of 60 is known to 9 %: three times that.
    assert np.std(np.ravel(values), ddof=1) == pytest.approx(np.ravel(predicted.std)[0], rel=0.28)


@cache
def frontal(name: str) -> tuple[Studio, Check]:
    where = studio([(0, 0, 1)])
    return where, checked(photograph(where, name, 1), name, at=VALUES[name])


@pytest.mark.parametrize("name", ["oren-nayar", "cook-torrance"])
def test_adding_the_advised_light_to_a_frontal_one_brings_what_was_predicted(name: str) -> None:
    where, advice = frontal(name)
    light = advice.light
    assert light is not None
    assert light.worst[1] < 0.8 * light.worst[0]
    both = Studio(size=48, lights=(*where.lights, (directional(light.direction, *light.irradiance),)))
    before, after = (matest.estimate(photograph(s, name, 1), name, fix=FIXED[name]).parameters for s in (where, both))
    for parameter, gain in light.gain.items():
        brought = np.ravel(before[parameter].std) / np.ravel(after[parameter].std)
        assert gain == pytest.approx(float(brought[0]), rel=0.2)


def test_the_advice_tells_what_is_estimated_once_the_light_determines_it() -> None:
    where = Studio(size=80, lights=((directional((0.0, 0.0, 1.0), 3.0),),), noise=Noise(0.001, 0.0001))
    glossy = {"diffuse": 0.3, "specular": 0.8, "slope": 0.1}
    material = model("cook-torrance")[0].replace({name: torch.tensor(value) for name, value in glossy.items()})
    light = check(where.photograph(material, 1), "cook-torrance", at=glossy).light
    assert light is not None
    assert light.frees == ["f0"]
    assert set(light.freed) == {*glossy, "f0"}
    both = replace(where, lights=(*where.lights, (directional(light.direction, *light.irradiance),)))
    found = [matest.estimate(both.photograph(material, seed), "cook-torrance").parameters for seed in range(3)]
    for name, std in light.freed.items():
        # Errors go with the square of f0, which these images know to a tenth.
        brought = np.median([np.ravel(estimate[name].std)[0] for estimate in found])
        assert np.ravel(std)[0] == pytest.approx(brought, rel=0.4)
    # With f0 said there is nothing to free.
    held = check(where.photograph(material, 1), "cook-torrance", at=glossy, fix={"f0": 0.04}).light
    assert held is not None
    assert (held.frees, held.freed) == ([], {})


def test_no_other_direction_does_much_better_than_the_advised_one() -> None:
    where, advice = frontal("oren-nayar")
    assert advice.light is not None
    for direction in ((0.6, 0, 0.8), (0, 0.9, 0.44), (-0.5, -0.5, 0.7), (0, 0, 1)):
        both = Studio(size=48, lights=(*where.lights, (directional(direction, 1.2),)))
        found = matest.estimate(photograph(both, "oren-nayar", 1), "oren-nayar").parameters["sigma"]
        assert advice.light.std["sigma"] < 1.05 * found.std


@pytest.mark.usefixtures("without_advice")
def test_specular_and_f0_are_a_product_under_one_frontal_light() -> None:
    where = studio([(0, 0, 1)])
    held = check(where.photograph(Lambert(0.5), 1), "cook-torrance").parameters["f0"]
    assert held.status == "held"
    assert held.reason == "f0 and specular appear only as a product here"
    freed = check(where.photograph(Lambert(0.5), 1), "cook-torrance", free=("f0",)).parameters
    assert freed["specular"].status == freed["f0"].status == "not determined"
    assert freed["specular"].reason == "specular and f0 appear only as a product here"
    assert freed["specular"].std is None


@pytest.mark.usefixtures("without_advice")
def test_parameters_along_a_bent_valley_are_never_called_determined() -> None:
    # To first order n is known to a quarter of itself; along a curve the images are the same up to n = 8.
    metal = CookTorrance(0.0, 1.0, 0.2, eta=1.0, k=2.483, fresnel="conductor")
    held = {"diffuse": 0.0, "specular": 1.0}
    at = {name: float(metal.parameters[name]) for name in ("slope", "eta", "k")}
    found = check(Studio().photograph(metal, 1), metal.expression, fix=held, at=at).parameters
    assert found["slope"].status == "determined"
    assert (found["eta"].status, found["k"].status) == ("weak", "weak")
    assert found["eta"].relative < 1
    assert "errors of eta and k hold only very near the values assumed" in found["eta"].reason


@pytest.mark.usefixtures("without_advice")
def test_only_the_ratio_of_the_lengths_is_determined_without_coherent_reflection() -> None:
    capture = studio(DIRECTIONS).photograph(Lambert(0.5), 1)
    found = check(capture, "li-torrance", fix={"f0": 0.04}, free=("height_rms",)).parameters
    expected = "only height_rms/correlation_length is determined without coherent=on (mirror-like reflection)"
    assert found["height_rms"].reason == found["correlation_length"].reason == expected
    assert found["height_rms"].status == found["correlation_length"].status == "not determined"
    assert found["k_uds"].status == "determined"


def plate(tilt: float) -> Capture:
    """Of a sphere, only the part that faces the camera, lit from `tilt` degrees to the side."""
    angle = math.radians(tilt)
    capture = studio([(math.sin(angle), 0, math.cos(angle))]).photograph(Lambert(0.5), 1)
    surface = capture.scene.surface
    kept = (surface.normals[:, 2] > 0.98).numpy()
    scene = replace(capture.scene, surface=surface.take(kept))
    return changed(capture, scene=scene, stored=tuple(pixels[kept] for pixels in capture.photographs.stored))


@pytest.mark.usefixtures("without_advice")
def test_a_highlight_that_no_sample_comes_near_is_named_with_its_distance() -> None:
    capture = plate(70)
    found = check(capture, "cook-torrance", at={"slope": 0.05}).parameters
    assert found["slope"].status == "not determined"
    half = np.array([math.sin(math.radians(35)), 0, math.cos(math.radians(35))])
    nearest = np.degrees(np.arccos((capture.scene.surface.normals.numpy() @ half).max()))
    assert found["slope"].reason == f"no image samples within {nearest:.0f}° of the highlight"
    assert found["diffuse"].status == "determined"


@pytest.mark.usefixtures("without_advice")
def test_pixels_predicted_to_be_clipped_say_little() -> None:
    capture = studio([(0.3, 0.2, 0.93)]).photograph(Lambert(0.5), 1)
    values = {"slope": 0.05, "diffuse": 0.3}
    clipped = check(changed(capture, encoding=Encoding(saturation=0.25)), "cook-torrance", at=values)
    whole = check(capture, "cook-torrance", at=values)
    assert clipped.skipped["saturated"] > whole.skipped["saturated"] == 0
    assert clipped.parameters["slope"].std > 1.5 * whole.parameters["slope"].std


def test_a_highlight_that_light_reaches_but_no_usable_sample_asks_for_a_shorter_exposure() -> None:
    problem = specify("cook-torrance", Options(), channels=1, relative=False).problem
    unknowns = problem.unknowns_at({**problem.brdf.parameters, "slope": torch.tensor(0.05)})
    unseen = forecast(predicted_samples(plate(70).photographs, problem, unknowns), problem, unknowns)
    assert "shorter exposure" in Reasons(unseen, Nearness(usable=0.5, lit=0.01), False).of("slope")
    assert "no image samples" in Reasons(unseen, Nearness(usable=0.5, lit=0.5), False).of("slope")


@pytest.mark.usefixtures("without_advice")
def test_a_product_is_named_as_such_although_the_middle_of_the_highlight_is_clipped() -> None:
    capture = changed(studio([(0, 0, 1)]).photograph(Lambert(0.5), 1), encoding=Encoding(saturation=0.25))
    found = check(capture, "cook-torrance", at={"slope": 0.1})
    assert found.skipped["saturated"] > 0
    assert found.parameters["f0"].reason == "f0 and specular appear only as a product here"


@pytest.mark.usefixtures("without_advice")
def test_under_unknown_light_strength_albedo_and_light_scale_are_locked() -> None:
    found = check(studio(DIRECTIONS, relative=True).photograph(Lambert(0.5), 1), "lambert")
    assert found.parameters["albedo"].reason.startswith("albedo and the light scale are locked")
    assert any("relative" in warning for warning in found.warnings)
    assert check(studio(DIRECTIONS).photograph(Lambert(0.5), 1), "lambert").parameters["albedo"].reason == ""


@pytest.mark.usefixtures("without_advice")
def test_what_shapes_an_absent_lobe_says_so() -> None:
    capture = studio(DIRECTIONS).photograph(Lambert(0.5), 1)
    assert "absent: specular is 0" in check(capture, "cook-torrance", at={"specular": 0.0}).parameters["slope"].reason


@pytest.mark.usefixtures("without_advice")
def test_errors_grow_with_the_noise() -> None:
    capture = studio(DIRECTIONS).photograph(Lambert(0.5), 1)
    # Read noise alone: all standard errors are in proportion to it.
    once, twice = (check(capture, "oren-nayar", noise=(read, 0.0)).parameters for read in (0.01, 0.02))
    for name in ("albedo", "sigma"):
        assert np.ravel(twice[name].std) == pytest.approx(2 * np.ravel(once[name].std), rel=1e-4)


@pytest.mark.usefixtures("without_advice")
def test_shape_parameters_that_nobody_gave_are_tried_at_other_values() -> None:
    capture = studio(DIRECTIONS).photograph(Lambert(0.5), 1)
    found = check(capture, "oren-nayar")
    assert found.levels == {"sigma": pytest.approx([0.15, 0.3, 0.6])}
    several = [check(capture, "oren-nayar", at={"sigma": value}) for value in (0.15, 0.3, 0.6)]
    assert all(one.levels == {} and one.parameters["sigma"].range is None for one in several)
    relative = [one.parameters["sigma"].relative for one in several]
    assert found.parameters["sigma"].range == pytest.approx((min(relative), max(relative)), rel=1e-6)


def test_candidate_lights_cover_the_side_of_the_camera_evenly() -> None:
    axis = torch.tensor([0.6, 0.0, 0.8], dtype=torch.float64)
    found = torch.stack(hemisphere(axis, 200, 80.0))
    assert torch.allclose(found.norm(dim=1), torch.ones(200, dtype=torch.float64))
    cosines = found @ axis
    assert float(cosines.min()) == pytest.approx(math.cos(math.radians(80)))
    # Even over the cap: the mean cosine is that of its middle, sideways the mean vanishes.
    assert float(cosines.mean()) == pytest.approx((1 + math.cos(math.radians(80))) / 2, abs=1e-6)
    assert float((found.mean(0) - cosines.mean() * axis).norm()) < 0.02


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
def test_noise_that_nobody_states_is_a_typical_cameras(tmp_path: Path) -> None:
    file = scenes.write(tmp_path, scenes.material("lambert", albedo=0.5), scenes.sphere(48), scenes.distant())
    found = check(matest.load_plan(file))
    assert "typical" in found.noise["source"]
    assert found.noise["read"] == pytest.approx(1e-3, rel=1e-3)
    assert Plan.of(studio(DIRECTIONS).photograph(Lambert(0.5), 1)).photographs.noise == CAMERA


def test_a_capture_in_the_dark_is_helped_by_any_light() -> None:
    found = check(studio([(0, 0, -1)], size=32).photograph(Lambert(0.5), 1), "oren-nayar")
    for name in ("albedo", "sigma"):
        assert found.parameters[name].reason == "no image has a usable sample"
        assert found.parameters[name].range is None
    assert found.light is not None
    assert found.light.resolves == ["albedo", "sigma"]
    json.dumps(found.to_dict(), allow_nan=False)
    assert any("no usable pixel" in warning for warning in found.warnings)


@pytest.mark.usefixtures("without_advice")
def test_an_azimuth_carries_no_light_scale() -> None:
    capture = studio(DIRECTIONS, relative=True).photograph(Lambert(0.5), 1)
    found = check(capture, "oren-nayar-single-slope").parameters
    assert "locked" in found["albedo"].reason
    assert "locked" not in found["azimuth"].reason


def test_noise_must_be_possible() -> None:
    plan = Plan.of(studio(DIRECTIONS).photograph(Lambert(0.5), 1))
    assert "both zero" in refusal(lambda: plan.with_noise(0.0, 0.0))
    assert "not negative" in refusal(lambda: plan.with_noise(-0.1, 0.0))
    assert plan.with_noise(0.01, 0.0).photographs.noise == Noise(0.01, 0.0)


def test_values_that_make_no_sense_are_refused() -> None:
    capture = studio(DIRECTIONS).photograph(CookTorrance(), 1)
    assert "did you mean" in refusal(lambda: check(capture, "cook-torrance", at={"slop": 0.1}))
    assert "must lie in" in refusal(lambda: check(capture, "cook-torrance", at={"slope": 3.0}))
    assert "fixed" in refusal(lambda: check(capture, "cook-torrance", fix={"slope": 0.1}, at={"slope": 0.2}))
    assert "takes 1 value" in refusal(lambda: check(capture, "cook-torrance", at={"slope": [0.1, 0.2]}))
