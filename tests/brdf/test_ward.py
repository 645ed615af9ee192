"""Ward's model and its variants: a baseline of Li & Torrance's Table 4."""

from __future__ import annotations

import math

import pytest
import torch

from matest.brdf.cook_torrance import CookTorrance
from matest.brdf.ward import Ward
from tests import tolerances
from tests.sampling import BACKWARD, FORWARD, LIGHT, directional_albedo, random_pairs

LOBE = {"diffuse": 0.0, "specular": 1.0}
AXES = {"anisotropy": "axes", "slope_x": 0.2, "slope_y": 0.5}


@pytest.mark.parametrize(
    ("form", "forward", "backward"),
    [
        ("ward", 0.425939772, 2.21525321e-15),
        ("duer", 0.817222502, 4.25025999e-15),
        ("bounded", 0.924096851, 1.29293391e-14),
    ],
)
def test_reference_values(form: str, forward: float, backward: float) -> None:
    lobe = Ward(**LOBE, **AXES, form=form)
    assert lobe(LIGHT, FORWARD).item() == pytest.approx(forward, rel=tolerances.NINE_DIGITS)
    assert lobe(LIGHT, BACKWARD).item() == pytest.approx(backward, rel=tolerances.NINE_DIGITS)


@pytest.mark.parametrize(
    ("form", "expected"),
    [("ward", (0.89, 0.46, 0.27, 0.18)), ("duer", (0.93, 0.92, 0.89, 1.13)), ("bounded", (0.96, 0.90, 0.82, 0.81))],
)
def test_directional_albedo(form: str, expected: tuple[float, ...]) -> None:
    lobe = Ward(**LOBE, slope=0.2, form=form)
    albedo = [directional_albedo(lobe, math.radians(angle), nodes=96).item() for angle in (0, 60, 75, 85)]
    assert albedo == pytest.approx(expected, abs=tolerances.TWO_DECIMALS)


def test_the_bounded_form_is_a_slope_distribution_over_four_squared_cosines() -> None:
    wi, wo = random_pairs(200, seed=1, most=1.3)
    half = (wi + wo).square().sum(-1, keepdim=True)
    lobe = CookTorrance(**LOBE, slope=0.3, f0=1.0, fresnel="schlick", masking="v-cavity")(wi, wo)
    cavity = (4 * (wi + wo)[:, 2:] * torch.minimum(wi[:, 2:], wo[:, 2:]) / half).clamp(max=1)
    expected = lobe * 4 * wi[:, 2:] * wo[:, 2:] / cavity / half
    torch.testing.assert_close(Ward(**LOBE, slope=0.3, form="bounded")(wi, wo), expected, rtol=1e-10, atol=1e-290)


def test_equal_axes_are_isotropic() -> None:
    pairs = random_pairs(200, seed=2)
    across = Ward(**LOBE, anisotropy="axes", slope_x=0.3, slope_y=0.3)(*pairs)
    torch.testing.assert_close(across, Ward(**LOBE, slope=0.3)(*pairs), rtol=1e-11, atol=1e-290)
