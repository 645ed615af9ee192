"""Lambert's law."""

from __future__ import annotations

import math

import pytest
import torch

from matest.brdf import Lambert
from tests import tolerances
from tests.sampling import directional_albedo, random_pairs


def test_value_is_albedo_over_pi_in_every_direction() -> None:
    values = Lambert(0.7)(*random_pairs(100, seed=1))
    torch.testing.assert_close(values, torch.full_like(values, 0.7 / math.pi), rtol=tolerances.INDEPENDENT, atol=0)


def test_channels_have_their_own_albedo() -> None:
    values = Lambert([0.1, 0.5, 0.9])(*random_pairs(2, seed=2))
    torch.testing.assert_close(values * math.pi, torch.tensor([[0.1, 0.5, 0.9]] * 2, dtype=torch.float64))


@pytest.mark.parametrize("theta", [0.0, 0.8, 1.5])
def test_directional_albedo_is_the_albedo(theta: float) -> None:
    assert directional_albedo(Lambert(0.3), theta).item() == pytest.approx(0.3, rel=tolerances.NORMALISATION)
