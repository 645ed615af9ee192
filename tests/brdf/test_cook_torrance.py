"""Cook & Torrance 1982."""

from __future__ import annotations

import math

import mpmath
import pytest
import torch
from mpmath import mpf, pi

from matest.brdf import CookTorrance, Lambert
from matest.errors import InputError
from tests import tolerances
from tests.exact import Geometry, deviation_from_print
from tests.sampling import BACKWARD, FORWARD, LIGHT, degrees, directional_albedo, random_pairs

FACTORS = {"physical": 1.0, "ngan": 4 / math.pi, "paper1982": 4.0}


def printed_lobe(g: Geometry, slope: float, f0: float) -> mpf:
    """F D G / (π ci cr), the D of 1982 with the 4 m² in its denominator that makes it physical."""
    root = mpmath.sqrt(mpf(f0))
    index, c = (1 + root) / (1 - root), g.cos_difference
    gg = mpmath.sqrt(index**2 + c**2 - 1)
    fresnel = ((gg - c) / (gg + c)) ** 2 / 2 * (1 + ((c * (gg + c) - 1) / (c * (gg - c) + 1)) ** 2)
    d = mpmath.exp(-((mpmath.tan(g.alpha) / mpf(slope)) ** 2)) / (4 * mpf(slope) ** 2 * mpmath.cos(g.alpha) ** 4)
    return fresnel * d * g.v_cavity / (pi * g.cos_i * g.cos_o)


def test_reference_values() -> None:
    brdf = CookTorrance(diffuse=0.0, specular=1.0, slope=0.3, f0=0.04)
    assert brdf(LIGHT, FORWARD).item() == pytest.approx(0.0415935565, rel=tolerances.NINE_DIGITS)
    assert brdf(LIGHT, BACKWARD).item() == pytest.approx(2.04462396e-11, rel=tolerances.NINE_DIGITS)


@pytest.mark.parametrize(("slope", "f0"), [(0.3, 0.04), (0.05, 0.5), (1.0, 0.001), (0.2, 0.95)])
def test_printed_lobe_in_fifty_digits(slope: float, f0: float) -> None:
    brdf = CookTorrance(0.0, 0.7, slope, f0)
    assert deviation_from_print(brdf, lambda g: 0.7 * printed_lobe(g, slope, f0), seed=1) < tolerances.INDEPENDENT


def test_printed_sum_of_body_and_lobe_in_fifty_digits() -> None:
    brdf = CookTorrance(0.4, 0.6, 0.25, 0.05)
    whole = deviation_from_print(brdf, lambda g: mpf(0.4) / pi + mpf(0.6) * printed_lobe(g, 0.25, 0.05), seed=2)
    assert whole < tolerances.INDEPENDENT


def test_zero_specular_is_lambert() -> None:
    pairs = random_pairs(200, seed=3)
    torch.testing.assert_close(CookTorrance(0.6, 0.0)(*pairs), Lambert(0.6)(*pairs), rtol=0, atol=0)


@pytest.mark.parametrize("normalisation", FACTORS)
def test_normalisations_differ_by_their_divisors(normalisation: str) -> None:
    pairs = random_pairs(200, seed=4)
    physical = CookTorrance(0.0, 1.0)(*pairs)
    other = CookTorrance(0.0, 1.0, normalisation=normalisation)(*pairs)
    expected = FACTORS[normalisation] * physical
    torch.testing.assert_close(other, expected, rtol=tolerances.INDEPENDENT, atol=tolerances.UNDERFLOW)


@pytest.mark.parametrize("masking", ["v-cavity", "smith"])
@pytest.mark.parametrize("theta", [0, 30])
def test_smooth_surface_has_the_albedo_of_its_fresnel_reflectance(masking: str, theta: float) -> None:
    brdf = CookTorrance(0.0, 1.0, 0.05, 0.04, masking=masking)
    # Snell's law for n = 1.5.
    cos_i = math.cos(math.radians(theta))
    cos_t = math.sqrt(1 - (math.sin(math.radians(theta)) / 1.5) ** 2)
    s, p = (cos_i - 1.5 * cos_t) / (cos_i + 1.5 * cos_t), (1.5 * cos_i - cos_t) / (1.5 * cos_i + cos_t)
    fresnel = (s * s + p * p) / 2
    assert directional_albedo(brdf, math.radians(theta)).item() == pytest.approx(fresnel, rel=tolerances.SMOOTH_LIMIT)


def test_maskings_agree_where_nothing_is_masked() -> None:
    pairs = degrees(10), degrees(12, 175)
    cavity, smith = (CookTorrance(0.0, 1.0, 0.2, masking=masking)(*pairs) for masking in ("v-cavity", "smith"))
    torch.testing.assert_close(cavity, smith, rtol=tolerances.NORMALISATION, atol=0)


def test_reflectance_rises_towards_grazing() -> None:
    brdf = CookTorrance(0.0, 1.0, 0.2, 0.04)
    assert directional_albedo(brdf, math.radians(80)) > 5 * directional_albedo(brdf, 0.0)


@pytest.mark.parametrize(("theta", "albedo"), [(0, 0.999980), (60, 0.965587), (75, 0.927517), (85, 0.959758)])
def test_directional_albedo_of_a_perfect_reflector(theta: float, albedo: float) -> None:
    """Against the integral of G (V·H)/(N·L) over Gaussian facet slopes, which needs neither D nor the divisor 4."""
    computed = directional_albedo(CookTorrance(0.0, 1.0, 0.2, 1.0), math.radians(theta), nodes=192).item()
    assert computed == pytest.approx(albedo, abs=tolerances.PERFECT_REFLECTOR)


def test_unknown_masking_names_the_known_ones() -> None:
    with pytest.raises(InputError, match="masking must be one of v-cavity, smith; got 'shadow'"):
        CookTorrance(masking="shadow")
