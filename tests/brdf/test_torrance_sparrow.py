"""Torrance & Sparrow's lobe as Oren & Nayar 1994 add it to samples C and D."""

from __future__ import annotations

import math

import mpmath
import pytest
import torch
from mpmath import mpf

from matest.brdf import TorranceSparrow
from tests import tolerances
from tests.exact import Geometry, deviation_from_print
from tests.sampling import BACKWARD, FORWARD, LIGHT, degrees, directional_albedo

SIGMA = math.radians(20)


def printed(g: Geometry, specular: float, sigma: float) -> mpf:
    lobe = mpmath.exp(-(g.alpha**2) / (2 * mpf(sigma) ** 2))
    return specular * g.v_cavity * lobe / (g.cos_i * g.cos_o)


def test_reference_values() -> None:
    brdf = TorranceSparrow(1.0, SIGMA)
    assert brdf(LIGHT, FORWARD).item() == pytest.approx(1.89372964, rel=tolerances.NINE_DIGITS)
    assert brdf(LIGHT, BACKWARD).item() == pytest.approx(0.0371028509, rel=tolerances.NINE_DIGITS)


@pytest.mark.parametrize("sigma", [0.05, SIGMA, 1.5])
def test_printed_equation_in_fifty_digits(sigma: float) -> None:
    brdf = TorranceSparrow(0.3, sigma)
    assert deviation_from_print(brdf, lambda g: printed(g, 0.3, sigma), seed=1) < tolerances.INDEPENDENT


def test_zero_specular_is_black() -> None:
    assert TorranceSparrow(0.0, SIGMA)(degrees(40), degrees(40, 180)).item() == 0


@pytest.mark.parametrize("theta", [0, 30, 55])
def test_mirror_direction_has_no_roughness_in_it(theta: float) -> None:
    """There α = 0, and G = 1 up to 60 degrees: f = ks / cos²θ whatever σ."""
    for sigma in (0.0, 0.1, 1.0):
        value = TorranceSparrow(0.5, sigma)(degrees(theta), degrees(theta, 180)).item()
        assert value == pytest.approx(0.5 / math.cos(math.radians(theta)) ** 2, rel=tolerances.INDEPENDENT)


def test_vanishing_sigma_leaves_the_mirror_direction_only() -> None:
    assert 0 <= TorranceSparrow(1.0, 0.0)(degrees(40), degrees(50, 180)).item() < tolerances.UNDERFLOW


def test_peak_is_farther_from_the_normal_than_the_mirror_direction() -> None:
    views = torch.stack([degrees(theta, 180) for theta in range(90)])
    radiance = TorranceSparrow(1.0, math.radians(8))(degrees(45), views)
    assert 45 < radiance.argmax().item() < 60


@pytest.mark.parametrize(("theta", "albedo"), [(0, 2.26), (60, 2.31), (75, 2.43), (85, 2.55)])
def test_directional_albedo_shows_that_it_is_not_normalised(theta: float, albedo: float) -> None:
    computed = directional_albedo(TorranceSparrow(1.0, SIGMA), math.radians(theta)).item()
    assert computed == pytest.approx(albedo, abs=tolerances.TWO_DECIMALS)
