"""Cook & Torrance 1982."""

from __future__ import annotations

import itertools
import math
from typing import Any

import mpmath
import pytest
import torch
from mpmath import mpf, pi

from matest.brdf import CookTorrance, Lambert, model
from matest.errors import InputError
from tests import tolerances
from tests.brdf import microsurface
from tests.exact import Geometry, deviation_from_print
from tests.sampling import BACKWARD, FORWARD, LIGHT, degrees, directional_albedo, random_pairs

# Copper, as two lobes.
COPPER = {"eta": 0.958, "k": 2.577}
VASE = {"diffuse": 0.0, "slope": 0.4, "slope_2": 0.2, "weight_2": 0.6}
# Distributions with the maskings that they have.
MASKED = [
    (distribution, masking)
    for distribution, masking in itertools.product(("beckmann", "gaussian", "ggx"), ("v-cavity", "smith"))
    if (distribution, masking) != ("gaussian", "smith")
]
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


def lobe(g: Geometry, distribution: str, slope: float) -> mpf:
    """D G / (4 ci cr) with V-cavities."""
    return getattr(microsurface, distribution)(g, mpf(slope)) * g.v_cavity / (4 * g.cos_i * g.cos_o)


def test_reference_values_of_a_gaussian() -> None:
    brdf = CookTorrance(0.0, 1.0, 0.3, 1.0, distribution="gaussian", fresnel="schlick")
    assert brdf(LIGHT, FORWARD).item() == pytest.approx(0.57122559, rel=tolerances.NINE_DIGITS)
    assert brdf(LIGHT, BACKWARD).item() == pytest.approx(4.43979873e-5, rel=tolerances.NINE_DIGITS)


def test_reference_values_of_copper_with_two_lobes() -> None:
    brdf = CookTorrance(**VASE, **COPPER, lobes="2", fresnel="conductor")
    assert brdf(LIGHT, FORWARD).item() == pytest.approx(0.250348297, rel=tolerances.NINE_DIGITS)
    assert brdf(LIGHT, BACKWARD).item() == pytest.approx(2.87353062e-6, rel=tolerances.NINE_DIGITS)


@pytest.mark.parametrize("distribution", ["beckmann", "gaussian", "ggx"])
@pytest.mark.parametrize("slope", [0.1, 0.35, 1.0])
def test_printed_lobe_of_every_distribution_in_fifty_digits(distribution: str, slope: float) -> None:
    brdf = CookTorrance(0.0, 0.7, slope, 0.3, distribution=distribution, fresnel="schlick")

    def printed(g: Geometry) -> mpf:
        return mpf(0.7) * microsurface.schlick(g.cos_difference, 0.3) * lobe(g, distribution, slope)

    assert deviation_from_print(brdf, printed, seed=5) < tolerances.INDEPENDENT


@pytest.mark.parametrize("slope", [0.2, 0.8])
def test_printed_lobe_of_ggx_with_smiths_masking_in_fifty_digits(slope: float) -> None:
    brdf = CookTorrance(0.0, 1.0, slope, 0.3, distribution="ggx", masking="smith", fresnel="schlick")
    m = mpf(slope)

    def printed(g: Geometry) -> mpf:
        masking = [2 / (1 + mpmath.sqrt(1 + (m * mpmath.tan(theta)) ** 2)) for theta in (g.theta_i, g.theta_o)]
        reflectance = microsurface.schlick(g.cos_difference, 0.3)
        return reflectance * microsurface.ggx(g, m) * masking[0] * masking[1] / (4 * g.cos_i * g.cos_o)

    assert deviation_from_print(brdf, printed, seed=6) < tolerances.INDEPENDENT


@pytest.mark.parametrize(("eta", "k"), [(0.958, 2.577), (0.2, 3.5), (3.0, 0.0), (1.5, 0.01)])
def test_printed_conductor_in_fifty_digits(eta: float, k: float) -> None:
    brdf = CookTorrance(0.0, 1.0, 0.4, eta=eta, k=k, fresnel="conductor")

    def printed(g: Geometry) -> mpf:
        return microsurface.conductor(g.cos_difference, eta, k) * lobe(g, "beckmann", 0.4)

    assert deviation_from_print(brdf, printed, seed=7) < tolerances.INDEPENDENT


@pytest.mark.parametrize(("f0", "f0_mean"), [(0.9, 0.6), (0.5, 0.04)])
def test_printed_colour_shift_in_fifty_digits(f0: float, f0_mean: float) -> None:
    brdf = CookTorrance(0.0, 1.0, 0.4, f0, f0_mean=f0_mean, fresnel="colour-shift")

    def printed(g: Geometry) -> mpf:
        return microsurface.colour_shift(g.cos_difference, f0, f0_mean) * lobe(g, "beckmann", 0.4)

    assert deviation_from_print(brdf, printed, seed=8) < tolerances.INDEPENDENT


