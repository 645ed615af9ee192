"""Oren & Nayar 1994, §3.1 and §3.2: V-cavities of one slope."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from mpmath import mpf, pi
from torch import Tensor

from matest.brdf import Lambert, OrenNayarSingleSlope
from matest.errors import InputError
from tests import tolerances
from tests.brdf import cavity
from tests.exact import Geometry, deviation_from_print
from tests.sampling import BACKWARD, FORWARD, LIGHT, degrees, random_pairs

SLOPE, ACROSS = math.radians(35), math.radians(10)


def printed(g: Geometry, albedo: float, t: float, psi: float, interreflection: float) -> mpf:
    sides = [mpf(psi), mpf(psi) + pi]
    once = sum(cavity.printed_direct(g, mpf(t), side) for side in sides) / 2
    twice = sum(cavity.printed_second(g, mpf(t), side) for side in sides) / 2
    return mpf(albedo) / pi * once + mpf(interreflection) * mpf(albedo) ** 2 / pi * twice


def turned(vectors: Tensor, angle: float) -> Tensor:
    """Turned about the normal, from the tangent toward the bitangent."""
    x, y, z = vectors.unbind(-1)
    cos, sin = math.cos(angle), math.sin(angle)
    return torch.stack([cos * x - sin * y, sin * x + cos * y, z], dim=-1)


def test_reference_values_of_parallel_grooves() -> None:
    brdf = OrenNayarSingleSlope(0.9, SLOPE, ACROSS)
    assert brdf(LIGHT, FORWARD).item() == pytest.approx(0.102484844, rel=tolerances.NINE_DIGITS)
    assert brdf(LIGHT, BACKWARD).item() == pytest.approx(0.428710029, rel=tolerances.NINE_DIGITS)


def test_reference_values_of_grooves_of_every_orientation() -> None:
    brdf = OrenNayarSingleSlope(0.9, SLOPE, isotropic="true")
    for view, expected in ((FORWARD, 0.186129011), (BACKWARD, 0.345568649)):
        assert brdf(LIGHT, view).item() == pytest.approx(expected, abs=tolerances.ORIENTATIONS * 0.9 / math.pi)


@pytest.mark.parametrize(
    ("albedo", "t", "psi", "interreflection"),
    [(0.9, SLOPE, ACROSS, 1.0), (1.0, 0.02, 1.0, 1.0), (0.6, 1.2, 3.0, 0.4), (0.7, 0.6, 2.0, 0.0)],
)
def test_printed_equations_in_fifty_digits(albedo: float, t: float, psi: float, interreflection: float) -> None:
    brdf = OrenNayarSingleSlope(albedo, t, psi, interreflection)
    deviation = deviation_from_print(brdf, lambda g: printed(g, albedo, t, psi, interreflection), seed=1)
    assert deviation < tolerances.INDEPENDENT


@pytest.mark.parametrize("isotropic", ["false", "true"])
def test_flat_facets_are_lambert(isotropic: str) -> None:
    pairs = random_pairs(200, seed=2)
    flat = OrenNayarSingleSlope(0.8, 0.0, isotropic=isotropic)(*pairs)
    torch.testing.assert_close(flat, Lambert(0.8)(*pairs), rtol=tolerances.INDEPENDENT, atol=0)


def test_half_a_turn_is_the_same_surface() -> None:
    wi, wo = random_pairs(200, seed=3)
    brdf = OrenNayarSingleSlope(0.8, 0.6, 0.7)
    torch.testing.assert_close(brdf(turned(wi, math.pi), turned(wo, math.pi)), brdf(wi, wo))
    ends = [OrenNayarSingleSlope(0.8, 0.6, end)(wi, wo) for end in (0.0, math.pi)]
    torch.testing.assert_close(*ends)


def test_a_quarter_turn_is_another_surface() -> None:
    wi, wo = degrees(60, 0), degrees(50, 180)
    across, along = (OrenNayarSingleSlope(0.8, 0.6, psi)(wi, wo) for psi in (0.0, math.pi / 2))
    assert along > 1.5 * across


def test_azimuth_turns_the_grooves_from_the_tangent_toward_the_bitangent() -> None:
    wi, wo = random_pairs(200, seed=4)
    torch.testing.assert_close(
        OrenNayarSingleSlope(0.8, 0.6, 0.9)(turned(wi, 0.5), turned(wo, 0.5)),
        OrenNayarSingleSlope(0.8, 0.6, 0.4)(wi, wo),
    )


def test_grooves_along_the_plane_of_incidence_shadow_nothing() -> None:
    """Both facets are lit at cos θi cos t and seen at cos θr cos t, at any obliquity."""
    t, views = 0.7, torch.stack([degrees(theta, phi) for theta in (10, 60, 85) for phi in (90, 270)])
    values = OrenNayarSingleSlope(1.0, t, 0.0, interreflection=0.0)(degrees(80, 90), views)
    torch.testing.assert_close(values, torch.full_like(values, math.cos(t) / math.pi))


@pytest.mark.parametrize("interreflection", [0.0, 1.0])
@pytest.mark.parametrize("t", [0.1, SLOPE, 0.9])
def test_every_orientation_is_the_mean_over_azimuth(t: float, interreflection: float) -> None:
    """To the deviation of 64 midpoints up to 80 degrees from the normal."""
    wi, wo = random_pairs(60, seed=5, most=math.radians(80))
    psi = (torch.arange(3000, dtype=torch.float64) + 0.5) * (math.pi / 3000)
    parallel = OrenNayarSingleSlope(1.0, t, psi, interreflection)(wi, wo).mean(-1, keepdim=True)
    every = OrenNayarSingleSlope(1.0, t, interreflection=interreflection, isotropic="true")(wi, wo)
    torch.testing.assert_close(every, parallel, rtol=0, atol=tolerances.ORIENTATIONS / math.pi)


def test_every_orientation_is_the_mean_over_midpoints_about_the_middle_azimuth() -> None:
    light, view = degrees(75, 10), degrees(60, 70)
    psi = math.radians(40) + (torch.arange(64, dtype=torch.float64) + 0.5) * (math.pi / 64)
    parallel = OrenNayarSingleSlope(0.9, 0.6, psi)(light, view).mean().item()
    every = OrenNayarSingleSlope(0.9, 0.6, isotropic="true")(light, view).item()
    assert every == pytest.approx(parallel, rel=tolerances.INDEPENDENT)


def test_only_parallel_grooves_have_an_azimuth() -> None:
    parallel, every = OrenNayarSingleSlope(0.5), OrenNayarSingleSlope(0.5, isotropic="true")
    assert [*parallel.declared] == ["albedo", "facet_angle", "azimuth", "interreflection"]
    assert [*every.declared] == ["albedo", "facet_angle", "interreflection"]
    assert parallel.structure.anisotropic
    assert not every.structure.anisotropic
    with pytest.raises(InputError, match="no parameter azimuth with these options; it needs isotropic=false"):
        every.replace({"azimuth": 0.1})


@pytest.mark.parametrize(
    ("theta_i", "theta_o", "azimuth", "t", "psi"),
    [(50, 60, 20, 35, 10), (60, 65, 180, 25, 0), (65, 30, 180, 40, 160), (30, 70, 100, 30, 60)],
)
def test_traced_rays_in_parallel_grooves(theta_i: float, theta_o: float, azimuth: float, t: float, psi: float) -> None:
    light, view = degrees(theta_i), degrees(theta_o, azimuth)
    slope, across = math.radians(t), math.radians(psi)
    traced = cavity.trace_batches(
        lambda uniform: cavity.trace(uniform[2:], light.numpy(), view.numpy(), slope, across), power=13
    )
    once, both = (OrenNayarSingleSlope(1.0, slope, across, k)(light, view).item() * math.pi for k in (0.0, 1.0))
    for expected, (mean, error) in zip((once, both - once), traced, strict=True):
        assert error <= cavity.STANDARD_ERROR * mean
        assert abs(mean - expected) <= 3 * error + tolerances.INDEPENDENT


def test_mean_over_orientations_is_that_of_the_printed_equations() -> None:
    light, view = degrees(60, 10), degrees(45, 130)
    psi = (np.arange(20000) + 0.5) * (2 * math.pi / 20000)
    once, twice = (part.mean() for part in cavity.bounces(light.numpy(), view.numpy(), np.array(SLOPE), psi))
    every = OrenNayarSingleSlope(1.0, SLOPE, isotropic="true")(light, view).item() * math.pi
    assert every == pytest.approx(once + twice, abs=tolerances.ORIENTATIONS)
