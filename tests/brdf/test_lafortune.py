"""Lafortune's lobe: a baseline of Li & Torrance's Table 4."""

from __future__ import annotations

import math

import pytest
import torch

from matest.brdf.lafortune import Lafortune
from tests import tolerances
from tests.sampling import BACKWARD, FORWARD, LIGHT, random_pairs

LOBE = {"diffuse": 0.0, "specular": 1.0}


def test_reference_values() -> None:
    lobe = Lafortune(**LOBE, exponent=8, c_xy=-0.95, c_z=1.05)
    assert lobe(LIGHT, FORWARD).item() == pytest.approx(0.289426552, rel=tolerances.NINE_DIGITS)
    assert lobe(LIGHT, BACKWARD).item() == pytest.approx(0.0, rel=tolerances.NINE_DIGITS)


def test_lafortunes_lobe_contains_phongs() -> None:
    wi, wo = random_pairs(200, seed=3)
    c = (10 / (2 * math.pi)) ** (1 / 8)
    mirror = wi * torch.tensor([-1.0, -1.0, 1.0])
    cosine = (mirror * wo).sum(-1, keepdim=True).clamp(min=0)
    lobe = Lafortune(**LOBE, exponent=8, c_xy=-c, c_z=c)(wi, wo)
    torch.testing.assert_close(lobe, 10 / (2 * math.pi) * cosine**8, rtol=1e-10, atol=1e-30)
