"""He, Torrance, Sillion & Greenberg 1991."""

from __future__ import annotations

import itertools
import math
from functools import cache

import mpmath
import pytest
import torch
from mpmath import mpf

from matest.brdf import DirectionalDiffuse, HeTorrance
from matest.brdf.he_torrance import effective_roughness, lambert_w, series, smith_masking
from tests import tolerances
from tests.sampling import BACKWARD, FORWARD, LIGHT, degrees, directional_albedo, random_pairs


def test_reference_values() -> None:
    brdf = HeTorrance(k_dd=1.0, k_ud=0.0, f0=1.0, height_rms=0.23, correlation_length=1.5, wavelength=0.55)
    assert brdf(LIGHT, FORWARD).item() == pytest.approx(0.556931791, rel=tolerances.NINE_DIGITS)
    assert brdf(LIGHT, BACKWARD).item() == pytest.approx(4.4447692e-6, rel=1e-7)


@cache
def logarithms() -> list[tuple[int, mpf, mpf]]:
    """m, ln m and ln m! of the terms of the series."""
    logs = [mpmath.log(m) for m in range(1, 8000)]
    return list(zip(range(1, 8000), logs, itertools.accumulate(logs), strict=True))


@pytest.mark.parametrize(
    ("g", "b"),
    [(1e-6, 0), (0.1, 0), (0.1, 500), (3, 1), (30, 100), (30, 1e4), (300, 50), (400, 1e4), (5000, 1e5), (2000, 1e6)],
)
def test_series_in_fifty_digits(g: float, b: float) -> None:
    log_g = mpmath.log(mpf(g))
    exponents = [m * log_g - mpf(g) - factorial - log - mpf(b) / m for m, log, factorial in logarithms()]
    # Terms of less than 1e-43 of the largest are left out.
    least = max(exponents) - 100
    expected = mpmath.fsum(mpmath.exp(exponent) for exponent in exponents if exponent > least)
    found = series(torch.tensor([g], dtype=torch.float64), torch.tensor([b], dtype=torch.float64))
    # Exponents of up to ten thousand, each rounded.
    assert found.item() == pytest.approx(float(expected), rel=1e-10)


def test_lambert_w_inverts_its_definition() -> None:
    x = torch.logspace(-12, 30, 200, dtype=torch.float64)
    w = lambert_w(x)
    torch.testing.assert_close(w * torch.exp(w), x, rtol=1e-13, atol=0)
    assert lambert_w(torch.zeros(1, dtype=torch.float64)).item() == 0


@pytest.mark.parametrize("half_inverse", [1.25, 2.5, 20.0])
def test_masking_is_the_integral_over_the_slopes_that_hide_a_point(half_inverse: float) -> None:
    """Smith 1967: Λ = ∫ (p − μ)/μ P(p) dp over p > μ = cot θ, P Gaussian of rms √2 σ/τ."""
    slope = 1 / (mpmath.sqrt(2) * half_inverse)
    for theta in (30, 60, 75, 85, 89):
        mu = mpmath.cot(mpmath.radians(theta))
        ends = [mu + i * slope for i in (0, 2, 6, 18)]
        hidden = mpmath.quad(lambda p: (p - mu) / mu * mpmath.npdf(p, 0, slope), ends)  # noqa: B023
        expected = mpmath.ncdf(mu / slope) / (1 + hidden)
        found = smith_masking(torch.tensor(float(half_inverse * mu), dtype=torch.float64))
        assert found.item() == pytest.approx(float(expected), rel=tolerances.INDEPENDENT)


@pytest.mark.parametrize("half_inverse", [1.25, 3.0, 20.0])
def test_effective_roughness_solves_its_printed_equation(half_inverse: float) -> None:
    """He et al. 1991: √(π/2) z0 = (σ0/4)(Ki + Kr) exp(−z0²/(2σ0²)), σ = σ0/√(1 + (z0/σ0)²)."""
    for angles in ((60, 60), (10, 80), (85, 80), (89, 89.9)):
        cot = [mpmath.cot(mpmath.radians(angle)) for angle in angles]
        hidden = sum(mpmath.erfc(half_inverse * c) / c for c in cot)
        given = [torch.tensor(float(value), dtype=torch.float64) for value in (half_inverse, *cot)]
        ratio2 = 1 / mpf(effective_roughness(*given).item()) ** 2 - 1
        # (z0/σ0)² keeps half the digits of σ where it is small.
        z = mpmath.findroot(
            lambda z: mpmath.sqrt(mpmath.pi / 2) * z - hidden / 4 * mpmath.exp(-z * z / 2),  # noqa: B023
            (mpf(0), mpf(6)),
            solver="anderson",
        )
        assert float(ratio2) == pytest.approx(float(z * z), rel=tolerances.INDEPENDENT, abs=tolerances.INDEPENDENT)


@pytest.mark.parametrize("height", [0.02, 0.05, 0.1, 0.3])
def test_coherent_and_diffuse_light_together_are_one_at_normal_incidence(height: float) -> None:
    brdf = HeTorrance(
        k_dd=1.0, k_ud=0.0, f0=1.0, height_rms=height, correlation_length=4.0, coherent="on", solid_angle=0.02
    )
    assert directional_albedo(brdf, 0.0, nodes=96).item() == pytest.approx(1.0, abs=0.02)


def test_the_rough_limit_is_li_and_torrances_lobe() -> None:
    rough = {"k_dd": 1.0, "f0": 1.0, "height_rms": 1.5, "correlation_length": 30.0}
    there = degrees(20, 180)
    for view in (degrees(20), degrees(25), degrees(15, 10)):
        he = HeTorrance(**rough, k_ud=0.0, wavelength=0.4)(there, view).item()
        assert he == pytest.approx(DirectionalDiffuse(**rough)(there, view).item(), rel=0.01)


def test_light_of_any_wavelength_is_diffuse_at_last() -> None:
    """g e-folds with the square of 1/λ: long waves see a mirror."""
    albedo = [
        directional_albedo(
            HeTorrance(k_dd=1.0, k_ud=0.0, f0=1.0, height_rms=0.05, correlation_length=4.0, wavelength=w), 0.0
        ).item()
        for w in (0.3, 0.6, 1.2)
    ]
    expected = [1 - math.exp(-((4 * math.pi * 0.05 / w) ** 2)) for w in (0.3, 0.6, 1.2)]
    assert albedo == pytest.approx(expected, rel=0.02)


def test_a_wavelength_per_channel_is_a_model_per_channel() -> None:
    pairs = random_pairs(20, seed=31)
    wavelengths = [0.61, 0.55, 0.46]
    every = HeTorrance(height_rms=0.1, wavelength=wavelengths, solid_angle=0.05, coherent="on")(*pairs)
    for channel, wavelength in enumerate(wavelengths):
        alone = HeTorrance(height_rms=0.1, wavelength=wavelength, solid_angle=0.05, coherent="on")(*pairs)
        torch.testing.assert_close(every[:, channel : channel + 1], alone, rtol=tolerances.INDEPENDENT, atol=0)
