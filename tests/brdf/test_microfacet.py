"""Slope distributions and masking."""

from __future__ import annotations

import math

import mpmath
import pytest
import torch
from mpmath import mpf, pi

from matest.brdf.microfacet import beckmann, smith_beckmann, v_cavity
from matest.directions import Directions
from tests import tolerances
from tests.exact import Geometry, angles_and_directions, relative_deviation
from tests.sampling import degrees, gauss_legendre, spherical

SLOPES = [0.01, 0.05, 0.2, 0.5, 1.0]


def tensor(value: float) -> torch.Tensor:
    return torch.tensor(value, dtype=torch.float64)


def smith_g1(theta: mpf, slope: float) -> mpf:
    """1 / (1 + Λ), Λ the integral of the slopes that shade: ∫_μ^∞ (q − μ) p(q) dq / μ, μ = cot θ."""
    mu, m = mpmath.cot(theta), mpf(slope)

    def shade(q: mpf) -> mpf:
        return (q - mu) * mpmath.exp(-((q / m) ** 2)) / (m * mpmath.sqrt(pi))

    return 1 / (1 + mpmath.quad(shade, [mu, mu + m, mu + 3 * m, mu + 8 * m, mu + 20 * m]) / mu)


@pytest.mark.parametrize("slope", SLOPES)
def test_beckmann_facets_project_to_the_unit_area(slope: float) -> None:
    theta, weight = gauss_legendre(300, min(math.pi / 2, 8 * slope))
    # Light and viewer in the same direction make it the half vector.
    half = Directions(spherical(theta), spherical(theta))
    density = beckmann(half, tensor(slope))[:, 0]
    area = (2 * math.pi * weight * density * theta.cos() * theta.sin()).sum().item()
    assert area == pytest.approx(1, rel=tolerances.NORMALISATION)


@pytest.mark.parametrize("slope", SLOPES)
def test_slope_is_the_rms_of_the_facet_slopes(slope: float) -> None:
    theta, weight = gauss_legendre(300, min(math.pi / 2, math.atan(8 * slope)))
    density = beckmann(Directions(spherical(theta), spherical(theta)), tensor(slope))[:, 0]
    second = (2 * math.pi * weight * density * theta.cos() * theta.sin() * theta.tan().square()).sum().sqrt().item()
    assert second == pytest.approx(slope, rel=tolerances.NORMALISATION)


@pytest.mark.parametrize("slope", SLOPES[1:])
def test_printed_beckmann_in_fifty_digits(slope: float) -> None:
    geometries, wi, wo = angles_and_directions(60, seed=1)
    expected = [
        mpmath.exp(-((mpmath.tan(g.alpha) / mpf(slope)) ** 2)) / (pi * mpf(slope) ** 2 * mpmath.cos(g.alpha) ** 4)
        for g in geometries
    ]
    actual = beckmann(Directions(wi, wo), tensor(slope))
    assert relative_deviation(actual, expected) < tolerances.INDEPENDENT


def test_slopes_below_a_thousandth_count_as_a_thousandth() -> None:
    directions = Directions(degrees(30), degrees(30, 180))
    assert beckmann(directions, tensor(0.0)) == beckmann(directions, tensor(1e-3))


def test_printed_v_cavity_masking_in_fifty_digits() -> None:
    geometries, wi, wo = angles_and_directions(100, seed=2)
    expected = [g.v_cavity / (4 * g.cos_i * g.cos_o) for g in geometries]
    assert {g.v_cavity == 1 for g in geometries} == {True, False}
    assert relative_deviation(v_cavity(Directions(wi, wo)), expected) < tolerances.INDEPENDENT


def test_v_cavity_is_bounded_when_one_direction_grazes() -> None:
    graze = torch.stack([spherical(math.pi / 2 - offset) for offset in (1e-3, 1e-6, 1e-9)])
    values = v_cavity(Directions(graze, degrees(40, 150)))
    torch.testing.assert_close(values, values[-1:].expand_as(values), rtol=0.01, atol=0)  # its slope times 1e-3 rad


def test_smith_masking_is_the_quadrature_of_slopes() -> None:
    for slope in (0.2, 0.6, 1.0):
        for theta_i, theta_o in ((0.3, 1.0), (0.9, 1.4), (1.2, 1.55)):
            g = Geometry(mpf(theta_i), mpf(0), mpf(theta_o), mpf(2))
            expected = smith_g1(g.theta_i, slope) * smith_g1(g.theta_o, slope) / (4 * g.cos_i * g.cos_o)
            actual = smith_beckmann(Directions(spherical(theta_i), spherical(theta_o, 2.0)), tensor(slope))
            assert relative_deviation(actual, [expected]) < tolerances.INDEPENDENT


def test_smith_masking_is_that_of_walter_in_closed_form() -> None:
    geometries, wi, wo = angles_and_directions(60, seed=3)

    def g1(theta: mpf) -> mpf:
        a = 1 / (mpf(0.3) * mpmath.tan(theta))
        return 1 / (1 + mpmath.exp(-a * a) / (2 * a * mpmath.sqrt(pi)) - mpmath.erfc(a) / 2)

    expected = [g1(g.theta_i) * g1(g.theta_o) / (4 * g.cos_i * g.cos_o) for g in geometries]
    assert relative_deviation(smith_beckmann(Directions(wi, wo), tensor(0.3)), expected) < tolerances.INDEPENDENT


def test_nothing_is_masked_at_the_normal() -> None:
    straight = Directions(degrees(0), degrees(0))
    for slope in SLOPES:
        assert smith_beckmann(straight, tensor(slope)).item() == pytest.approx(0.25, rel=tolerances.INDEPENDENT)
    assert v_cavity(straight).item() == 0.25


def test_smith_masks_a_rough_surface_more() -> None:
    directions = Directions(degrees(70), degrees(60, 180))
    smooth, rough = (smith_beckmann(directions, tensor(slope)) for slope in (0.1, 0.8))
    assert rough < 0.9 * smooth
