"""Oren & Nayar 1994, eq. 14-16."""

from __future__ import annotations

import math

import mpmath
import pytest
import torch
from mpmath import mpf, pi

from matest.brdf import Lambert, OrenNayar
from tests import tolerances
from tests.exact import Geometry, deviation_from_print
from tests.sampling import BACKWARD, FORWARD, LIGHT, degrees, directional_albedo, random_pairs

SIGMA = math.radians(30)


def printed(g: Geometry, albedo: float, sigma: float, interreflection: float = 1.0) -> mpf:
    alpha, beta = max(g.theta_i, g.theta_o), min(g.theta_i, g.theta_o)
    s2, cos = mpf(sigma) ** 2, g.cos_azimuth
    c1 = 1 - mpf("0.5") * s2 / (s2 + mpf("0.33"))
    c2 = mpf("0.45") * s2 / (s2 + mpf("0.09")) * (mpmath.sin(alpha) - (0 if cos >= 0 else (2 * beta / pi) ** 3))
    c3 = mpf("0.125") * s2 / (s2 + mpf("0.09")) * (4 * alpha * beta / pi**2) ** 2
    direct = c1 + cos * c2 * mpmath.tan(beta) + (1 - abs(cos)) * c3 * mpmath.tan((alpha + beta) / 2)
    second = mpf("0.17") * s2 / (s2 + mpf("0.13")) * (1 - cos * (2 * beta / pi) ** 2)
    return max(mpf(0), albedo / pi * direct + mpf(interreflection) * mpf(albedo) ** 2 / pi * second)


@pytest.mark.parametrize(
    ("interreflection", "forward", "backward"), [(1.0, 0.186463806, 0.326078873), (0.0, 0.148783948, 0.303376068)]
)
def test_reference_values(interreflection: float, forward: float, backward: float) -> None:
    brdf = OrenNayar(0.9, SIGMA, interreflection)
    assert brdf(LIGHT, FORWARD).item() == pytest.approx(forward, rel=tolerances.NINE_DIGITS)
    assert brdf(LIGHT, BACKWARD).item() == pytest.approx(backward, rel=tolerances.NINE_DIGITS)


@pytest.mark.parametrize(("albedo", "sigma"), [(0.9, SIGMA), (0.2, 0.05), (1.0, 0.6), (0.7, 1.5)])
def test_printed_equations_in_fifty_digits(albedo: float, sigma: float) -> None:
    brdf = OrenNayar(albedo, sigma)
    assert deviation_from_print(brdf, lambda g: printed(g, albedo, sigma), seed=1) < tolerances.INDEPENDENT


def test_printed_direct_part_in_fifty_digits() -> None:
    brdf = OrenNayar(0.8, 0.4, 0.0)
    assert deviation_from_print(brdf, lambda g: printed(g, 0.8, 0.4, 0.0), seed=2) < tolerances.INDEPENDENT


def test_zero_sigma_is_lambert() -> None:
    pairs = random_pairs(200, seed=3)
    torch.testing.assert_close(OrenNayar(0.8, 0.0)(*pairs), Lambert(0.8)(*pairs), rtol=0, atol=0)


def test_small_sigma_departs_from_lambert_with_its_square() -> None:
    pairs = random_pairs(200, seed=4, most=1.0)
    lambert = Lambert(0.8)(*pairs)
    once, twice = (OrenNayar(0.8, sigma)(*pairs) - lambert for sigma in (1e-4, 2e-4))
    torch.testing.assert_close(twice, 4 * once, rtol=1e-5, atol=1e-12)  # next order: σ⁴/0.09


def test_rough_surface_is_flatter_than_lambert() -> None:
    """Under light from the viewer the limb is as bright as the centre: the full moon."""
    brdf = OrenNayar(0.9, SIGMA)
    limb, centre = degrees(70), degrees(0)
    ratio = (brdf(limb, limb) * limb[2] / (brdf(centre, centre) * centre[2])).item()
    assert 1.5 * math.cos(math.radians(70)) < ratio < 1


def test_backward_view_is_brighter_than_forward_view() -> None:
    brdf = OrenNayar(0.9, SIGMA)
    assert brdf(degrees(60), degrees(60, 0)) > 1.5 * brdf(degrees(60), degrees(60, 180))


def test_azimuth_does_not_matter_at_normal_incidence() -> None:
    azimuths = torch.stack([degrees(50, phi) for phi in range(0, 360, 30)])
    values = OrenNayar(0.9, SIGMA)(degrees(0), azimuths)
    torch.testing.assert_close(values, values[:1].expand_as(values), rtol=tolerances.INDEPENDENT, atol=0)


@pytest.mark.parametrize("theta", [20, 60, 85])
def test_case_split_of_c2_is_continuous(theta: float) -> None:
    brdf, light = OrenNayar(0.9, SIGMA), degrees(70)
    before, after = brdf(light, degrees(theta, 90 - 1e-7)), brdf(light, degrees(theta, 90 + 1e-7))
    torch.testing.assert_close(before, after, rtol=1e-6, atol=0)  # slope of |cos Δφ| times 1e-7 degrees


def test_fit_is_cut_at_zero_near_forward_double_grazing() -> None:
    brdf = OrenNayar(0.05, math.radians(50))
    assert brdf(degrees(89.5), degrees(89.5, 180)).item() == 0
    assert brdf(degrees(89.5), degrees(89.5, 0)).item() > 0


def test_second_bounce_grows_with_the_square_of_albedo() -> None:
    pairs = random_pairs(200, seed=5, most=1.0)
    bounce = [OrenNayar(albedo, 0.4)(*pairs) - OrenNayar(albedo, 0.4, 0.0)(*pairs) for albedo in (0.4, 0.8)]
    torch.testing.assert_close(bounce[1], 4 * bounce[0], rtol=1e-10, atol=0)  # a difference of nearby values


def test_interreflection_is_the_reciprocal_of_an_unknown_light_scale() -> None:
    pairs = random_pairs(200, seed=6)
    scaled = 2.5 * OrenNayar(0.3, 0.4)(*pairs)
    torch.testing.assert_close(OrenNayar(0.75, 0.4, 1 / 2.5)(*pairs), scaled, rtol=tolerances.INDEPENDENT, atol=0)


@pytest.mark.parametrize(("theta", "albedo"), [(0, 0.947), (60, 0.971), (75, 0.997), (85, 1.024)])
def test_directional_albedo_of_the_white_facet(theta: float, albedo: float) -> None:
    computed = directional_albedo(OrenNayar(1.0, math.radians(20)), math.radians(theta)).item()
    assert computed == pytest.approx(albedo, abs=tolerances.THREE_DECIMALS)
