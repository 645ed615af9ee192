"""Which model the images support."""

from __future__ import annotations

import math

import pytest

from matest.brdf import Brdf, CookTorrance, Lambert, OrenNayar
from matest.estimation import selection
from matest.estimation.estimate import estimate
from matest.estimation.options import Options
from matest.estimation.result import Candidate
from matest.estimation.selection import CANDIDATES, select
from matest.photographs.noise import Noise
from tests.captures import directional, refusal
from tests.simulated import Studio


def selected(material: Brdf, options: Options | None = None, images: int = 3) -> tuple[str, list[Candidate], list[str]]:
    """The chosen expression, the record of the comparison, and what was said meanwhile."""
    samples = Studio(size=48, lights=Studio().lights[-images:]).photograph(material, seed=1).samples()
    said: list[str] = []
    expression, candidates = select(samples, options or Options(), said.append)
    return expression, candidates, said


def test_lambertian_images_support_lambert_and_nothing_more() -> None:
    expression, candidates, said = selected(Lambert(0.6))
    assert expression == "lambert"
    assert [candidate.model for candidate in candidates] == list(CANDIDATES)
    assert said == [f"trying {name}" for name in CANDIDATES]
    assert candidates[0].reason == "the simplest model tried"
    assert all("lambert" in candidate.reason for candidate in candidates[1:])


def test_rough_diffuse_images_support_oren_nayar() -> None:
    expression, candidates, _ = selected(OrenNayar(0.8, 0.6))
    assert expression == "oren-nayar"
    errors = {candidate.model: candidate.relative_rmse for candidate in candidates}
    assert errors["oren-nayar"] < 0.8 * errors["lambert"]
    reasons = {candidate.model: candidate.reason for candidate in candidates}
    assert reasons["oren-nayar"] == "meets images left out to their noise, which oren-nayar-qualitative does not"


def test_a_highlight_in_some_bands_of_the_only_image_is_not_called_chance() -> None:
    # Three of four bands say nothing of it; but without it the image is not met to its noise.
    only = tuple((directional(towards, 3.0),) for towards in [(0, 0, 1)])
    samples = Studio(size=64, lights=only).photograph(CookTorrance(0.4, 0.8, 0.15), seed=1).samples()
    expression, candidates = select(samples, Options())
    assert expression == "cook-torrance"
    reasons = {candidate.model: candidate.reason for candidate in candidates}
    assert reasons["cook-torrance"] == "meets bands left out to their noise, which lambert does not"


def test_a_model_that_predicts_every_image_better_is_not_called_chance(monkeypatch: pytest.MonkeyPatch) -> None:
    # How much better differs between images by more than its mean: the light that grazes shows the most.
    monkeypatch.setattr(selection, "CANDIDATES", ("oren-nayar-qualitative", "oren-nayar"))
    samples = Studio(size=32, noise=Noise(0.002, 2e-5)).photograph(OrenNayar(0.8, 0.6), seed=1).samples()
    expression, candidates = select(samples, Options())
    assert candidates[1].score < 0.3 * candidates[0].score
    assert expression == "oren-nayar"


def test_glossy_images_support_a_lobe() -> None:
    expression, _, _ = selected(CookTorrance(0.3, 0.8, 0.2))
    assert expression == "cook-torrance"


def test_a_dark_image_says_nothing_of_any_model() -> None:
    lights = (*Studio().lights[-3:], (directional((0.1, 0.1, 0.98), 0.0),))
    capture = Studio(size=48, lights=lights).photograph(OrenNayar(0.8, 0.6))
    expression, candidates = select(capture.samples(), Options())
    assert expression == "oren-nayar"
    assert all(math.isfinite(candidate.score) for candidate in candidates)


def test_few_images_are_compared_on_bands_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(selection, "CANDIDATES", CANDIDATES[:3])
    expression, candidates, _ = selected(OrenNayar(0.8, 0.6), images=2)
    assert expression == "oren-nayar"
    assert any("bands left out" in candidate.reason for candidate in candidates)


@pytest.mark.parametrize(
    ("options", "eligible"),
    [
        (Options(fix={"slope": 0.2}), CANDIDATES[3::2]),
        (Options(fix={"interreflection": 0.0, "specular": 0.1}), CANDIDATES[4:]),
        (Options(tie={"torrance-sparrow.sigma": "oren-nayar.sigma"}), CANDIDATES[4:5]),
    ],
)
def test_only_models_with_the_constrained_parameters_are_tried(options: Options, eligible: list[str]) -> None:
    _, candidates, _ = selected(Lambert(0.6), options)
    assert [candidate.model for candidate in candidates] == list(eligible)


def test_a_bare_name_that_only_some_candidates_read_without_doubt_is_no_error() -> None:
    # `sigma` names one parameter of Oren-Nayar, and two of its sum with Torrance-Sparrow.
    expression, _, _ = selected(OrenNayar(0.8, 0.6), Options(fix={"sigma": 0.6}))
    assert expression == "oren-nayar"


def test_constraints_that_no_candidate_has_are_refused() -> None:
    message = refusal(lambda: selected(Lambert(0.5), Options(fix={"correlation_length": 1.0})))
    assert "correlation_length" in message
    assert "--model" in message


def test_the_same_seed_selects_the_same_model_with_the_same_scores() -> None:
    options = Options(fix={"slope": 0.2})
    first, second = (selected(OrenNayar(0.6, 0.5), options) for _ in range(2))
    assert first[0] == second[0]
    assert [c.score for c in first[1]] == pytest.approx([c.score for c in second[1]], rel=1e-6)


def test_lobes_that_the_images_do_not_support_are_told() -> None:
    found = estimate(Studio(size=32).photograph(Lambert(0.6), seed=3))
    assert found.model == "lambert"
    assert found.skipped["components"] == ["cook-torrance", "torrance-sparrow"]
    assert estimate(Studio(size=32).photograph(Lambert(0.6), seed=3), "lambert").skipped["components"] == []