def test_printed_three_lobes_in_fifty_digits() -> None:
    """D = Σ wj D(mj) with weights 0.3, 0.7 · 0.6 and 0.7 · 0.4."""
    slopes, shares = (0.5, 0.4, 0.3), (1 - mpf(0.7), mpf(0.7) * (1 - mpf(0.4)), mpf(0.7) * mpf(0.4))
    named = dict(zip(("slope", "slope_2", "slope_3"), slopes, strict=True))
    brdf = CookTorrance(0.0, 1.0, f0=0.5, weight_2=0.7, weight_3=0.4, lobes="3", **named)

    def printed(g: Geometry) -> mpf:
        whole = sum(share * lobe(g, "beckmann", slope) for share, slope in zip(shares, slopes, strict=True))
        return microsurface.dielectric(g.cos_difference, 0.5) * whole

    assert deviation_from_print(brdf, printed, seed=9) < tolerances.INDEPENDENT


@pytest.mark.parametrize(("distribution", "masking"), MASKED)
@pytest.mark.parametrize("fresnel", ["dielectric", "conductor", "schlick", "colour-shift"])
def test_several_lobes_are_the_weighted_sum_of_single_ones(distribution: str, masking: str, fresnel: str) -> None:
    chosen = {"distribution": distribution, "masking": masking, "fresnel": fresnel}
    pairs = random_pairs(100, seed=10)
    slopes = {"slope": 0.15, "slope_2": 0.3, "slope_3": 0.6}
    first, second, third = (CookTorrance(0.0, 1.0, slope, **chosen)(*pairs) for slope in slopes.values())
    two = CookTorrance(0.0, 1.0, weight_2=0.3, lobes="2", slope=0.15, slope_2=0.3, **chosen)(*pairs)
    three = CookTorrance(0.0, 1.0, weight_2=0.3, weight_3=0.8, lobes="3", **slopes, **chosen)(*pairs)
    close = {"rtol": tolerances.INDEPENDENT, "atol": tolerances.INDEPENDENT}
    torch.testing.assert_close(two, 0.7 * first + 0.3 * second, **close)
    torch.testing.assert_close(three, 0.7 * first + 0.3 * (0.2 * second + 0.8 * third), **close)


@pytest.mark.parametrize(
    ("lobes", "weights", "left"),
    [
        ("2", {"weight_2": 0.0}, 0.2),
        ("2", {"weight_2": 1.0}, 0.4),
        ("3", {"weight_2": 0.0, "weight_3": 1.0}, 0.2),
        ("3", {"weight_2": 1.0, "weight_3": 0.0}, 0.4),
        ("3", {"weight_2": 1.0, "weight_3": 1.0}, 0.6),
    ],
)
def test_weights_at_their_ends_leave_one_lobe(lobes: str, weights: dict[str, float], left: float) -> None:
    pairs = random_pairs(100, seed=11)
    found = CookTorrance(lobes=lobes, **weights)(*pairs)
    expected = CookTorrance(slope=left)(*pairs)
    torch.testing.assert_close(found, expected, rtol=tolerances.INDEPENDENT, atol=tolerances.INDEPENDENT)


@pytest.mark.parametrize("values", [{"k": 5.0}, {"weight_2": 0.3}, {"f0_mean": 0.5}])
def test_a_value_for_a_parameter_that_does_not_exist_is_refused(values: dict[str, float]) -> None:
    with pytest.raises(InputError, match="it needs"):
        CookTorrance(**values)


def test_complementary_weights_take_from_the_body_what_the_surface_has() -> None:
    pairs = random_pairs(100, seed=12)
    for s in (0.0, 0.3, 1.0):
        tied = CookTorrance(0.6, s, weights="complementary")(*pairs)
        free = CookTorrance(0.6 * (1 - s), s)(*pairs)
        torch.testing.assert_close(tied, free, rtol=tolerances.INDEPENDENT, atol=tolerances.INDEPENDENT)


def test_surface_alone_has_no_body() -> None:
    """Where the lobe has no light either but the last that a number can hold."""
    value = CookTorrance(0.6, 1.0, 0.05, weights="complementary")(degrees(70), degrees(70, 0))
    assert 0 <= value.item() < tolerances.UNDERFLOW


