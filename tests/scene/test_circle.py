from __future__ import annotations

import cv2
import numpy as np
import pytest

from matest.scene.circle import fit_circle
from tests.captures import refusal
from tests.scene.discs import disc


@pytest.mark.parametrize(("subpixels", "tolerance"), [(16, 0.02), (1, 0.1)], ids=["anti-aliased", "binary"])
def test_circle_fit_is_exact_to_a_fraction_of_a_pixel(subpixels, tolerance):
    for centre, radius in [((50.3, 44.8), 36.6), ((48.0, 51.5), 20.25), ((60.77, 40.1), 30.0)]:
        circle = fit_circle(disc((100, 110), centre, radius, subpixels))
        np.testing.assert_allclose(circle.centre, centre, atol=tolerance)
        assert circle.radius == pytest.approx(radius, abs=tolerance)


@pytest.mark.parametrize("subpixels", [1, 16])
def test_a_cropped_sphere_is_fitted_by_the_edge_that_is_visible(subpixels):
    circle = fit_circle(disc((100, 110), (95.2, 12.6), 40.4, subpixels))
    np.testing.assert_allclose(circle.centre, (95.2, 12.6), atol=0.2)
    assert circle.radius == pytest.approx(40.4, abs=0.2)


def test_circle_fit_takes_any_numeric_mask():
    mask = disc((60, 60), (30.2, 29.9), 20.0, 8)
    circle, scaled = fit_circle(mask), fit_circle(mask * 65535)
    assert scaled.centre == pytest.approx(circle.centre)
    assert scaled.radius == pytest.approx(circle.radius)


@pytest.mark.parametrize("shape", ["square", "ellipse", "two discs"])
def test_a_mask_that_is_no_circle_is_refused(shape):
    mask = np.zeros((120, 120), np.uint8)
    if shape == "square":
        mask[30:90, 30:90] = 1
    elif shape == "ellipse":
        mask = cv2.ellipse(mask, (60, 60), (50, 30), 0, 0, 360, 1, -1)
    else:
        mask = (disc((120, 120), (40, 60), 25, 1) + disc((120, 120), (80, 60), 25, 1) > 0).astype(np.uint8)
    assert "circle" in refusal(lambda: fit_circle(mask))


def test_a_mask_without_background_is_refused():
    assert "edge" in refusal(lambda: fit_circle(np.ones((40, 40))))


@pytest.mark.parametrize("edge", ["binary", "anti-aliased", "drawn by hand"])
def test_the_standard_errors_are_those_of_repeated_fits(edge: str) -> None:
    generator = np.random.default_rng(0)
    errors, variances = [], []
    for _ in range(60):
        centre, radius = generator.uniform(45, 60, 2), generator.uniform(30, 42)
        # A hand wobbles evenly at up to 12 waves around: the edge's error is correlated over ten pixels and more.
        waves = 0.1 * generator.standard_normal((13, 2))
        waves[0] /= np.sqrt(2)
        mask = disc((105, 105), tuple(centre), radius, 1 if edge == "binary" else 8, waves * (edge == "drawn by hand"))
        circle = fit_circle(mask)
        errors.append([*(np.array(circle.centre) - centre), circle.radius - radius])
        variances.append([circle.centre_std**2, circle.centre_std**2, circle.radius_std**2])
    ratio = np.sqrt(np.mean(variances, axis=0) / np.mean(np.square(errors), axis=0))
    assert (ratio > 0.75).all()
    assert (ratio < 1.6).all()
