"""Oren & Nayar 1994, eq. 17."""

from __future__ import annotations

import math

import mpmath
import pytest
import torch
from mpmath import mpf, pi

from matest.brdf import Lambert, OrenNayarQualitative
from tests import tolerances
from tests.exact import Geometry, deviation_from_print
from tests.sampling import BACKWARD, FORWARD, LIGHT, degrees, directional_albedo, random_pairs

SIGMA = math.radians(30)


def printed(g: Geometry, albedo: float, sigma: float) -> mpf:
    alpha, beta = max(g.theta_i, g.theta_o), min(g.theta_i, g.theta_o)
    s2 = mpf(sigma) ** 2
    a = 1 - mpf("0.5") * s2 / (s2 + mpf("0.33"))
    b = mpf("0.45") * s2 / (s2 + mpf("0.09"))
    return albedo / pi * (a + b * max(mpf(0), g.cos_azimuth) * mpmath.sin(alpha) * mpmath.tan(beta))


def test_reference_values() -> None:
    brdf = OrenNayarQualitative(0.9, SIGMA)
    assert brdf(LIGHT, FORWARD).item() == pytest.approx(0.221479247, rel=tolerances.NINE_DIGITS)
    assert brdf(LIGHT, BACKWARD).item() == pytest.approx(0.301782189, rel=tolerances.NINE_DIGITS)


@pytest.mark.parametrize(("albedo", "sigma"), [(0.9, SIGMA), (0.2, 0.05), (1.0, 1.5)])
def test_printed_equation_in_fifty_digits(albedo: float, sigma: float) -> None:
    brdf = OrenNayarQualitative(albedo, sigma)
    assert deviation_from_print(brdf, lambda g: printed(g, albedo, sigma), seed=1) < tolerances.INDEPENDENT


def test_zero_sigma_is_lambert() -> None:
    pairs = random_pairs(200, seed=2)
    torch.testing.assert_close(OrenNayarQualitative(0.8, 0.0)(*pairs), Lambert(0.8)(*pairs), rtol=0, atol=0)


def test_forward_half_plane_is_constant() -> None:
    brdf = OrenNayarQualitative(0.9, SIGMA)
    values = torch.stack([brdf(degrees(60), degrees(theta, phi)) for theta in (10, 50, 80) for phi in (95, 140, 180)])
    torch.testing.assert_close(values, values[:1].expand_as(values), rtol=0, atol=0)


@pytest.mark.parametrize(("theta", "albedo"), [(0, 0.865), (60, 0.942), (75, 0.970), (85, 0.987)])
def test_directional_albedo_of_the_white_facet(theta: float, albedo: float) -> None:
    computed = directional_albedo(OrenNayarQualitative(1.0, math.radians(20)), math.radians(theta)).item()
    assert computed == pytest.approx(albedo, abs=tolerances.THREE_DECIMALS)