def test_whole_plastic_vase_in_fifty_digits() -> None:
    brdf = CookTorrance(0.5, 0.1, 0.15, 0.04, weights="complementary")

    def printed(g: Geometry) -> mpf:
        return (1 - mpf(0.1)) * mpf(0.5) / pi + mpf(0.1) * printed_lobe(g, 0.15, 0.04)

    assert deviation_from_print(brdf, printed, seed=13) < tolerances.INDEPENDENT


def test_colour_shift_goes_from_the_metals_colour_to_the_lights() -> None:
    brdf = CookTorrance(0.0, 1.0, 0.1, [0.95, 0.64, 0.54], f0_mean=0.7, fresnel="colour-shift")
    white = CookTorrance(0.0, 1.0, 0.1, 1.0, fresnel="schlick")
    shares = [brdf(*pair) / white(*pair) for pair in ((degrees(1e-4),) * 2, (degrees(89.999), degrees(89.999, 180)))]
    assert shares[0].tolist() == pytest.approx([0.95, 0.64, 0.54], abs=1e-6)
    assert shares[1].tolist() == pytest.approx([1.0, 1.0, 1.0], abs=1e-3)  # F rises by 4n, 45 a radian, at grazing


def test_conductor_without_extinction_is_the_dielectric() -> None:
    pairs = random_pairs(100, seed=14)
    metal = CookTorrance(0.2, 0.7, 0.3, eta=1.5, k=0.0, fresnel="conductor")(*pairs)
    glass = CookTorrance(0.2, 0.7, 0.3, 0.04)(*pairs)
    torch.testing.assert_close(metal, glass, rtol=tolerances.INDEPENDENT, atol=tolerances.INDEPENDENT)


@pytest.mark.parametrize(("distribution", "masking"), MASKED)
def test_smooth_copper_has_the_albedo_of_its_fresnel_reflectance(distribution: str, masking: str) -> None:
    # GGX has a tail: a tenth of the width.
    slope = 0.005 if distribution == "ggx" else 0.05
    brdf = CookTorrance(0.0, 1.0, slope, **COPPER, distribution=distribution, masking=masking, fresnel="conductor")
    expected = float(microsurface.conductor(mpmath.cos(mpf("0.5")), **COPPER))
    # Around the mirror direction, where the light is.
    computed = directional_albedo(brdf, 0.5, nodes=512).item()
    assert computed == pytest.approx(expected, rel=tolerances.SMOOTH_LIMIT)


@pytest.mark.parametrize(("theta", "albedo"), [(0, 0.942), (60, 0.902), (75, 0.931), (85, 0.974)])
def test_directional_albedo_of_a_gaussian_perfect_reflector(theta: float, albedo: float) -> None:
    brdf = CookTorrance(0.0, 1.0, 0.4, 1.0, distribution="gaussian", fresnel="schlick")
    computed = directional_albedo(brdf, math.radians(theta), nodes=192).item()
    assert computed == pytest.approx(albedo, abs=tolerances.THREE_DECIMALS)


@pytest.mark.parametrize("theta", [0, 40, 75])
def test_unmasked_ggx_returns_the_light_of_facets_that_send_it_upward(theta: float) -> None:
    """∫ D G1 G1/(4 ci cr) cr dω = ∫ over facets that light meets of G1(L) G1(V) (V·H)/(N·L) D cos α dω."""
    m, light = 0.5, math.radians(theta)
    brdf = CookTorrance(0.0, 1.0, m, 1.0, distribution="ggx", masking="smith", fresnel="schlick")
    x, azimuth = (torch.arange(n, dtype=torch.float64) + 0.5 for n in (1500, 720))
    x, azimuth = x[:, None] * (math.pi / 2 / 1500), azimuth * (2 * math.pi / 720)
    alpha = torch.atan(m * x.tan())
    facing = math.cos(light) * alpha.cos() + math.sin(light) * alpha.sin() * azimuth.cos()
    up = 2 * facing * alpha.cos() - math.cos(light)

    def g1(cos: torch.Tensor) -> torch.Tensor:
        return 2 / (1 + (1 + m * m * (1 / cos.square() - 1)).sqrt())

    seen = (facing > 0) & (up > 0)
    sent = facing / (math.cos(light) * alpha.cos()) * g1(up.clamp(1e-9, 1)) * g1(torch.tensor(math.cos(light)))
    expected = (torch.where(seen, sent, 0) * (2 * x).sin()).mean(-1).sum() * (math.pi / 2 / 1500)
    computed = directional_albedo(brdf, light, nodes=192).item()
    assert computed == pytest.approx(expected.item(), abs=tolerances.PERFECT_REFLECTOR)


