"""A capture that is described wrongly: what an estimate says of it first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

import matest
from matest import InputError, load_capture
from matest.brdf import CookTorrance, OrenNayar
from matest.capture import Capture
from tests.captures import changed
from tests.shared_data import measurement, shared
from tests.simulated import Studio

STUDIO = Studio(size=48)
RIGHT = STUDIO.photograph(OrenNayar(0.7, 0.5), seed=1)


def shifted(capture: Capture) -> Capture:
    """Every photograph is stated to be under the light of the one after it."""
    lights = capture.scene.lights
    return changed(capture, scene=replace(capture.scene, lights=(*lights[1:], lights[0])))


def test_the_mistake_comes_first_with_what_it_does_and_how_to_mend_it() -> None:
    found = matest.estimate(shifted(RIGHT), "oren-nayar")
    assert found.misreading is not None
    before, after = found.misreading.relative_rmse_before, found.misreading.relative_rmse_after
    assert before == found.fit.relative_rmse > 0.2
    assert after == pytest.approx(matest.estimate(RIGHT, "oren-nayar").fit.relative_rmse, rel=0.1)
    assert found.misreading.causes == ("lights shifted by one",)
    assert found.misreading.order == (5, 0, 1, 2, 3, 4)
    assert found.warnings[0] == found.misreading.message
    assert found.misreading.message == (
        "It seems that the lights are shifted by one (an image's are stated just before it): with lights in the order "
        f"that fits the model misses the images by {100 * after:.2g}% instead of {before:.0%}. Give the images, in "
        "their order, the lights that are stated for images 5, 0, 1, 2, 3, 4."
    )
    (told,) = found.to_dict()["diagnosis"]
    assert (told["cause"], told["message"]) == ("lights shifted by one", found.warnings[0])
    assert told["chi2_before"] > 100 > 2 > told["chi2_after"]
    # Those who know what is wrong need no list of what may be.
    assert not any("check encoding.transfer" in warning or "--model auto" in warning for warning in found.warnings)


def test_a_mistake_is_found_whatever_model_is_named_or_chosen() -> None:
    for model in ("lambert", "cook-torrance", "auto"):
        found = matest.estimate(shifted(RIGHT), model)
        assert found.misreading is not None, model
        assert found.misreading.causes == ("lights shifted by one",)


def test_a_wrong_model_is_no_mistake_of_the_capture() -> None:
    metal = STUDIO.photograph(CookTorrance(0.0, 1.0, 0.2, f0=0.9), seed=1)
    found = matest.estimate(metal, "oren-nayar")
    assert found.fit.relative_rmse > 0.5
    assert found.misreading is None
    assert "a lobe that the model does not have" in found.warnings[0]


def test_where_the_model_fits_no_mistake_is_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> list:
        raise AssertionError

    monkeypatch.setattr("matest.photographs.samples.better_readings", refuse)
    assert matest.estimate(RIGHT, "oren-nayar").misreading is None


def pointing_away(capture: Capture) -> Capture:
    lights = tuple((replace(light, direction=-light.direction),) for (light,) in capture.scene.lights)
    return changed(capture, scene=replace(capture.scene, lights=lights))


def test_lights_that_point_away_are_named() -> None:
    found = matest.estimate(pointing_away(RIGHT), "oren-nayar")
    assert found.misreading is not None
    assert found.misreading.causes == ("lights point away",)


def test_a_mistake_that_leaves_nothing_to_fit_is_named_too() -> None:
    stored = tuple(np.round(65535 * image.clip(0, 1)).astype(np.uint16) for image in STUDIO.clean(OrenNayar(0.7, 0.5)))
    stated = pointing_away(changed(RIGHT, stored=stored))
    with pytest.raises(InputError, match=r"point the way that light travels. Change the sign of every direction"):
        matest.estimate(stated, "oren-nayar")


def test_what_cannot_be_told_apart_is_named_together() -> None:
    folder, _ = shared("normals_y_down")
    found = matest.estimate(load_capture(folder), "oren-nayar")
    assert found.misreading is not None
    assert found.misreading.causes == ("normals y down", "lights y down")
    assert found.warnings[0].startswith(
        "It seems that the normals' y axis points down, or the lights' y axis points down (these images do not tell "
        "which): with y turned round the model misses the images by 3"
    )


def test_the_order_of_the_lights_of_a_glossy_ball() -> None:
    folder, _ = shared("lights_shifted")
    found = matest.estimate(load_capture(folder), "cook-torrance")
    assert found.misreading is not None
    assert found.misreading.causes == ("lights shifted by one",)
    assert found.misreading.order == (1, 2, 3, 4, 5, 0)


@pytest.mark.parametrize(
    ("case", "model"), [("albedo_varies", "oren-nayar"), ("metal", "oren-nayar"), ("lights_off", "oren-nayar")]
)
def test_no_capture_with_another_fault_is_accused(case: str, model: str) -> None:
    folder, _ = shared(case)
    assert matest.estimate(load_capture(folder), model).misreading is None


@pytest.mark.parametrize("folder", ["gray_sphere", "diligent_cat"])
def test_no_real_capture_is_accused(folder: str) -> None:
    capture = load_capture(measurement(folder, "capture.toml").parent)
    found = matest.estimate(capture, "lambert")
    assert found.fit.relative_rmse > 0.05
    assert found.misreading is None


def test_held_out_images_keep_their_place_in_the_order() -> None:
    found = matest.estimate(shifted(RIGHT), "oren-nayar", holdout=[2])
    assert found.misreading is not None
    assert found.misreading.order == (5, 0, 1, 2, 3, 4)
    assert torch.isfinite(torch.tensor(found.misreading.relative_rmse_after))
