"""Fujii's improvement of Oren and Nayar's qualitative model."""

from __future__ import annotations

import math

import pytest
import torch
from mpmath import mpf, pi

from matest.brdf import Fujii, Lambert, OrenNayarQualitative
from tests import tolerances
from tests.exact import Geometry, deviation_from_print
from tests.sampling import BACKWARD, FORWARD, LIGHT, closed_domain_pairs, degrees, directional_albedo, random_pairs

SIGMA = math.radians(30)


def printed(g: Geometry, albedo: float, sigma: float, interreflection: float = 1.0) -> mpf:
    """(ρ/π)(A + B s/t), s = L·V − (N·L)(N·V)."""
    s2, rho = mpf(sigma) ** 2, mpf(albedo)
    s = (g.light.T * g.view)[0] - g.cos_i * g.cos_o
    t = max(g.cos_i, g.cos_o) if s > 0 else mpf(1)
    a = 1 - mpf("0.5") * s2 / (s2 + mpf("0.33")) + mpf(interreflection) * mpf("0.17") * rho * s2 / (s2 + mpf("0.13"))
    return rho / pi * (a + mpf("0.45") * s2 / (s2 + mpf("0.09")) * s / t)


def test_reference_values() -> None:
    brdf = Fujii(0.9, SIGMA)
    assert brdf(LIGHT, FORWARD).item() == pytest.approx(0.192857159, rel=tolerances.NINE_DIGITS)
    assert brdf(LIGHT, BACKWARD).item() == pytest.approx(0.331514771, rel=tolerances.NINE_DIGITS)


@pytest.mark.parametrize(
    ("albedo", "sigma", "interreflection"), [(0.9, SIGMA, 1.0), (0.2, 0.05, 1.0), (1.0, 1.5, 0.3), (0.7, 0.6, 0.0)]
)
def test_printed_equation_in_fifty_digits(albedo: float, sigma: float, interreflection: float) -> None:
    brdf = Fujii(albedo, sigma, interreflection)
    deviation = deviation_from_print(brdf, lambda g: printed(g, albedo, sigma, interreflection), seed=1)
    assert deviation < tolerances.INDEPENDENT


def test_zero_sigma_is_lambert() -> None:
    pairs = random_pairs(200, seed=2)
    torch.testing.assert_close(Fujii(0.8, 0.0)(*pairs), Lambert(0.8)(*pairs), rtol=0, atol=0)


@pytest.mark.parametrize("sigma", [0.1, SIGMA, math.pi / 2])
def test_values_are_positive_down_to_grazing_without_a_cut(sigma: float) -> None:
    wi, wo = closed_domain_pairs(torch.float64)
    above = (wi[:, 2] > 0) & (wo[:, 2] > 0)
    assert (Fujii(0.9, sigma, 0.0)(wi, wo)[above] > 0.03).all()


def test_near_side_is_the_qualitative_model() -> None:
    views = torch.stack([degrees(theta, phi) for theta in (10, 45, 80) for phi in (0, 30, 89)])
    near = Fujii(0.9, SIGMA, 0.0)(degrees(60), views)
    torch.testing.assert_close(near, OrenNayarQualitative(0.9, SIGMA)(degrees(60), views))


def test_far_side_is_darker_than_the_qualitative_model() -> None:
    views = torch.stack([degrees(theta, phi) for theta in (10, 45, 80) for phi in (95, 140, 180)])
    far, flat = (brdf(degrees(60), views) for brdf in (Fujii(0.9, SIGMA, 0.0), OrenNayarQualitative(0.9, SIGMA)))
    assert (far < flat).all()


def test_second_bounce_does_not_depend_on_the_directions() -> None:
    pairs = random_pairs(50, seed=3)
    bounce = Fujii(0.8, SIGMA)(*pairs) - Fujii(0.8, SIGMA, 0.0)(*pairs)
    s2 = SIGMA**2
    expected = torch.full_like(bounce, 0.17 * 0.64 / math.pi * s2 / (s2 + 0.13))
    torch.testing.assert_close(bounce, expected, rtol=1e-9, atol=0)  # a difference of values of up to 1e2


def test_albedo_exceeds_one_for_the_whitest_facets_only() -> None:
    """By 2.9 %, where light grazes."""
    sigma, grazing = torch.tensor([0.2, 0.27, 0.35], dtype=torch.float64), math.radians(89.9)
    white, whitish = (directional_albedo(Fujii(rho, sigma), grazing, nodes=96).max().item() for rho in (1.0, 0.97))
    assert white == pytest.approx(1.0285, abs=tolerances.FURNACE)
    assert whitish < 1
