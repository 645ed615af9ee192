"""The verdict on the models that were tried, in sentences."""

from __future__ import annotations

from dataclasses import replace

import pytest

from matest.brdf import Brdf, CookTorrance, Lambert, OrenNayar
from matest.estimation.options import Options
from matest.estimation.selection import Selection, select
from matest.estimation.verdict import equivalents, sentences, telling_light
from matest.photographs.noise import Noise
from tests.captures import directional
from tests.simulated import Studio, coloured


def selection_of(material: Brdf, studio: Studio) -> Selection:
    return select(studio.photograph(material, seed=1).samples(), Options())


def test_a_model_that_holds_and_has_no_rival_needs_no_word() -> None:
    assert [*sentences(selection_of(OrenNayar(0.8, 0.6), Studio(size=48)))] == []


def test_a_rival_that_fits_as_well_is_named_with_its_values_and_the_light_that_would_tell() -> None:
    # A wide faint lobe under one light at the camera, much noise: it may be of metal, or lie under a coat.
    camera = Studio(size=48, lights=((directional((0, 0, 1), 3.0),),), noise=Noise(0.02, 0.001))
    selection = selection_of(CookTorrance(0.4, 0.8, 0.3), camera)
    rivals = equivalents(selection.best, selection.trials)
    said = [*sentences(selection)]
    assert rivals
    assert len(said) == len(rivals)
    for rival, sentence in zip(rivals, said, strict=True):
        assert rival.recipe.expression in sentence
        assert selection.best.recipe.expression in sentence
        assert "° from the camera would tell them apart" in sentence or "no light within 120° of the camera" in sentence
        assert not rival.recipe.components > selection.best.recipe.components


def test_where_no_model_holds_that_is_said_first() -> None:
    # Lights stated 40° off: no reflectance explains that.
    studio = Studio(size=48)
    capture = studio.photograph(OrenNayar(0.7, 0.5), seed=1)
    turned = Studio(size=48, lights=studio.lights[1:] + studio.lights[:1]).scene
    samples = replace(capture.photographs, scene=turned).samples()
    said = [*sentences(select(samples, Options()))]
    assert said[0].startswith("No model of the catalogue predicts images left out to their noise: the best, ")
    assert "nor would a free mixture" in said[0]


@pytest.mark.parametrize(("f0", "surface"), [([0.95, 0.64, 0.54], "metal"), ([0.06, 0.02, 0.02], "coloured gloss")])
def test_only_a_reflectance_that_no_dielectric_has_makes_a_metal(f0: list[float], surface: str) -> None:
    selection = selection_of(CookTorrance(0.0, 1.0, 0.2, f0=f0, fresnel="schlick"), Studio(size=32, lights=coloured()))
    trial = next(each for each in selection.trials if "schlick,diffuse=0" in each.recipe.expression)
    assert trial.surface == surface
    matte = next(each for each in selection.trials if each.recipe.expression == "lambert")
    assert matte.surface == "matte"


def test_the_light_that_tells_a_highlight_from_none_stands_where_the_highlight_is() -> None:
    angle, difference = telling_light(Lambert(0.5), CookTorrance(0.5, 0.5, 0.1))
    assert 0 <= angle <= 120
    assert difference > 0.05
    assert telling_light(Lambert(0.5), Lambert(0.5)) == (0, pytest.approx(0.0))


def test_a_difference_is_relative_to_the_brightest_photograph() -> None:
    angle, difference = telling_light(Lambert(0.5), Lambert(0.6))
    assert angle == 0
    assert difference == pytest.approx(0.2, rel=1e-6)
