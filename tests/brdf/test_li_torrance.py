"""Li & Torrance 2005."""

from __future__ import annotations

import math

import mpmath
import pytest
import torch
from mpmath import mpf, pi

from matest.brdf import (
    Brdf,
    Coherent,
    CookTorrance,
    DirectionalDiffuse,
    FirstSurfaceDiffuse,
    ForwardScattering,
    LiTorrance,
    SubsurfaceDiffuse,
    preset,
)
from tests import tolerances
from tests.exact import Geometry, deviation_from_print
from tests.sampling import BACKWARD, FORWARD, LIGHT, degrees, directional_albedo, random_pairs

F15 = ((1.5 - 1) / (1.5 + 1)) ** 2
CLOSE = {"rtol": tolerances.INDEPENDENT, "atol": tolerances.UNDERFLOW}


def schlick(f0: float, cos: mpf) -> mpf:
    return mpf(f0) + (1 - mpf(f0)) * (1 - cos) ** 5


def masking(g: Geometry, k: mpf) -> mpf:
    """Eq. 6."""
    return (1 - (1 - g.cos_i) ** k) * (1 - (1 - g.cos_o) ** k)


def effective(g: Geometry, k: mpf) -> mpf:
    """σe/σ, eq. 8."""
    return masking(g, mpf("1.6") * k) ** (k / 10)


def printed_directional(g: Geometry, f0: float, height: float, length: float) -> mpf:
    """Eq. 9 and 10 with unit vectors."""
    k = mpf(length) / mpf(height)
    me = effective(g, k) / k
    v = g.light + g.view
    ratio = ((v.T * v)[0] / v[2]) ** 2
    d = ratio * mpmath.exp(-(mpmath.tan(g.alpha) ** 2) / (4 * me**2)) / (16 * me**2 * (g.cos_i + g.cos_o) ** 2)
    return schlick(f0, g.cos_difference) * masking(g, k) * d / (pi * g.cos_i * g.cos_o)


def printed_forward(g: Geometry, f0: float, height: float, length: float) -> mpf:
    """Eq. 13 and 14, forward only."""
    k = mpf(length) / mpf(height)
    me = effective(g, k) / k
    tangent = -g.light
    tangent[2] = mpf(0)
    cos = (g.view.T * (tangent / mpmath.norm(tangent)))[0]
    if cos <= 0:
        return mpf(0)
    transmitted = (1 - schlick(f0, g.cos_i)) * (1 - schlick(f0, g.cos_o))
    lobe = mpmath.exp(-(mpmath.tan(mpmath.acos(cos)) ** 2) / (16 * me**2))
    return transmitted * (1 - g.cos_i) * (1 - g.cos_o) * lobe / pi


@pytest.mark.parametrize(
    ("brdf", "forward", "backward"),
    [
        (DirectionalDiffuse(k_dd=0.44, f0=0.92, height_rms=0.86, correlation_length=4.99), 0.288942694, 9.31909083e-8),
        (
            DirectionalDiffuse(
                k_dd=1.0, f0=0.92, height_rms=0.5, correlation_length_x=2.5, correlation_length_y=5.0,
                anisotropy="printed",
            ),
            0.0755424127, 5.54916104e-13,
        ),
        (ForwardScattering(k_fs=2.0, f0=F15, height_rms=0.5, correlation_length=2.5), 0.0419895703, 0.0),
        (SubsurfaceDiffuse(k_uds=0.94, f0=F15), 0.256557837, 0.256557837),
    ],
)  # fmt: skip
def test_reference_values(brdf: Brdf, forward: float, backward: float) -> None:
    assert brdf(LIGHT, FORWARD).item() == pytest.approx(forward, rel=tolerances.NINE_DIGITS)
    assert brdf(LIGHT, BACKWARD).item() == pytest.approx(backward, rel=tolerances.NINE_DIGITS)


# σ/τ of samples #41, #13, #73 and of figure 8.
ROUGHNESS = [(0.86, 4.99), (0.7, 8.2), (0.39, 5.4), (0.5, 2.5)]


@pytest.mark.parametrize(("height", "length"), ROUGHNESS)
def test_printed_directional_component_in_fifty_digits(height: float, length: float) -> None:
    brdf = DirectionalDiffuse(k_dd=1.0, f0=0.3, height_rms=height, correlation_length=length)
    # Near grazing the exponent of the lobe reaches hundreds.
    found = deviation_from_print(brdf, lambda g: printed_directional(g, 0.3, height, length), seed=1)
    assert found < 100 * tolerances.INDEPENDENT


@pytest.mark.parametrize(("height", "length"), ROUGHNESS)
def test_printed_forward_scattering_in_fifty_digits(height: float, length: float) -> None:
    brdf = ForwardScattering(k_fs=1.0, f0=0.05, height_rms=height, correlation_length=length)
    found = deviation_from_print(brdf, lambda g: printed_forward(g, 0.05, height, length), seed=2)
    assert found < 100 * tolerances.INDEPENDENT


def test_printed_subsurface_component_in_fifty_digits() -> None:
    def printed(g: Geometry) -> mpf:
        return mpf("0.7") * (1 - schlick(0.05, g.cos_i)) * (1 - schlick(0.05, g.cos_o)) / pi

    assert deviation_from_print(SubsurfaceDiffuse(k_uds=0.7, f0=0.05), printed, seed=3) < tolerances.INDEPENDENT


