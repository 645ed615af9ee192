"""Portsmouth, Kutz & Hill 2024: the energy-preserving Oren-Nayar model."""

from __future__ import annotations

import math

import mpmath
import pytest
import torch
from mpmath import mpf, pi

from matest.brdf import Eon, Lambert
from tests import tolerances
from tests.exact import Geometry, deviation_from_print
from tests.sampling import BACKWARD, FORWARD, LIGHT, directional_albedo, random_pairs

# So dark that the second lobe, of order ρ², is lost beside the first: Fujii's own model (FON) alone.
BLACK = 1e-11


def a_f(r: float) -> mpf:
    return 1 / (1 + (mpf(1) / 2 - 2 / (3 * pi)) * mpf(r))


def single(g: Geometry, r: float) -> mpf:
    """FON over ρ."""
    s = (g.light.T * g.view)[0] - g.cos_i * g.cos_o
    return a_f(r) / pi * (1 + mpf(r) * s / (max(g.cos_i, g.cos_o) if s > 0 else 1))


def e(theta: mpf, r: float) -> mpf:
    """Albedo of FON at ρ = 1 as printed, with its quotient S/μ."""
    mu, s = mpmath.cos(theta), mpmath.sin(theta)
    g = s * (mpmath.acos(mu) - s * mu) + mpf(2) / 3 * (s / mu * (1 - s**3) - s)
    return a_f(r) * (1 + mpf(r) * g / pi)


def printed(g: Geometry, albedo: float, r: float) -> mpf:
    """FON + (ρms/π)(1 − E)(1 − E)/(1 − Ē)."""
    rho = mpf(albedo)
    average = a_f(r) * (1 + (mpf(2) / 3 - 28 / (15 * pi)) * mpf(r))
    rho_ms = rho**2 * average / (1 - rho * (1 - average))
    return rho * single(g, r) + rho_ms / pi * (1 - e(g.theta_i, r)) * (1 - e(g.theta_o, r)) / (1 - average)


def test_reference_values() -> None:
    brdf = Eon(0.9, 0.5)
    assert brdf(LIGHT, FORWARD).item() == pytest.approx(0.191788843, rel=tolerances.NINE_DIGITS)
    assert brdf(LIGHT, BACKWARD).item() == pytest.approx(0.37068633, rel=tolerances.NINE_DIGITS)


def test_reference_values_of_single_scattering() -> None:
    brdf = Eon(BLACK, 0.5)
    for view, value in ((FORWARD, 0.17515143), (BACKWARD, 0.354048917)):
        assert 0.9 / BLACK * brdf(LIGHT, view).item() == pytest.approx(value, rel=tolerances.NINE_DIGITS)


@pytest.mark.parametrize(("albedo", "r"), [(0.9, 0.5), (0.2, 0.03), (1.0, 1.0), (0.7, 1e-6)])
def test_printed_equation_in_fifty_digits(albedo: float, r: float) -> None:
    assert deviation_from_print(Eon(albedo, r), lambda g: printed(g, albedo, r), seed=1) < tolerances.INDEPENDENT


def test_printed_albedo_is_that_of_single_scattering() -> None:
    for theta in (0.0, 0.7, 1.3):
        computed = directional_albedo(Eon(BLACK, 0.8), theta, nodes=128).item() / BLACK
        assert computed == pytest.approx(float(e(mpf(theta), 0.8)), abs=tolerances.EON_FURNACE)


def test_zero_roughness_is_lambert() -> None:
    pairs = random_pairs(200, seed=2)
    flat = Eon(0.8, 0.0)(*pairs)
    torch.testing.assert_close(flat, Lambert(0.8)(*pairs), rtol=0, atol=0)


@pytest.mark.parametrize("theta", [0, 20, 40, 60, 75, 85, 89, 89.9])
def test_white_furnace_is_invisible(theta: float) -> None:
    roughness = torch.tensor([0.01, 0.3, 0.6, 1.0], dtype=torch.float64)
    albedo = directional_albedo(Eon(1.0, roughness), math.radians(theta), nodes=128)
    torch.testing.assert_close(albedo, torch.ones_like(albedo), rtol=0, atol=tolerances.EON_FURNACE)


def test_coloured_furnace_saturates() -> None:
    """Ē ρ/(1 − ρ(1 − Ē)) is the albedo under light from all sides: more bounces, more colour."""
    nodes, weights = (torch.linspace(0, 1, 201, dtype=torch.float64), torch.full((201,), 1 / 200, dtype=torch.float64))
    weights[[0, -1]] /= 2
    rho, r = 0.5, 1.0
    average = float(a_f(r) * (1 + (mpf(2) / 3 - 28 / (15 * pi)) * r))
    # cos² is uniform under uniform light.
    albedos = [directional_albedo(Eon(rho, r), math.acos(math.sqrt(x)), nodes=48).item() for x in nodes[1:].tolist()]
    whole = (torch.tensor([rho, *albedos], dtype=torch.float64) * weights).sum().item()
    assert whole == pytest.approx(rho * average / (1 - rho * (1 - average)), abs=tolerances.FURNACE)


@pytest.mark.parametrize(("theta", "albedo"), [(0, 0.777), (60, 0.865), (75, 0.931), (85, 0.978)])
def test_directional_albedo_of_single_scattering(theta: float, albedo: float) -> None:
    computed = directional_albedo(Eon(BLACK, 1.0), math.radians(theta)).item() / BLACK
    assert computed == pytest.approx(albedo, abs=tolerances.THREE_DECIMALS)


def test_multiple_scattering_returns_more_light_from_bright_facets() -> None:
    pairs = random_pairs(100, seed=3)
    dark, bright = (Eon(rho, 1.0)(*pairs) / rho for rho in (0.1, 0.9))
    assert (bright > dark).all()
