from __future__ import annotations

import math

import pytest
import torch

from matest.brdf import BlinnPhong, CookTorrance, Lambert
from matest.brdf.curvature import SHARPEST, curvature


def test_a_matte_surface_has_that_of_the_cosine() -> None:
    """The cosine is steepest at the horizon, where its slope is 1."""
    assert curvature(Lambert(albedo=torch.tensor([0.2, 0.5, 0.3]))) == pytest.approx(math.e, rel=0.01)


@pytest.mark.parametrize("slope", [0.03, 0.1])
def test_a_highlight_has_that_of_a_gaussian_of_its_width(slope: float) -> None:
    """Seen from above, Beckmann's lobe is exp(−(θ/2)²/m²) for small angles: s² = 2 m²; seen aslant it is narrower."""
    expected = 1 / (2 * slope**2)
    assert expected * 0.9 < curvature(CookTorrance(diffuse=0.0, specular=0.5, slope=slope)) < 2 * expected
    assert curvature(CookTorrance(diffuse=0.0, specular=0.5, slope=0.05)) == pytest.approx(SHARPEST, rel=0.6)


def test_a_weak_highlight_counts_less() -> None:
    strong, weak = (curvature(CookTorrance(diffuse=0.8, specular=share, slope=0.05)) for share in (0.5, 0.02))
    assert weak < 0.5 * strong


def test_models_without_a_slope_have_one_too() -> None:
    assert curvature(BlinnPhong()) > math.e
