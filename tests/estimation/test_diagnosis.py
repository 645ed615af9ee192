"""What is wrong with a capture is named, with its size; nothing is said of one that is right."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import matest
from matest.benchmark.instruments import miscalibration as off
from matest.benchmark.instruments.miscalibration import Setting, photograph
from matest.benchmark.instruments.photographs import vase
from matest.brdf import CookTorrance, OrenNayar
from matest.capture import Capture
from matest.estimation.remedies import REMEDIES
from matest.estimation.result import Estimate
from matest.photographs.nuisances import NUISANCES
from matest.scene import Surface

DEGREE = math.radians(1)
LIGHTS = np.array(
    [
        (0.0, 0.35, 0.94), (0.7, 0.2, 0.68), (-0.7, 0.2, 0.68), (0.35, 0.8, 0.48), (-0.35, -0.6, 0.72),
        (0.45, -0.4, 0.8), (-0.3, 0.5, 0.81), (0.1, -0.15, 0.98),
    ]
)  # fmt: skip
BODY = OrenNayar([0.7, 0.5, 0.3], 0.4)
GLOSS = CookTorrance([0.4, 0.2, 0.1], 0.8, 0.2, f0=0.04)


def capture_of(error: off.Error, seed: int, surface: Surface | None = None, material=BODY, body="albedo") -> Capture:
    generator = np.random.default_rng(seed)
    lights = LIGHTS / np.linalg.norm(LIGHTS, axis=1, keepdims=True)
    stated = Setting(off.ball() if surface is None else surface, lights, np.ones(len(LIGHTS)))
    return photograph(stated, error(stated, generator), material, body, generator)


def named(error: off.Error, **how) -> Estimate:
    return matest.estimate(capture_of(error, 1), "oren-nayar", **how)


@pytest.mark.parametrize(
    ("error", "cause", "size"),
    [
        (off.directions(DEGREE), "direction", DEGREE),
        (off.rotation(DEGREE), "rotation", DEGREE / math.sqrt(3)),
        (off.intensities(0.03), "intensity", 0.03),
        (off.constant(ambient=0.01), "ambient", 0.01),
        (off.constant(black=0.02), "black", 0.02),
        (off.constant(vignetting=0.1), "vignetting", 0.1),
        (off.radius(1.0), "radius", 1.0),
        (off.centre(1.0), "shift", 1 / math.sqrt(2)),
        (off.smooth_normals(DEGREE), "normals", DEGREE),
        (off.noisy_normals(2 * DEGREE), "normal_noise", 2 * DEGREE),
        (off.smooth_albedo(0.1), "albedo_field", 0.1),
        (off.constant(blur=1.0), "blur", 1.0),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named_with_its_size(error: off.Error, cause: str, size: float) -> None:
    first = named(error).diagnosis[0]
    assert first.cause == cause
    assert first.size is not None
    # Sixteen normal deviates have an rms that is off by a sixth.
    assert abs(first.size) == pytest.approx(size, rel=0.4)
    assert first.chi2_after < first.chi2_before


def test_nothing_is_said_of_a_capture_that_is_right() -> None:
    for seed in range(3):
        estimate = matest.estimate(capture_of(off.together(), seed), "oren-nayar")
        assert estimate.diagnosis == []
        assert "to their noise" in estimate.fit.message


def test_the_first_note_says_what_it_is_and_the_mend() -> None:
    estimate = named(off.constant(ambient=0.01))
    note = estimate.warnings[0]
    assert note == estimate.diagnosis[0].message
    assert "light that is in every photograph, 0.98" in note
    assert "--refine ambient" in note
    assert json.loads(json.dumps(estimate.to_dict()))["diagnosis"][0]["cause"] == "ambient"


def test_every_kind_of_error_has_a_mend() -> None:
    assert {*NUISANCES} <= {*REMEDIES}


def test_lights_of_a_metal_that_are_all_too_strong_are_named() -> None:
    metal = CookTorrance([0.0, 0.0, 0.0], 1.0, 0.3, f0=[0.95, 0.64, 0.54], fresnel="schlick")
    error = off.constant(strength=1.1 * np.ones(len(LIGHTS)))
    capture = capture_of(error, 1, None, metal, "f0")
    held = {"f0": [0.95, 0.64, 0.54], "diffuse": 0.0, "specular": 1.0}
    found = matest.estimate(capture, "cook-torrance(fresnel=schlick)", fix=held)
    assert found.diagnosis[0].cause == "scale"
    assert found.diagnosis[0].size == pytest.approx(0.1, abs=0.01)


def test_error_bars_allow_for_what_explains_residuals() -> None:
    """One per cent of light in every photograph moves the roughness by many Fisher errors."""
    estimate = named(off.constant(ambient=0.01))
    low, high = estimate.parameters["sigma"].interval95
    assert low < 0.4 < high
    assert estimate.nuisance["ambient"].origin == "found"
    assert not estimate.nuisance["ambient"].refined


def test_two_things_that_are_wrong_are_both_named() -> None:
    estimate = named(off.together(off.smooth_albedo(0.05), off.intensities(0.03)))
    assert {cause.cause for cause in estimate.diagnosis} >= {"albedo_field", "intensity"}


def test_what_a_smooth_field_leaves_is_no_other_cause() -> None:
    assert [cause.cause for cause in named(off.smooth_albedo(0.1)).diagnosis] == ["albedo_field"]


def test_a_lobe_that_a_model_lacks_is_no_error_of_the_calibration() -> None:
    capture = capture_of(off.together(), 1, vase(off.SIZE), GLOSS, "diffuse")
    first = matest.estimate(capture, "lambert").diagnosis[0]
    assert first.cause == "lobe"
    assert first.size is None
    assert "--model auto" in first.message


def test_refining_what_is_found_brings_the_material_to_the_truth() -> None:
    error = off.together(off.constant(ambient=0.02), off.intensities(0.02))
    found = named(error, refine="auto")
    assert {name for name, errors in found.nuisance.items() if errors.refined} == {"ambient", "intensity"}
    before, after = (estimate.parameters["sigma"].value - 0.4 for estimate in (named(error), found))
    assert abs(after) < 0.1 * abs(before)
    assert all("refined" in cause.message for cause in found.diagnosis)


def test_refining_what_is_found_changes_nothing_where_nothing_is() -> None:
    capture = capture_of(off.together(), 1)
    plain, found = (matest.estimate(capture, "oren-nayar", refine=refine) for refine in ((), "auto"))
    assert found.nuisance == {}
    assert found.parameters == plain.parameters


def test_refined_errors_that_all_images_share_hold_in_those_left_out() -> None:
    error = off.together(off.radius(1.0), off.constant(ambient=0.02))
    plain, refined = (named(error, holdout=[2], refine=refine) for refine in ((), ("radius", "ambient")))
    clean = matest.estimate(capture_of(off.together(), 1), "oren-nayar", holdout=[2])
    assert refined.holdout["relative_rmse"] < 1.05 * clean.holdout["relative_rmse"] < plain.holdout["relative_rmse"]
