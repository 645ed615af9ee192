"""One definition of the relative error: of the fit, of images left out, of a prediction and of candidates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import matest
from matest.brdf import Brdf, CookTorrance, OrenNayar
from matest.capture import Capture
from matest.estimation.prediction import prediction_errors
from matest.photographs.photometry import Encoding
from matest.shading import render
from tests.captures import changed, directional
from tests.simulated import Studio

# Rounding of radiance in single precision.
ROUNDING = 1e-5
CLIP = 0.3


def spoilt(material: Brdf, *, outliers: float = 0.0, clip: float | None = None) -> Capture:
    """Photographs with a share of wild pixels, and cut off above `clip`."""
    capture = Studio(size=48).photograph(material, seed=1)
    generator = np.random.default_rng(2)
    stored = []
    for image in capture.photographs.stored:
        wild = generator.random(len(image)) < outliers
        pixels = np.where(wild[:, None], generator.random(image.shape), image)
        stored.append((pixels if clip is None else pixels.clip(max=clip)).astype(np.float32))
    capture = changed(capture, stored=tuple(stored))
    # Floats are saturated above the limit: what is cut off at it lies a little beyond.
    return capture if clip is None else changed(capture, encoding=Encoding(saturation=clip * (1 - 1e-6)))


def by_hand(capture: Capture, material: Brdf, images: range | list[int]) -> float:
    """Rms residual over rms signal of all usable values, in double precision."""
    scene, samples = capture.scene, capture.samples()
    rendered = render(scene, material).numpy().reshape(len(scene), -1, scene.channels)[:, scene.surface.pixels]
    residual = signal = 0.0
    for image in images:
        usable = samples.usable(image)
        measured = capture.radiance(image)[usable].astype(np.float64)
        model = rendered[image][usable].astype(np.float64)
        top = capture.photographs.encoding.saturation
        if top is not None:
            saturated = measured > top
            measured = np.where(saturated, top, measured)
            kept = ~saturated | (model < top)
            measured, model = measured[kept], model[kept]
        residual += ((measured - model) ** 2).sum()
        signal += (measured**2).sum()
    return float(np.sqrt(residual / signal))


@pytest.mark.parametrize("clip", [None, CLIP])
@pytest.mark.parametrize("outliers", [0.0, 0.03])
def test_prediction_and_images_left_out_have_the_error_of_the_definition(outliers: float, clip: float | None) -> None:
    material = CookTorrance(0.3, 0.8, 0.25)
    capture = spoilt(material, outliers=outliers, clip=clip)
    # Not the truth: the model is to lie on both sides of the clip.
    other = replace(material, specular=material.specular * 0.8)
    errors = prediction_errors(capture, other)
    for image, error in enumerate(errors.images):
        assert error == pytest.approx(by_hand(capture, other, [image]), rel=1e-3)
    assert errors.pooled == pytest.approx(by_hand(capture, other, range(len(capture))), rel=1e-3)


@pytest.mark.parametrize("clip", [None, CLIP])
def test_the_error_of_a_fit_counts_outliers_and_saturated_values_as_a_prediction_does(clip: float | None) -> None:
    capture = spoilt(CookTorrance(0.3, 0.8, 0.25), outliers=0.03, clip=clip)
    found = matest.estimate(capture, "cook-torrance", fix={"f0": 0.04})
    errors = prediction_errors(capture, found.material)
    assert found.fit.relative_rmse == pytest.approx(errors.pooled, rel=2e-3)
    assert found.fit.relative_rmse_trimmed < 0.5 * found.fit.relative_rmse
    assert found.fit.values_left_out > 100


@pytest.mark.parametrize("clip", [None, CLIP])
def test_where_nothing_is_left_out_the_trimmed_error_is_the_error(clip: float | None) -> None:
    fit = matest.estimate(spoilt(CookTorrance(0.3, 0.8, 0.25), clip=clip), "cook-torrance", fix={"f0": 0.04}).fit
    assert fit.values_left_out == 0
    assert fit.relative_rmse_trimmed == pytest.approx(fit.relative_rmse, rel=1e-9)


def test_an_image_left_out_has_the_error_that_a_prediction_gives_it() -> None:
    capture = spoilt(OrenNayar(0.6, 0.5), outliers=0.02)
    found = matest.estimate(capture, "oren-nayar", holdout=[2])
    assert found.holdout is not None
    assert found.holdout["relative_rmse"] == pytest.approx(prediction_errors(capture, found.material).images[2])


def test_candidates_have_the_error_that_a_prediction_of_images_left_out_has() -> None:
    capture = spoilt(CookTorrance(0.3, 0.8, 0.1))
    found = matest.estimate(capture)
    chosen = next(one for one in found.candidates if one.model == found.model)
    left_out = [matest.estimate(capture, found.model, holdout=[image]).holdout for image in range(len(capture))]
    expected = np.sqrt(np.mean([one["relative_rmse"] ** 2 for one in left_out if one is not None]))
    # Of a sample, from fits of a pilot, in four folds; even over angles it would be three times as large.
    assert chosen.relative_rmse == pytest.approx(expected, rel=0.3)


def test_what_was_left_out_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    from matest.commands.console import console
    from matest.report.tables import estimate_table

    found = matest.estimate(spoilt(OrenNayar(0.6, 0.5), outliers=0.02), "oren-nayar")
    console().print(estimate_table(found))
    text = " ".join(capsys.readouterr().out.split())
    assert f"without the {found.fit.values_left_out:,} values left out as outliers" in text


def test_an_image_that_no_light_reaches_has_no_error_and_adds_nothing_to_the_others() -> None:
    material = OrenNayar(0.6, 0.5)
    capture = Studio(size=48, lights=(*Studio.lights, (directional((0.0, 0.2, -0.9), 3.0),))).photograph(material)
    errors = prediction_errors(capture, material)
    assert errors.images[-1] is None
    assert errors.pooled == pytest.approx(prediction_errors(Studio(size=48).photograph(material), material).pooled)
    found = matest.estimate(capture, "oren-nayar", holdout=[len(Studio.lights)])
    assert found.holdout == {"images": [len(Studio.lights)], "relative_rmse": None, "median_error": None}


def test_an_image_under_the_sky_alone_has_an_error_like_any_other() -> None:
    material = OrenNayar(0.6, 0.5)
    studio = Studio(size=48, lights=(*Studio.lights, ()), ambient=0.2)
    capture, last = studio.photograph(material, seed=1), len(Studio.lights)
    errors = prediction_errors(capture, material)
    assert errors.images[-1] == pytest.approx(by_hand(capture, material, [last]), rel=1e-3)
    found = matest.estimate(capture, "oren-nayar", holdout=[last])
    assert found.holdout is not None
    assert found.holdout["relative_rmse"] == pytest.approx(by_hand(capture, found.material, [last]), rel=1e-3)
