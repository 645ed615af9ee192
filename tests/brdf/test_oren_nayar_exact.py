"""Oren & Nayar 1994, eq. 5-13: the integral over V-cavities of every slope and orientation."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import torch
from torch import Tensor

from matest.brdf import Lambert, OrenNayar, OrenNayarExact, OrenNayarQualitative, OrenNayarSingleSlope
from tests import tolerances
from tests.brdf import cavity
from tests.sampling import BACKWARD, FORWARD, LIGHT, degrees, directional_albedo, gauss_legendre, random_pairs

NODES = ["16x16", "24x32", "48x64"]
# Largest and rms deviation from the converged integral that the model states, in units of the Lambert radiance.
STATED = {"16x16": (7e-3, 1e-3), "24x32": (3e-3, 4e-4), "48x64": (4e-4, 1e-4)}
CONVERGED = STATED["48x64"][0]
SIGMA = math.radians(30)
SIGMAS = torch.tensor([1, 2, 5, 10, 20, 30, 40, 50, 60, 70], dtype=torch.float64).deg2rad()

# Figure 5: 1000 L/E0 at θi = 75°, σ = 30°, ρ = 0.9, views at θr in the plane of incidence, those on the far side first.
FIGURE_5 = [-85, -75, -60, -45, -30, -15, 0, 15, 30, 45, 60, 70, 75, 80, 85]
DIRECT = [13.2, 16.8, 26.3, 35.7, 43.9, 51.0, 57.6, 64.2, 71.9, 82.4, 100.6, 125.9, 150.4, 152.6, 154.0]
TOTAL = [26.5, 32.0, 40.1, 47.4, 53.8, 59.4, 64.7, 70.1, 76.6, 85.9, 102.9, 127.5, 151.7, 153.7, 154.9]
EQ_16 = [31.2, 34.1, 39.3, 45.8, 52.4, 58.8, 65.0, 71.3, 78.2, 87.4, 103.6, 127.0, 150.2, 152.0, 153.1]
EQ_17 = [57.3, 57.3, 57.3, 57.3, 57.3, 57.3, 57.3, 63.8, 71.3, 81.6, 99.4, 124.0, 147.9, 149.6, 150.7]

# σ in degrees: largest deviation over θ up to 75° of eq. 14 from direct light, 15 from the second bounce, 16 from the
# total at ρ = 0.9, 17 from direct light and from the total.
LARGEST = {
    5: (0.051, 0.007, 0.058, 0.102, 0.094),
    10: (0.150, 0.013, 0.162, 0.314, 0.277),
    20: (0.160, 0.016, 0.161, 0.513, 0.388),
    30: (0.189, 0.059, 0.189, 0.547, 0.342),
    40: (0.188, 0.089, 0.188, 0.535, 0.313),
    50: (0.181, 0.103, 0.182, 0.513, 0.362),
}


def parts(wi: Tensor, wo: Tensor, sigma: Tensor | float, nodes: str = "48x64") -> tuple[Tensor, Tensor]:
    """Direct light and second bounce of white facets in units of the Lambert radiance, [..., C]."""
    direct, total = (OrenNayarExact(1.0, sigma, k, nodes=nodes)(wi, wo) * math.pi for k in (0.0, 1.0))
    return direct, total - direct


def grid(polar: list[int], azimuths: list[int]) -> tuple[Tensor, Tensor]:
    pairs = [at for at in itertools.product(polar, polar, azimuths) if at[0] >= at[1]]
    return torch.stack([degrees(a) for a, _, _ in pairs]), torch.stack([degrees(b, phi) for _, b, phi in pairs])


@pytest.fixture(scope="module")
def obliques() -> tuple[Tensor, Tensor]:
    return grid([0, 25, 50, 65, 80], [0, 30, 60, 90, 135, 180])


@pytest.fixture(scope="module")
def integral(obliques: tuple[Tensor, Tensor]) -> Tensor:
    """Both bounces by the printed equations on so many nodes that 2e-5 of Lambert remain: [pairs, sigmas, 2]."""
    weights = np.stack([cavity.slope_weights(sigma, 160) for sigma in SIGMAS.tolist()])
    views = zip(*(w.numpy() for w in obliques), strict=True)
    return torch.from_numpy(np.stack([weights @ cavity.images(wi, wo, 160, 1000).T for wi, wo in views]))


@pytest.mark.parametrize("nodes", NODES)
def test_deviation_from_the_converged_integral_is_as_stated(
    obliques: tuple[Tensor, Tensor], integral: Tensor, nodes: str
) -> None:
    direct, second = parts(*obliques, SIGMAS, nodes)
    largest, rms = STATED[nodes]
    for deviation in (direct - integral[..., 0], second - integral[..., 1], direct + second - integral.sum(-1)):
        assert deviation.abs().max() <= largest
        assert deviation.square().mean().sqrt() <= rms


def test_stated_deviations_stand_in_the_description() -> None:
    described = OrenNayarExact.__doc__ or ""
    for nodes, (largest, rms) in STATED.items():
        line = f"`{nodes}`{' (default)' if nodes == OrenNayarExact().nodes else ''} {largest:.0e} and {rms:.0e}"
        assert line.replace("e-0", "e-") in " ".join(described.split())


def test_deviation_falls_as_nodes_are_added(obliques: tuple[Tensor, Tensor], integral: Tensor) -> None:
    deviations = [torch.stack(parts(*obliques, SIGMAS, nodes), dim=-1) - integral for nodes in NODES]
    for coarse, fine in itertools.pairwise(deviations):
        assert (fine.square().mean((0, 1)) < coarse.square().mean((0, 1)) / 4).all()
        assert (fine.abs().amax((0, 1)) < coarse.abs().amax((0, 1)) / 2).all()


@pytest.mark.parametrize("nodes", NODES)
@pytest.mark.parametrize(
    ("view", "once", "twice"),
    [
        (FORWARD, 0.14845195821068638, 0.04880789111856616),
        (BACKWARD, 0.3021334423372823, 0.018507967872779495),
    ],
    ids=["forward", "backward"],
)
def test_reference_values(view: Tensor, once: float, twice: float, nodes: str) -> None:
    direct, both = (OrenNayarExact(0.9, SIGMA, k, nodes=nodes)(LIGHT, view).item() for k in (0.0, 1.0))
    unit = 0.9 / math.pi
    assert direct == pytest.approx(once, abs=STATED[nodes][0] * unit)
    assert both - direct == pytest.approx(twice, abs=STATED[nodes][0] * unit * 0.9)


@pytest.mark.parametrize(
    ("theta_i", "theta_o", "azimuth", "sigma"),
    [(0, 50, 0, 30), (60, 60, 180, 30), (60, 50, 0, 40), (75, 40, 90, 20), (65, 70, 180, 25), (75, 75, 20, 30)],
)
def test_traced_rays(theta_i: float, theta_o: float, azimuth: float, sigma: float) -> None:
    light, view, width = degrees(theta_i), degrees(theta_o, azimuth), math.radians(sigma)
    traced = cavity.traced_surface(light.numpy(), view.numpy(), width, power=16)
    for part, (mean, error) in zip(parts(light, view, width), traced, strict=True):
        assert error <= cavity.STANDARD_ERROR * mean
        assert abs(mean - part.item()) <= 3 * error + CONVERGED


@pytest.mark.parametrize("nodes", NODES)
def test_vanishing_sigma_is_lambert(nodes: str) -> None:
    pairs = random_pairs(200, seed=1, most=math.radians(80))
    flat = OrenNayarExact(0.8, 0.0, nodes=nodes)(*pairs)
    # σ counts as 1e-3 at least: a mean slope of 1e-3 between directions of tangent 6 each.
    torch.testing.assert_close(flat, Lambert(0.8)(*pairs), rtol=1e-4, atol=0)


def test_departure_from_lambert_is_of_second_order() -> None:
    pairs = random_pairs(200, seed=2, most=1.0)
    once, twice = (OrenNayarExact(1.0, sigma, nodes="48x64")(*pairs) * math.pi - 1 for sigma in (0.01, 0.02))
    assert once.abs().max() > 1e-4
    torch.testing.assert_close(twice, 4 * once, rtol=0, atol=2e-5)  # next order: σ⁴ times tangents up to 1.6


@pytest.mark.parametrize("interreflection", [0.0, 1.0])
def test_surface_is_the_weighted_mean_of_single_slopes(interreflection: float) -> None:
    pairs = random_pairs(60, seed=3, most=math.radians(80))
    sigma = math.radians(25)
    t, weight = gauss_legendre(64, math.radians(89))
    area = weight * t.sin() * (-0.5 * (t / sigma).square()).exp()
    slopes = OrenNayarSingleSlope(0.9, t, interreflection=interreflection, isotropic="true")(*pairs)
    mean = (slopes * area).sum(-1, keepdim=True) / area.sum()
    exact = OrenNayarExact(0.9, sigma, interreflection, nodes="48x64")(*pairs)
    torch.testing.assert_close(exact, mean, rtol=0, atol=CONVERGED * 0.9 / math.pi)


def radiance(brdf: OrenNayarExact | OrenNayar | OrenNayarQualitative) -> list[float]:
    views = torch.stack([degrees(abs(theta), 180 if theta < 0 else 0) for theta in FIGURE_5])
    return (1000 * math.cos(math.radians(75)) * brdf(degrees(75), views))[:, 0].tolist()


def test_figure_5_by_the_integral() -> None:
    direct, total = (radiance(OrenNayarExact(0.9, SIGMA, k, nodes="48x64")) for k in (0.0, 1.0))
    assert direct == pytest.approx(DIRECT, abs=tolerances.ONE_DECIMAL)
    assert total == pytest.approx(TOTAL, abs=tolerances.ONE_DECIMAL)


def test_figure_5_by_the_fits() -> None:
    assert radiance(OrenNayar(0.9, SIGMA)) == pytest.approx(EQ_16, abs=tolerances.ONE_DECIMAL)
    assert radiance(OrenNayarQualitative(0.9, SIGMA)) == pytest.approx(EQ_17, abs=tolerances.ONE_DECIMAL)


@pytest.mark.parametrize("nodes", NODES)
@pytest.mark.parametrize("theta_i", [40, 75])
def test_direct_light_in_plane_on_the_near_side_is_linear_in_the_tangent_of_the_view(theta_i: int, nodes: str) -> None:
    """Up to the direction of the light: groove by groove, so at any number of nodes."""
    brdf = OrenNayarExact(1.0, SIGMA, 0.0, nodes=nodes)
    theta = torch.linspace(0, math.radians(theta_i), 12, dtype=torch.float64)
    views = torch.stack([theta.sin(), torch.zeros_like(theta), theta.cos()], dim=-1)
    values, tangent = brdf(degrees(theta_i), views)[:, 0], theta.tan()
    slope = (values[-1] - values[0]) / tangent[-1]
    torch.testing.assert_close(values, values[0] + slope * tangent, rtol=tolerances.IN_PLANE, atol=0)


def test_direct_light_hardly_grows_beyond_the_direction_of_the_light() -> None:
    brdf = OrenNayarExact(1.0, SIGMA, 0.0, nodes="48x64")
    values = [brdf(degrees(75), degrees(theta)).item() for theta in (65, 75, 85)]
    assert values[1] > 1.2 * values[0]
    assert values[1] < values[2] < 1.05 * values[1]


def test_largest_deviations_of_the_fits() -> None:
    pairs = grid([0, 10, 20, 30, 40, 50, 60, 70, 75], [0, 45, 90, 135, 180])
    sigma = torch.tensor([*LARGEST], dtype=torch.float64).deg2rad()
    once, twice = parts(*pairs, sigma)
    eq_14, eq_16 = (OrenNayar(1.0, sigma, k)(*pairs) * math.pi for k in (0.0, 1.0))
    eq_15, eq_17 = eq_16 - eq_14, OrenNayarQualitative(1.0, sigma)(*pairs) * math.pi
    total = once + 0.9 * twice
    deviations = [eq_14 - once, eq_15 - twice, eq_14 + 0.9 * eq_15 - total, eq_17 - once, eq_17 - total]
    measured = torch.stack([deviation.abs().amax(0) for deviation in deviations], dim=-1)
    expected = torch.tensor([*LARGEST.values()], dtype=torch.float64)
    torch.testing.assert_close(measured, expected, rtol=0, atol=tolerances.THREE_DECIMALS + CONVERGED)


@pytest.mark.parametrize(
    ("sigma", "least", "most"), [(10, 0.9979, 0.9992), (20, 0.973, 0.989), (30, 0.903, 0.961), (45, 0.798, 0.920)]
)
def test_white_facets_lose_the_third_bounce(sigma: float, least: float, most: float) -> None:
    brdf = OrenNayarExact(1.0, math.radians(sigma), nodes="16x16")
    albedos = [directional_albedo(brdf, math.radians(theta), nodes=40).item() for theta in (0, 60, 85)]
    assert albedos == sorted(albedos)
    assert albedos[0] == pytest.approx(least, abs=tolerances.THREE_DECIMALS)
    assert albedos[-1] < most < 1


def test_second_bounce_grows_with_the_square_of_albedo() -> None:
    pairs = random_pairs(100, seed=4)
    bounce = [OrenNayarExact(rho, 0.4)(*pairs) - OrenNayarExact(rho, 0.4, 0.0)(*pairs) for rho in (0.4, 0.8)]
    torch.testing.assert_close(bounce[1], 4 * bounce[0], rtol=1e-9, atol=1e-14)  # a difference of nearby values
