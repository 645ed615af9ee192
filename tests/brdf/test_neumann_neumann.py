"""Neumann and Neumann's lobe: a baseline of Li & Torrance's Table 4."""

from __future__ import annotations

import math

import pytest

from matest.brdf.neumann_neumann import NeumannNeumann
from tests import tolerances
from tests.sampling import BACKWARD, FORWARD, LIGHT, directional_albedo

LOBE = {"diffuse": 0.0, "specular": 1.0}


def test_reference_values() -> None:
    lobe = NeumannNeumann(**LOBE, exponent=8)
    assert lobe(LIGHT, FORWARD).item() == pytest.approx(0.834665385, rel=tolerances.NINE_DIGITS)
    assert lobe(LIGHT, BACKWARD).item() == pytest.approx(0.0, rel=tolerances.NINE_DIGITS)


def test_directional_albedo() -> None:
    lobe = NeumannNeumann(**LOBE, exponent=10)
    albedo = [directional_albedo(lobe, math.radians(angle), nodes=96).item() for angle in (0, 60, 75, 85)]
    assert albedo == pytest.approx((1.0, 0.84, 0.71, 0.60), abs=tolerances.TWO_DECIMALS)
