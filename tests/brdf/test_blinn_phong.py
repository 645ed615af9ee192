"""Blinn and Phong's highlight: a baseline of Li & Torrance's Table 4."""

from __future__ import annotations

import math

import pytest

from matest.brdf.blinn_phong import BlinnPhong
from tests import tolerances
from tests.sampling import BACKWARD, FORWARD, LIGHT, directional_albedo

LOBE = {"diffuse": 0.0, "specular": 1.0}


def test_reference_values() -> None:
    lobe = BlinnPhong(**LOBE, exponent=8)
    assert lobe(LIGHT, FORWARD).item() == pytest.approx(0.304190234, rel=tolerances.NINE_DIGITS)
    assert lobe(LIGHT, BACKWARD).item() == pytest.approx(0.0058077865, rel=tolerances.NINE_DIGITS)


def test_directional_albedo() -> None:
    lobe = BlinnPhong(**LOBE, exponent=10)
    albedo = [directional_albedo(lobe, math.radians(angle), nodes=96).item() for angle in (0, 60, 75, 85)]
    assert albedo == pytest.approx((1.0, 0.40, 0.22, 0.13), abs=tolerances.TWO_DECIMALS)
