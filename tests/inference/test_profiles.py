"""Intervals at and near a bound: against the normal distribution and repeated experiments."""

from __future__ import annotations

import math

import pytest
from scipy.stats import norm

from matest.brdf import Brdf, CookTorrance, OrenNayar
from matest.inference.profiles import lower_threshold, threshold, upper_threshold
from tests.inference.judged import judged
from tests.simulated import Studio

STUDIO = Studio(size=24, lights=Studio().lights[:2])
CAPTURES = 20


def covers(truth: float, estimate: float) -> bool:
    """Whether the interval for a normal estimate of standard error 1, cut at 0, holds the truth."""
    if estimate < 0:
        return truth**2 - 2 * estimate * truth <= upper_threshold(-estimate)
    if truth > estimate:
        return (truth - estimate) ** 2 <= upper_threshold(0.0)
    return (truth - estimate) ** 2 <= lower_threshold(estimate)


@pytest.mark.parametrize("truth", [0.05, 0.5, 1.0, 1.5, 2.5, 4.0])
def test_intervals_hold_a_truth_near_the_bound_nineteen_times_in_twenty(truth: float) -> None:
    count = 200
    drawn = norm.ppf([(k + 0.5) / count for k in range(count)]) + truth
    assert sum(covers(truth, float(x)) for x in drawn) / count == pytest.approx(0.95, abs=2.5 / count)


def test_thresholds_are_one_sided_at_a_bound_and_two_sided_away_from_it() -> None:
    assert threshold(0.0) == pytest.approx(norm.ppf(0.95) ** 2)
    assert threshold(2.0) == pytest.approx(norm.ppf(0.975) ** 2)
    assert upper_threshold(0.0) == pytest.approx(norm.ppf(0.975) ** 2)


def covered(material: Brdf, expression: str, name: str, fix: dict[str, float]) -> int:
    clean = STUDIO.clean(material)
    truth = float(material.parameters[name])
    held = 0
    for seed in range(CAPTURES):
        low, high = judged(STUDIO.expose(clean, seed), expression, fix=fix).posterior.estimates[name].interval95
        held += low <= truth <= high
    return held


# Intervals of 95 % hold the truth fewer times only by a chance of three standard deviations.
FEWEST = math.floor(CAPTURES * 0.95 - 3 * math.sqrt(CAPTURES * 0.95 * 0.05))


@pytest.mark.parametrize("degrees", [0.0, 2.0])
def test_intervals_of_a_nearly_smooth_surface_hold_its_sigma(degrees: float) -> None:
    assert covered(OrenNayar(0.6, math.radians(degrees)), "oren-nayar", "sigma", {}) >= FEWEST


@pytest.mark.parametrize("specular", [0.0, 0.01])
def test_intervals_of_a_faint_highlight_hold_its_strength(specular: float) -> None:
    material = CookTorrance(0.4, specular, 0.3)
    assert covered(material, "cook-torrance", "specular", {"slope": 0.3, "f0": 0.04}) >= FEWEST


@pytest.mark.parametrize(("lights", "seed"), [(3, 2), (3, 6), (3, 7), (6, 6)])
def test_intervals_along_a_bent_valley_hold_the_truth(lights: int, seed: int) -> None:
    # n and k of a metal lie on a curve of equal reflectance: errors to first order miss the truth, by hundreds of them.
    truth = {"eta": 1.5, "k": 3.0}
    material = CookTorrance(0.0, 1.0, 0.2, **truth, fresnel="conductor")
    capture = Studio(size=32, lights=Studio().lights[:lights]).photograph(material, seed)
    found = judged(capture, material.expression, fix={"diffuse": 0.0, "specular": 1.0}).posterior.estimates
    for name, value in truth.items():
        if found[name].status != "not determined":
            low, high = found[name].interval95
            assert low <= value <= high
    assert found["slope"].std < 0.01
