"""Slope distributions and masking."""

from __future__ import annotations

import math

import mpmath
import pytest
import torch
from mpmath import mpf, pi

from matest.brdf.microfacet import beckmann, gaussian, gaussian_constant, ggx, smith_beckmann, smith_ggx, v_cavity
from matest.directions import Directions
from tests import tolerances
from tests.brdf import microsurface
from tests.exact import Geometry, angles_and_directions, relative_deviation
from tests.sampling import degrees, gauss_legendre, spherical

SLOPES = [0.01, 0.05, 0.2, 0.5, 1.0]
ALL_SLOPES = [0.001, 0.003, 0.01, 0.05, 0.2, 0.5, 0.8, 1.0]


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


def projected_area(density: torch.Tensor, theta: torch.Tensor, weight: torch.Tensor) -> float:
    return (2 * math.pi * weight * density[:, 0] * theta.cos() * theta.sin()).sum().item()


@pytest.mark.parametrize("slope", ALL_SLOPES)
def test_gaussian_facets_project_to_the_unit_area(slope: float) -> None:
    theta, weight = gauss_legendre(300, min(math.pi / 2, 8 * slope))
    density = gaussian(Directions(spherical(theta), spherical(theta)), tensor(slope))
    assert projected_area(density, theta, weight) == pytest.approx(1, rel=tolerances.NORMALISATION)


@pytest.mark.parametrize("slope", ALL_SLOPES)
def test_ggx_facets_project_to_the_unit_area(slope: float) -> None:
    # tan α = m tan x spreads the tail of the lobe; the last 0.06 degrees have 1e-6 of cos² and no light.
    x, weight = gauss_legendre(300, math.atan(1e3 / slope))
    theta = torch.atan(slope * x.tan())
    jacobian = slope / (x.cos().square() + (slope * x.sin()).square())
    density = ggx(Directions(spherical(theta), spherical(theta)), tensor(slope))
    # Facets steeper than tan α = 1000: m²/(m² + tan²α) of the area.
    rest = slope**2 / (slope**2 + 1e6)
    assert projected_area(density, theta, weight * jacobian) + rest == pytest.approx(1, rel=tolerances.NORMALISATION)


@pytest.mark.parametrize("slope", ALL_SLOPES)
def test_gaussian_constant_in_fifty_digits(slope: float) -> None:
    expected = microsurface.gaussian_constant(mpf(slope))
    assert relative_deviation(gaussian_constant(tensor(slope)), [expected]) < tolerances.INDEPENDENT


def test_gaussian_constant_takes_tensors_and_has_the_printed_values() -> None:
    constants = gaussian_constant(torch.tensor([0.1, 0.3, 0.6], dtype=torch.float64))
    assert constants.tolist() == pytest.approx([32.04, 3.754, 1.117], rel=5e-4)  # four printed digits


@pytest.mark.parametrize("slope", ALL_SLOPES[3:])
def test_derivative_of_the_gaussian_constant(slope: float) -> None:
    m = tensor(slope).requires_grad_()
    gaussian_constant(m).backward()
    step = mpf("1e-15")
    change = microsurface.gaussian_constant(mpf(slope) + step) - microsurface.gaussian_constant(mpf(slope) - step)
    assert m.grad is not None
    assert m.grad.item() == pytest.approx(float(change / (2 * step)), rel=1e-10)  # of a series of 40 terms


@pytest.mark.parametrize("slope", SLOPES[1:])
@pytest.mark.parametrize("name", ["gaussian", "ggx"])
def test_printed_distributions_in_fifty_digits(name: str, slope: float) -> None:
    density = {"gaussian": gaussian, "ggx": ggx}[name]
    geometries, wi, wo = angles_and_directions(60, seed=4)
    expected = [getattr(microsurface, name)(g, mpf(slope)) for g in geometries]
    assert relative_deviation(density(Directions(wi, wo), tensor(slope)), expected) < tolerances.INDEPENDENT


@pytest.mark.parametrize("name", ["gaussian", "ggx"])
def test_other_slopes_below_a_thousandth_count_as_a_thousandth(name: str) -> None:
    density = {"gaussian": gaussian, "ggx": ggx}[name]
    directions = Directions(degrees(30), degrees(30, 180))
    assert density(directions, tensor(0.0)) == density(directions, tensor(1e-3))


def test_narrow_gaussian_is_beckmanns() -> None:
    directions = Directions(degrees(30), torch.stack([degrees(theta, 180) for theta in (30, 31, 32)]))
    narrow = [density(directions, tensor(0.01)) for density in (gaussian, beckmann)]
    torch.testing.assert_close(*narrow, rtol=1e-3, atol=0)  # (α/m)⁴ m² and 2m²/3


def test_smith_masking_of_ggx_is_the_quadrature_of_slopes() -> None:
    for slope in (0.05, 0.4, 1.0):
        for theta_i, theta_o in ((0.3, 1.0), (0.9, 1.4), (1.2, 1.55)):
            g = Geometry(mpf(theta_i), mpf(0), mpf(theta_o), mpf(2))
            density = microsurface.ggx_slopes(mpf(slope))
            sides = [microsurface.smith_g1(theta, density, mpf(slope)) for theta in (g.theta_i, g.theta_o)]
            expected = sides[0] * sides[1] / (4 * g.cos_i * g.cos_o)
            actual = smith_ggx(Directions(spherical(theta_i), spherical(theta_o, 2.0)), tensor(slope))
            assert relative_deviation(actual, [expected]) < tolerances.INDEPENDENT


@pytest.mark.parametrize("theta", [0.4, 1.1])
def test_masked_ggx_facets_project_to_the_area_seen(theta: float) -> None:
    """G1 ∫ max(0, V·H) D(H) dω = cos θ: of what faces the viewer just so much is hidden."""
    m = 0.5
    # Slopes tan α = m tan x at every azimuth; the weight is D cos α dω = sin 2x dx dφ / 2π.
    x, weight = gauss_legendre(400, math.pi / 2)
    azimuth = (torch.arange(2000, dtype=torch.float64) + 0.5) * (math.pi / 1000)
    facing = math.cos(theta) + math.sin(theta) * m * x.tan()[:, None] * azimuth.cos()
    area = ((2 * x).sin() * weight * facing.clamp(min=0).mean(-1)).sum().item()
    g1 = 4 * math.cos(theta) * smith_ggx(Directions(spherical(theta), spherical(0.0)), tensor(m)).item()
    assert g1 * area == pytest.approx(math.cos(theta), rel=1e-5)  # facing has a kink


def test_smith_masking_of_ggx_is_bounded_at_grazing() -> None:
    straight, grazing = degrees(0), torch.stack([spherical(math.pi / 2 - offset) for offset in (1e-3, 1e-6, 1e-9)])
    values = smith_ggx(Directions(grazing, straight), tensor(0.3))
    torch.testing.assert_close(values, torch.full_like(values, 0.5 / 0.3), rtol=0.01, atol=0)  # 1e-3 / m
    assert smith_ggx(Directions(straight, straight), tensor(0.3)).item() == pytest.approx(0.25)
