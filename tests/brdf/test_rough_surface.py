"""S and σe of Li & Torrance 2005 against the exact functions that they approximate."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.special import erfc
from scipy.stats import norm

from matest.brdf import DirectionalDiffuse
from matest.directions import Directions
from tests import tolerances
from tests.sampling import degrees, spherical

# Degrees, fine enough for what happens near the horizon.
ANGLES = np.arange(0.05, 90, 0.05)


def smith(theta: np.ndarray, k: float) -> np.ndarray:
    """S1 from the tail of a Gaussian of slopes, rms √2 σ/τ: Smith 1967; `theta` in degrees."""
    slope = math.sqrt(2) / k
    mu = 1 / np.tan(np.radians(theta))
    hidden = slope / mu * norm.pdf(mu / slope) - norm.sf(mu / slope)
    return norm.cdf(mu / slope) / (1 + hidden)


def exact_roughness(theta_i: np.ndarray, theta_o: np.ndarray, k: float) -> np.ndarray:
    """σ/σ0 of He et al. 1991 by bisection of √(π/2) z = ¼ (Ki + Kr) exp(−z²/2), z = z0/σ0; angles in degrees."""
    cot = [1 / np.tan(np.radians(theta)) for theta in (theta_i, theta_o)]
    hidden = sum(erfc(0.5 * k * c) / c for c in cot)
    low, high = np.zeros_like(hidden), np.full_like(hidden, 10.0)
    for _ in range(60):
        middle = (low + high) / 2
        above = math.sqrt(math.pi / 2) * middle > hidden / 4 * np.exp(-middle * middle / 2)
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return 1 / np.sqrt(1 + low * low)


def surface(k: float) -> DirectionalDiffuse:
    return DirectionalDiffuse(height_rms=0.5, correlation_length=0.5 * k)


def approximate_masking(theta: np.ndarray, k: float) -> np.ndarray:
    """S1 of eq. 6: light along the normal is not masked."""
    wo = spherical(torch.tensor(np.radians(theta)))
    return (4 * wo[:, 2] * surface(k).roughness(Directions(degrees(0), wo)).masking[:, 0]).numpy()


def approximate_roughness(theta_i: np.ndarray, theta_o: np.ndarray, k: float) -> np.ndarray:
    wi, wo = (spherical(torch.tensor(np.radians(theta))) for theta in (theta_i, theta_o))
    return surface(k).roughness(Directions(wi, wo)).effective[..., 0].numpy()


def test_reference_values_of_figures_8_and_9() -> None:
    """50 digits at 80°: S1 of eq. 6 and Smith's, σe of eq. 8 and He's."""
    angle = np.array([80.0])
    for found, expected in (
        (approximate_masking(angle, 5.0), 0.614676989),
        (smith(angle, 5.0), 0.581946653),
        (0.5 * approximate_roughness(angle, angle, 6.0), 0.405464894),
        (0.5 * exact_roughness(angle, angle, 6.0), 0.396847241),
    ):
        assert found[0] == pytest.approx(expected, rel=tolerances.NINE_DIGITS)


@pytest.mark.parametrize(
    ("k", "most", "angle", "least"),
    [
        (2.5, 0.0542, 71.0, -0.0075),
        (5.0, 0.0342, 82.1, -0.0073),
        (6.0, 0.0309, 83.9, -0.0088),
        (10.0, 0.0251, 87.0, -0.0153),
        (20.0, 0.0216, 88.7, -0.0240),
    ],
)
def test_masking_is_off_smiths_function_by_what_was_measured(k: float, most: float, angle: float, least: float) -> None:
    off = approximate_masking(ANGLES, k) - smith(ANGLES, k)
    assert (off.max(), off.min()) == pytest.approx((most, least), abs=tolerances.MEASURED_DEVIATION)
    assert ANGLES[off.argmax()] == pytest.approx(angle, abs=0.1)


@pytest.mark.parametrize(
    ("k", "limit", "least", "most"),
    [
        (5.0, 75, -0.0178, 0.0005),
        (6.0, 75, -0.0175, 0.0),
        (6.0, 80, -0.0186, 0.0217),
        (5.0, 85, -0.1245, 0.0319),
        (6.0, 85, -0.1274, 0.0242),
        (6.0, 89, -0.7462, 0.0242),
        (10.0, 85, -0.0816, 0.0141),
    ],
)
def test_effective_roughness_is_off_the_exact_function_by_what_was_measured(
    k: float, limit: float, least: float, most: float
) -> None:
    """Within 2 % up to 75°, within 13 % up to 85°, far too small beyond."""
    angles = np.arange(0.25, limit + 0.1, 0.25)
    theta_i, theta_o = np.meshgrid(angles, angles)
    off = approximate_roughness(theta_i, theta_o, k) / exact_roughness(theta_i, theta_o, k) - 1
    assert (off.min(), off.max()) == pytest.approx((least, most), abs=tolerances.MEASURED_DEVIATION)


@pytest.mark.parametrize(("law", "k"), [("printed", math.sqrt(62.5)), ("corrected", math.sqrt(40.0))])
def test_masking_between_the_axes_follows_the_law_of_the_azimuth(law: str, k: float) -> None:
    """σ 0.5, τ 2.5 and 5, azimuth 45°: 7.91 by eq. 25, 6.32 by the slope of eq. 20 along the azimuth."""
    brdf = DirectionalDiffuse(height_rms=0.5, correlation_length_x=2.5, correlation_length_y=5.0, anisotropy=law)
    wo = degrees(75, 45)
    found = 4 * wo[2] * brdf.roughness(Directions(degrees(0), wo)).masking
    assert found.item() == pytest.approx(1 - (1 - math.cos(math.radians(75))) ** k, rel=tolerances.INDEPENDENT)