def test_gaussian_has_no_smith_masking() -> None:
    for refused in (
        lambda: CookTorrance(distribution="gaussian", masking="smith"),
        lambda: model("cook-torrance(distribution=gaussian,masking=smith)"),
    ):
        with pytest.raises(InputError, match="Smith's masking has no closed form for a Gaussian of the angle; take"):
            refused()


ALWAYS = ["diffuse", "specular", "slope"]


@pytest.mark.parametrize(
    ("options", "existing"),
    [
        ({}, ["f0"]),
        ({"lobes": "2"}, ["f0", "slope_2", "weight_2"]),
        ({"lobes": "3"}, ["f0", "slope_2", "slope_3", "weight_2", "weight_3"]),
        ({"fresnel": "conductor"}, ["eta", "k"]),
        ({"fresnel": "schlick"}, ["f0"]),
        ({"fresnel": "colour-shift"}, ["f0", "f0_mean"]),
        ({"fresnel": "conductor", "lobes": "2"}, ["eta", "k", "slope_2", "weight_2"]),
        ({"distribution": "ggx", "masking": "smith", "weights": "complementary"}, ["f0"]),
    ],
)
def test_parameters_exist_under_their_options_only(options: dict[str, str], existing: list[str]) -> None:
    brdf = CookTorrance(**options)
    assert sorted(brdf.declared) == sorted([*ALWAYS, *existing])
    assert [*brdf.parameters] == [*brdf.declared]
    conditional = {"f0", "f0_mean", "eta", "k", "slope_2", "slope_3", "weight_2", "weight_3"}
    for name in conditional - {*existing}:
        with pytest.raises(InputError, match=f"cook-torrance has no parameter {name} with these options; it needs"):
            brdf.replace({name: 0.5})


@pytest.mark.parametrize(
    ("fresnel", "coloured"),
    [("dielectric", set()), ("schlick", {"f0"}), ("colour-shift", {"f0"}), ("conductor", {"eta", "k"})],
)
def test_reflectance_has_a_colour_where_the_metal_has_one(fresnel: str, coloured: set[str]) -> None:
    declared = CookTorrance(fresnel=fresnel).declared
    assert {name for name, kind in declared.items() if kind.per_channel} == {"diffuse", "specular"} | coloured


@pytest.mark.parametrize("normalisation", FACTORS)
@pytest.mark.parametrize(("distribution", "masking"), MASKED)
def test_normalisations_scale_every_lobe(distribution: str, masking: str, normalisation: str) -> None:
    pairs = random_pairs(50, seed=15)
    chosen: dict[str, Any] = {"distribution": distribution, "masking": masking, "lobes": "2"}
    physical = CookTorrance(0.0, **chosen)(*pairs)
    other = CookTorrance(0.0, normalisation=normalisation, **chosen)(*pairs)
    expected = FACTORS[normalisation] * physical
    torch.testing.assert_close(other, expected, rtol=tolerances.INDEPENDENT, atol=tolerances.INDEPENDENT)


@pytest.mark.parametrize(
    ("lobes", "values", "expected"),
    [
        ("2", {"slope": 0.4, "slope_2": 0.1, "weight_2": 0.3}, {"slope": 0.1, "slope_2": 0.4, "weight_2": 0.7}),
        ("2", {"slope": 0.1, "slope_2": 0.4, "weight_2": 0.3}, {"slope": 0.1, "slope_2": 0.4, "weight_2": 0.3}),
        # What has no share has no width to speak of.
        ("2", {"slope": 0.4, "slope_2": 0.1, "weight_2": 0.0}, {"slope": 0.4, "slope_2": 0.1, "weight_2": 0.0}),
        (
            "3",
            {"slope": 0.6, "slope_2": 0.1, "slope_3": 0.3, "weight_2": 0.7, "weight_3": 0.4},
            {"slope": 0.1, "slope_2": 0.3, "slope_3": 0.6, "weight_2": 0.58, "weight_3": 0.3 / 0.58},
        ),
    ],
)
def test_lobes_in_their_order_reflect_the_same(lobes: str, values: dict, expected: dict) -> None:
    brdf = CookTorrance(0.2, 0.8, lobes=lobes, **values)
    pairs = random_pairs(50, seed=4)
    close = {"rtol": tolerances.INDEPENDENT, "atol": tolerances.INDEPENDENT}
    torch.testing.assert_close(brdf.ordered(*pairs), brdf(*pairs), **close)
    found = {name: float(brdf.ordered.parameters[name]) for name in values}
    assert found == pytest.approx(expected)
    both = (brdf + Lambert(0.5)).ordered.parameters
    assert {name: float(both[f"cook-torrance.{name}"]) for name in values} == pytest.approx(expected)
