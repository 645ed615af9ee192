"""What a user is warned of, and in which order."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

import matest
from matest.brdf import Brdf, CookTorrance, Lambert, OrenNayar
from matest.estimation.options import Options
from matest.estimation.result import Estimate
from matest.estimation.specification import specify
from matest.estimation.warnings import RULES, Context, warnings
from matest.inference.quantities import ParameterEstimate
from matest.photographs.photometry import Encoding
from matest.scene import Scene
from matest.shading import render
from tests.captures import changed, directional
from tests.inference.judged import judged, solved
from tests.simulated import DIRECTIONS, Studio

STUDIO = Studio(size=24)


def photographed(material: Brdf, expression: str, **options: object) -> Estimate:
    return matest.estimate(STUDIO.photograph(material, 0), expression, **options)  # type: ignore[arg-type]


def test_relative_radiometry_and_what_is_held_are_told_first() -> None:
    capture = Studio(size=24, relative=True).photograph(CookTorrance(0.4, 0.3, 0.3), 0)
    found = matest.estimate(capture, "cook-torrance")
    assert found.warnings[0] == (
        "The common scale of the lights is unknown (relative radiometry): albedo is reported up to that scale."
    )
    assert found.warnings[1] == (
        "f0 is held at 0.04: these images do not determine it beside the strength of the highlight; "
        "--free f0 estimates it all the same, --fix f0=VALUE sets it."
    )


def test_a_lobe_that_no_f0_is_bright_enough_for_asks_for_its_own() -> None:
    found = photographed(CookTorrance(0.1, 1.0, 0.2, f0=0.9), "cook-torrance", fix={"slope": 0.2})
    assert found.parameters["specular"].status == "at bound"
    assert (
        "specular is at its upper end: with f0 held at 0.04 no lobe is bright enough; give the surface's own, "
        "--fix f0=VALUE (a metal's is near 1)." in found.warnings
    )


def test_what_lights_should_say_and_do_not_is_told_as_assumed() -> None:
    found = photographed(Lambert(0.5), "li-torrance(coherent=on)", fix={"height_rms": 1.0, "correlation_length": 5.0})
    said = [warning for warning in found.warnings if "should say it" in warning]
    assert any("solid_angle is taken as" in warning and "the lights of the capture" in warning for warning in said)
    assert any("wavelength is taken as" in warning and "[camera] of the capture" in warning for warning in said)


def test_copies_of_a_channel_are_told_and_worked_on_once() -> None:
    studio = Studio(size=24, lights=tuple((directional(d, 3.0, 3.0, 3.0),) for d in DIRECTIONS))
    capture = studio.photograph(Lambert(0.6), None)
    found = matest.estimate(capture, "lambert")
    assert "The channels of every image are copies of each other: one is worked on, and reported." in found.warnings
    assert any(work == "2 channels: they are copies of the first in every image" for work in found.skipped["work"])


def test_an_image_without_light_is_left_out_and_told() -> None:
    dark = (*Studio().lights[:3], (directional(DIRECTIONS[3], 0.0),))
    studio = Studio(size=24, lights=dark)
    found = matest.estimate(studio.photograph(Lambert(0.6), 0), "lambert")
    assert any(warning.startswith("Image 3 (") and "is left out: " in warning for warning in found.warnings)
    assert any(work.startswith("image 3 (") for work in found.skipped["work"])


def test_the_same_pixels_under_two_lights_are_told() -> None:
    capture = STUDIO.photograph(Lambert(0.6), 0)
    twins = changed(capture, stored=(*capture.photographs.stored[:-1], capture.photographs.stored[0]))
    found = matest.estimate(twins, "lambert")
    assert any(warning.startswith("Images 0 (") and "are the same pixels" in warning for warning in found.warnings)


def test_the_image_that_spoils_the_others_is_named() -> None:
    capture = STUDIO.photograph(Lambert(0.6), 0)
    spoilt = changed(capture, stored=(*capture.photographs.stored[:-1], 1.3 * capture.photographs.stored[-1]))
    found = matest.estimate(spoilt, "lambert")
    said = [warning for warning in found.warnings if capture.names[5] in warning]
    assert len(said) == 1
    assert said[0].startswith(f"{capture.names[5]} is 30 % too bright for its light: ")


def test_an_image_that_no_light_explains_is_named_too() -> None:
    capture = STUDIO.photograph(Lambert(0.6), 0)
    upside_down = capture.photographs.stored[3][::-1].copy()
    stored = [upside_down if image == 3 else each for image, each in enumerate(capture.photographs.stored)]
    found = matest.estimate(changed(capture, stored=tuple(stored)), "lambert")
    said = [warning for warning in found.warnings if capture.names[3] in warning]
    assert len(said) == 1
    assert said[0].startswith(f"{capture.names[3]} is explained by no level and no turn of its light: ")


def test_an_image_without_a_usable_pixel_is_told() -> None:
    behind = (*Studio().lights[:3], (directional((0.0, 0.0, -1.0), 3.0),))
    found = matest.estimate(Studio(size=24, lights=behind).photograph(Lambert(0.6), 0), "lambert")
    assert any("No usable pixel in" in warning for warning in found.warnings)


def test_a_model_that_misses_the_images_asks_for_a_look_at_what_was_stated() -> None:
    capture = STUDIO.photograph(OrenNayar(0.7, 0.5), 0)
    # The photographs are of something else: their pixels are in any order.
    shuffled = tuple(np.random.default_rng(0).permutation(image) for image in capture.photographs.stored)
    found = matest.estimate(changed(capture, stored=shuffled), "lambert")
    assert any(warning.startswith("The model misses the images by ") for warning in found.warnings)


@pytest.mark.parametrize(
    ("expression", "options"), [("lambert", {}), ("cook-torrance", {"tie": {"specular": "diffuse"}})]
)
def test_what_a_named_model_lacks_is_said_first(expression: str, options: dict) -> None:
    found = photographed(CookTorrance(0.05, 1.0, 0.3, f0=0.5), expression, **options)
    assert math.sqrt(found.fit.reduced_chi2) > 10
    assert found.warnings[0].startswith("The residuals are mostly due to a lobe that the model does not have")
    assert not any("does not describe" in warning for warning in found.warnings)


def test_a_named_model_that_is_far_from_the_images_for_no_cause_that_is_known_is_said_to_be() -> None:
    capture = STUDIO.photograph(OrenNayar(0.7, 0.5), 0)
    # The photographs are of something else: their pixels are in any order.
    shuffled = tuple(np.random.default_rng(0).permutation(image) for image in capture.photographs.stored)
    found = matest.estimate(changed(capture, stored=shuffled), "lambert")
    times = math.sqrt(found.fit.reduced_chi2)
    assert times > 10
    assert (
        f"The model does not describe the images: residuals are {times:.3g} times the noise. Try --model auto, or "
        "check what is stated of these images."
    ) in found.warnings


def test_a_small_misfit_of_a_named_model_needs_no_such_word() -> None:
    found = photographed(OrenNayar(0.7, 0.3), "lambert")
    assert 1.1 < math.sqrt(found.fit.reduced_chi2) < 3
    assert not any("does not describe" in warning for warning in found.warnings)


def test_what_auto_chose_has_a_sentence_of_its_own() -> None:
    studio = Studio(size=24)
    turned = Studio(size=24, lights=studio.lights[1:] + studio.lights[:1]).scene
    capture = changed(studio.photograph(OrenNayar(0.7, 0.5), 0), scene=turned)
    found = matest.estimate(capture)
    assert found.warnings[0].startswith("It seems that the lights are shifted by one")
    # The rest follows from that.
    assert not any("does not describe" in warning or "No model" in warning for warning in found.warnings)


def test_many_outliers_are_counted() -> None:
    capture = STUDIO.photograph(Lambert(0.6), 0)
    rng = np.random.default_rng(1)
    stored = tuple(
        np.where(rng.random(image.shape) < 0.02, 0.9, image).astype(np.float32) for image in capture.photographs.stored
    )
    found = matest.estimate(changed(capture, stored=stored), "lambert")
    assert any("of the values lie too far from the model to be noise" in warning for warning in found.warnings)


def test_what_is_seen_only_together_is_told_as_such() -> None:
    found = photographed(Lambert(0.6), "lambert+cook-torrance", free=["diffuse"], fix={"specular": 0.0, "slope": 0.3})
    assert (
        "lambert.albedo and cook-torrance.diffuse are not determined: these images see only a combination of them; "
        "fix one." in found.warnings
    )


def test_a_lobe_that_is_not_seen_is_told_after_what_is_not_determined() -> None:
    found = photographed(Lambert(0.6), "cook-torrance")
    assert found.warnings[-2:] == [
        "slope is not determined by these images.",
        "No lobe of specular is seen: intervals are of one as wide as fits best.",
    ]


def test_noise_that_was_estimated_is_told() -> None:
    capture = changed(STUDIO.photograph(Lambert(0.6), 0), noise_stated=False)
    found = matest.estimate(capture, "lambert")
    assert found.warnings[-1] == "Noise was estimated from the images: read 0.002, gain 0.0005 of full scale."


def test_codes_in_steps_are_told_beside_the_noise_that_includes_their_rounding() -> None:
    codes = (73 * np.round(image * 65535 / 73) for image in STUDIO.photograph(Lambert(0.6), 0).photographs.stored)
    stored = tuple(image.clip(0, 65535).astype(np.uint16) for image in codes)
    for stated in (False, True):
        capture = changed(
            STUDIO.photograph(Lambert(0.6), 0), stored=stored, encoding=Encoding(step=73.0), noise_stated=stated
        )
        assert matest.estimate(capture, "lambert").warnings[-1] == (
            "Stored codes come in steps of 73: the read noise includes their rounding, 0.00032 of full scale."
        )


def test_a_precision_that_was_not_reached_is_told_last() -> None:
    found = photographed(OrenNayar(0.6, 0.4), "oren-nayar", precision=1e-5)
    assert found.warnings[-1].startswith(
        "All pixels together do not give the precision of 1e-05 that was asked for: albedo ("
    )


@pytest.fixture(scope="module")
def context() -> Context:
    """Of an estimate that needs no warning."""
    capture = STUDIO.photograph(OrenNayar(0.6, 0.4), 0)
    found = judged(capture, "oren-nayar")
    specification = specify("oren-nayar", Options(), channels=1, relative=False, scene=capture.scene)
    return Context(found.samples, specification, found.solution, found.posterior, None)


def told(context: Context, **changes: object) -> list[str]:
    """Warnings where the posterior is another one."""
    return warnings(replace(context, posterior=replace(context.posterior, **changes)))  # type: ignore[arg-type]


def test_too_few_pixels_for_error_bars_that_allow_for_the_misfit_are_told(context: Context) -> None:
    bars = replace(context.posterior.bars, holds=False, kind="fisher")
    assert warnings(context) == []
    assert told(context, bars=bars) == [
        "There are too few pixels for error bars that allow for the misfit of the model."
    ]


def averaged(scene: Scene, material: Brdf) -> np.ndarray:
    """Radiance [K, N, C] of a small sphere's pixels, each the mean of 8×8 points of it."""
    fine = replace(STUDIO, size=8 * STUDIO.size).scene
    images = render(fine, material, dtype=torch.float64).numpy()
    mean = images.reshape(len(images), STUDIO.size, 8, STUDIO.size, 8, -1).mean(axis=(2, 4))
    return mean.reshape(len(images), -1, mean.shape[-1])[:, scene.surface.pixels]