def test_the_lobe_without_masking_is_a_normalised_beckmann_lobe_of_slope_two_sigma_over_tau() -> None:
    pairs = random_pairs(300, seed=4, most=1.4)
    found = DirectionalDiffuse(k_dd=1.0, f0=0.2, height_rms=0.5, correlation_length=5.0, masking="off")(*pairs)
    lobe = CookTorrance(0.0, 1.0, 0.2, 0.2, fresnel="schlick")
    # That one has the masking of V-cavities: compare where it is 1.
    g = 2 * (pairs[0] + pairs[1])[:, 2:].square() / (pairs[0] + pairs[1]).square().sum(-1, keepdim=True)
    whole = (g * torch.minimum(pairs[0], pairs[1])[:, 2:] / (pairs[0] + pairs[1])[:, 2:] * 2 > 1)[:, 0]
    assert whole.sum() > 50
    torch.testing.assert_close(found[whole], lobe(*pairs)[whole], rtol=1e-11, atol=tolerances.UNDERFLOW)


@pytest.mark.parametrize("law", ["printed", "corrected"])
@pytest.mark.parametrize("kind", [DirectionalDiffuse, ForwardScattering])
def test_equal_lengths_are_isotropic(law: str, kind: type[Brdf]) -> None:
    pairs = random_pairs(300, seed=5)
    across = kind(height_rms=0.5, correlation_length_x=4.0, correlation_length_y=4.0, anisotropy=law)
    along = kind(height_rms=0.5, correlation_length=4.0)
    torch.testing.assert_close(across(*pairs), along(*pairs), rtol=1e-11, atol=tolerances.UNDERFLOW)


def test_only_the_ratio_of_the_lengths_matters_to_diffuse_light() -> None:
    pairs = random_pairs(300, seed=6)
    one, two = (
        LiTorrance(height_rms=h, correlation_length=length, forward="on") for h, length in ((0.5, 4.0), (1.0, 8.0))
    )
    torch.testing.assert_close(one(*pairs), two(*pairs), **CLOSE)


def test_the_model_is_the_sum_of_its_components() -> None:
    pairs = random_pairs(300, seed=7)
    rough = {"f0": 0.1, "height_rms": 0.4, "correlation_length": 5.0}
    light = {"wavelength": 0.6, "solid_angle": 0.05}
    whole = LiTorrance(
        k_dd=0.3, k_udf=0.2, k_uds=0.4, k_fs=1.5, **rough, **light, uniform="on", forward="on", coherent="on"
    )
    parts = [
        DirectionalDiffuse(k_dd=0.3, **rough), FirstSurfaceDiffuse(k_udf=0.2), SubsurfaceDiffuse(k_uds=0.4, f0=0.1),
        ForwardScattering(k_fs=1.5, **rough), Coherent(k_dd=0.3, **rough, **light),
    ]  # fmt: skip
    torch.testing.assert_close(whole(*pairs), sum(part(*pairs) for part in parts), **CLOSE)


def test_coherent_light_integrates_to_its_mirror_reflectance() -> None:
    brdf = Coherent(k_dd=1.0, f0=1.0, height_rms=0.02, correlation_length=20.0, wavelength=0.5, solid_angle=0.02)
    g = (4 * math.pi * 0.02 / 0.5 * math.cos(0.3)) ** 2
    assert directional_albedo(brdf, 0.3, nodes=200).item() == pytest.approx(math.exp(-g), rel=2e-3)


def test_the_energy_option_keeps_coherent_and_diffuse_light_together_below_one() -> None:
    smooth = {"k_dd": 1.0, "f0": 1.0, "height_rms": 0.05, "correlation_length": 2.0, "solid_angle": 0.05}
    options = {"coherent": "on", "subsurface": "off"}
    paper, he = (
        directional_albedo(LiTorrance(**smooth, **options, energy=energy), 0.0, nodes=128).item()
        for energy in ("paper", "he")
    )
    assert paper > 1.2
    assert he == pytest.approx(1.0, abs=5e-3)


def test_reference_albedo_of_coherent_light_from_sample_45() -> None:
    """The mirror reflectance k F S e^(−g) at 75°, off the table: 0.1475."""
    for masked, expected in (("off", 0.147490192), ("on", 0.147489455)):
        brdf = Coherent(
            k_dd=1.0, f0=0.92, height_rms=0.23, correlation_length=9.9, wavelength=0.55, solid_angle=1e-3,
            masking=masked,
        )  # fmt: skip
        wi, wo = degrees(75), degrees(75, 180)
        # f · cos θi / K at the mirror direction, K = 1/solid angle there.
        assert brdf(wi, wo).item() * wi[2].item() * 1e-3 == pytest.approx(expected, rel=1e-8)


def test_forward_scattering_by_the_reciprocal_law_is_the_same_both_ways() -> None:
    brdf = ForwardScattering(law="reciprocal", height_rms=0.39, correlation_length=5.4)
    wi, wo = random_pairs(300, seed=8)
    torch.testing.assert_close(brdf(wi, wo), brdf(wo, wi), **CLOSE)
    printed = ForwardScattering(height_rms=0.39, correlation_length=5.4, f0=F15)
    there, back = printed(degrees(75), degrees(60, 180)), printed(degrees(60), degrees(75, 180))
    assert max(there / back, back / there).item() == pytest.approx(23, rel=0.05)


@pytest.mark.parametrize(
    ("name", "channel", "albedo"),
    [
        ("ground-glass", 1, (0.74, 0.69, 0.65, 0.54)),
        ("red-paint", 0, (0.12, 0.14, 0.18, 0.20)),
        ("laser-paper", 1, (0.84, 0.82, 0.69, 0.38)),
    ],
)
def test_albedo_of_the_measured_samples(name: str, channel: int, albedo: tuple[float, ...]) -> None:
    brdf = preset(name)
    found = [directional_albedo(brdf, math.radians(angle))[channel].item() for angle in (0, 60, 75, 85)]
    assert found == pytest.approx(albedo, abs=tolerances.TWO_DECIMALS)
