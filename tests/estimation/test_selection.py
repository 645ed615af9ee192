"""Which model the images support."""

from __future__ import annotations

import math

import pytest
import torch

from matest.benchmark.instruments.photographs import Conditions, Sensor, ring, sphere, subject
from matest.brdf import Brdf, CookTorrance, Lambert, LiTorrance, OrenNayar, TorranceSparrow
from matest.estimation.estimate import estimate
from matest.estimation.options import Options
from matest.estimation.recipes import DISTRIBUTIONS, RECIPES
from matest.estimation.selection import Selection, select
from matest.photographs.noise import Noise
from tests.captures import directional, refusal
from tests.simulated import Studio


def selected(material: Brdf, options: Options | None = None, images: int = 6) -> tuple[Selection, list[str]]:
    """What was selected, and what was said meanwhile."""
    samples = Studio(size=48, lights=Studio().lights[-images:]).photograph(material, seed=1).samples()
    said: list[str] = []
    return select(samples, options or Options(), said.append), said


def name(selection: Selection) -> str:
    return selection.best.recipe.expression


def test_lambertian_images_support_lambert_and_nothing_more() -> None:
    selection, said = selected(Lambert(0.6))
    assert name(selection) == "lambert"
    # No mixture of the columns of all candidates does better: larger ones need not be tried.
    tried = [recipe.expression for recipe in RECIPES if recipe.level <= 1]
    assert [candidate.model for candidate in selection.candidates] == tried
    assert said == ["searching", *(f"trying {expression}" for expression in tried)]
    assert selection.candidates[0].reason == "the simplest model tried"
    assert all("lambert" in candidate.reason for candidate in selection.candidates[1:])
    assert selection.unsupported == ["rough body", "metal"]


MATERIALS: dict[str, Brdf] = {
    "oren-nayar": OrenNayar(0.8, 0.6),
    "cook-torrance": CookTorrance(0.3, 0.8, 0.2),
    "cook-torrance(fresnel=schlick,diffuse=0)": CookTorrance(0.0, 1.0, 0.3, 0.6, fresnel="schlick"),
    "cook-torrance(lobes=2,fresnel=schlick,diffuse=0)": CookTorrance(
        0.0, 1.0, 0.1, 0.6, slope_2=0.4, weight_2=0.6, lobes="2", fresnel="schlick"
    ),
    "oren-nayar+torrance-sparrow": OrenNayar(0.7, 0.35) + TorranceSparrow(0.05, 0.35),
    "li-torrance": LiTorrance(k_dd=0.3, k_uds=0.9, height_rms=1.0, correlation_length=10.0, f0=0.04),
}


@pytest.mark.parametrize("expression", MATERIALS)
def test_images_of_a_material_support_its_model(expression: str) -> None:
    selection, _ = selected(MATERIALS[expression])
    assert name(selection) == expression
    assert selection.best.holds


def test_a_highlight_in_some_bands_of_the_only_image_is_not_called_chance() -> None:
    # Three of four bands say nothing of it; but without it the image is not met to its noise.
    only = tuple((directional(towards, 3.0),) for towards in [(0, 0, 1)])
    samples = Studio(size=64, lights=only).photograph(CookTorrance(0.4, 0.8, 0.15), seed=1).samples()
    selection = select(samples, Options())
    assert name(selection) == "cook-torrance"
    reasons = {candidate.model: candidate.reason for candidate in selection.candidates}
    assert reasons["cook-torrance"] == "meets bands left out to their noise, which lambert does not"


def test_components_that_the_images_do_not_show_are_not_refined() -> None:
    # A metal without diffuse light is off by far on any grid.
    selection, _ = selected(OrenNayar(0.8, 0.6))
    metal = next(trial for trial in selection.trials if "diffuse=0" in trial.recipe.expression)
    assert metal.score > 5 * selection.best.score


def test_a_dark_image_says_nothing_of_any_model() -> None:
    lights = (*Studio().lights[-3:], (directional((0.1, 0.1, 0.98), 0.0),))
    capture = Studio(size=48, lights=lights).photograph(OrenNayar(0.8, 0.6))
    selection = select(capture.samples(), Options())
    assert name(selection) == "oren-nayar"
    assert all(math.isfinite(candidate.score) for candidate in selection.candidates)


def test_few_images_are_compared_on_bands_of_them() -> None:
    selection, _ = selected(OrenNayar(0.8, 0.6), images=2)
    assert name(selection) == "oren-nayar"
    assert selection.unit == "band"
    assert any("bands left out" in candidate.reason for candidate in selection.candidates)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (Options(fix={"slope": 0.2}), ("cook-torrance",)),
        (Options(fix={"interreflection": 0.0, "specular": 0.1}), ("oren-nayar+",)),
        (Options(tie={"torrance-sparrow.sigma": "oren-nayar.sigma"}), ("oren-nayar+torrance-sparrow",)),
    ],
)
def test_only_models_with_the_constrained_parameters_are_tried(options: Options, words: tuple[str, ...]) -> None:
    selection, _ = selected(CookTorrance(0.3, 0.8, 0.2), options)
    models = [candidate.model for candidate in selection.candidates]
    assert models
    assert all(any(word in model for word in words) for model in models)