@pytest.mark.parametrize("slope", [0.1, 0.15])
def test_a_slope_that_pixels_average_is_told_with_its_excess(slope: float) -> None:
    material = CookTorrance(0.2, 0.8, slope)
    exposed = STUDIO.expose(averaged(STUDIO.scene, material), None)
    found = matest.estimate(exposed, "cook-torrance", fix={"f0": 0.04})
    (said,) = [warning for warning in found.warnings if "averages over a part of the surface" in warning]
    excess = float(said.split("too large by ")[1].split(",")[0])
    assert found.parameters["slope"].value - slope == pytest.approx(excess, rel=0.2)  # type: ignore[operator]


def test_a_slope_that_pixels_hardly_widen_is_not_told() -> None:
    found = photographed(CookTorrance(0.2, 0.8, 0.5), "cook-torrance", fix={"f0": 0.04})
    assert not any("averages over a part of the surface" in warning for warning in found.warnings)


@pytest.mark.parametrize(("values", "warns"), [(59, True), (60, False)])
def test_few_values_are_told_to_give_uncertain_error_bars(context: Context, values: int, warns: bool) -> None:
    solution = solved(torch.zeros(1, 2), values=values)
    sentence = f"There are only {values} values for 2 unknowns: error bars from so few are uncertain."
    assert (sentence in warnings(replace(context, solution=solution))) == warns


def test_channels_that_are_not_determined_are_named(context: Context) -> None:
    albedo = ParameterEstimate([0.5, None, 0.3], [0.1, None, 0.1], [[0, 1], None, [0, 1]], "1", "not determined")
    estimates = {**context.posterior.estimates, "albedo": albedo}
    assert told(context, estimates=estimates) == ["albedo of channel G is not determined by these images."]
    sigma = ParameterEstimate(None, None, None, "rad", "not determined")
    assert told(context, estimates={**estimates, "sigma": sigma}) == [
        "albedo of channel G and sigma are not determined by these images."
    ]


def test_channels_have_the_names_of_their_table(context: Context) -> None:
    albedo = ParameterEstimate([0.5, None], [0.1, None], [[0, 1], None], "1", "not determined")
    posterior = replace(context.posterior, estimates={**context.posterior.estimates, "albedo": albedo})
    said = warnings(replace(context, posterior=posterior, channels=("450 nm", "550 nm")))
    assert "albedo of channel 550 nm is not determined by these images." in said


def test_every_rule_is_silent_where_there_is_nothing_to_tell(context: Context) -> None:
    assert [list(rule(context)) for rule in RULES] == [[] for _ in RULES]