def test_a_bare_name_that_only_some_candidates_read_without_doubt_is_no_error() -> None:
    # `sigma` names one parameter of Oren-Nayar, and two of its sum with Torrance-Sparrow.
    selection, _ = selected(OrenNayar(0.8, 0.6), Options(fix={"sigma": 0.6}))
    assert name(selection) == "oren-nayar"


def test_constraints_that_no_candidate_has_are_refused() -> None:
    message = refusal(lambda: selected(Lambert(0.5), Options(fix={"sheen": 1.0})))
    assert "sheen" in message
    assert "--model" in message


def test_the_same_seed_selects_the_same_model_with_the_same_scores() -> None:
    first, second = (selected(OrenNayar(0.6, 0.5))[0] for _ in range(2))
    assert name(first) == name(second)
    assert [c.score for c in first.candidates] == pytest.approx([c.score for c in second.candidates], rel=1e-6)


def test_an_automatic_estimate_is_that_of_the_model_it_names() -> None:
    capture = Studio(size=32).photograph(MATERIALS["cook-torrance(fresnel=schlick,diffuse=0)"], seed=3)
    automatic = estimate(capture)
    named = estimate(capture, automatic.model)
    assert automatic.model == "cook-torrance(fresnel=schlick,diffuse=0)"
    assert automatic.parameters == named.parameters
    assert automatic.skipped["components"] == ["body", "rough body"]
    assert named.skipped["components"] == []


def test_models_beyond_the_first_levels_are_tried_only_where_no_mixture_of_these_would_do() -> None:
    selection, _ = selected(MATERIALS["cook-torrance(lobes=2,fresnel=schlick,diffuse=0)"])
    beyond = [recipe.expression for recipe in RECIPES if recipe.level < DISTRIBUTIONS]
    assert [candidate.model for candidate in selection.candidates] == beyond


GGX = CookTorrance(0.3, 0.8, 0.2, distribution="ggx", masking="smith")


def test_another_slope_distribution_is_tried_where_no_model_holds() -> None:
    quiet = Studio(size=64, noise=Noise(2e-4, 1e-6))
    selection = select(quiet.photograph(GGX, seed=1).samples(), Options())
    assert name(selection) == "cook-torrance(distribution=ggx,masking=smith)"


def test_another_slope_distribution_is_tried_on_request() -> None:
    asked, _ = selected(CookTorrance(0.3, 0.8, 0.2), Options(model="auto(distribution=any)"))
    assert name(asked) == "cook-torrance"
    assert any("ggx" in candidate.model for candidate in asked.candidates)
    unasked, _ = selected(CookTorrance(0.3, 0.8, 0.2))
    assert not any("ggx" in candidate.model for candidate in unasked.candidates)


def test_clipped_highlights_do_not_keep_a_model_from_holding() -> None:
    material = CookTorrance(torch.tensor([0.4, 0.2, 0.1]), torch.tensor([0.8, 0.8, 0.8]), 0.15)
    sensor = Sensor(conditions=Conditions(saturated=0.1))
    samples = subject(sphere(96), ring(6), material, sensor, seed=1).photograph().samples()
    selection = select(samples, Options())
    assert name(selection) == "cook-torrance"
    assert selection.best.holds


def test_a_parameter_that_is_freed_leaves_the_search_where_it_is_held() -> None:
    selection, _ = selected(CookTorrance(0.3, 0.8, 0.2), Options(free=["f0"]))
    assert name(selection) == "cook-torrance"
    assert "f0" in selection.best.left_out.problem.free


def test_values_that_no_candidate_takes_are_named_with_the_reason() -> None:
    message = refusal(lambda: selected(Lambert(0.5), Options(fix={"f0": 2.0})))
    assert "f0" in message
    assert "2" in message.partition("(")[2]


def test_where_no_mixture_predicts_better_than_models_that_fail_no_others_are_tried() -> None:
    # Every other pixel is darker.
    radiance = Studio(size=48).clean(Lambert(0.6))
    radiance[:, ::2] *= 0.6
    selection = select(Studio(size=48).expose(radiance, 1).samples(), Options())
    assert not selection.best.holds
    assert {trial.recipe.level for trial in selection.trials} == {0, 1}


def test_a_small_misfit_is_no_reason_to_try_fewer_models() -> None:
    # A bright gloss differs from the models of the first levels by less than a per cent.
    bright = CookTorrance(torch.tensor([0.4, 0.2, 0.1]), torch.tensor([0.9] * 3), 0.2, 0.1)
    sensor = Sensor(noise=Noise(5e-4, 1e-6))
    selection = select(subject(sphere(64), ring(6), bright, sensor).photograph().samples(), Options())
    assert name(selection) == "cook-torrance(f0=0.1)"
    assert selection.best.holds


def test_where_nothing_holds_a_mixture_that_predicts_better_leads_to_larger_models() -> None:
    # One light is brighter than it is stated.
    material = MATERIALS["cook-torrance(lobes=2,fresnel=schlick,diffuse=0)"]
    radiance = Studio(size=48).clean(material)
    radiance[0] *= 1.3
    selection = select(Studio(size=48).expose(radiance, 1).samples(), Options())
    assert not selection.best.holds
    assert name(selection).startswith("cook-torrance(lobes=2,fresnel=schlick")


def test_another_choice_of_auto_is_refused() -> None:
    assert "auto(distribution=any)" in refusal(lambda: Options(model="auto(lobes=2)"))
