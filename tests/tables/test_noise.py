"""The noise of a table."""

from __future__ import annotations

import pytest
import torch

from matest.brdf import CookTorrance
from matest.errors import InputError
from matest.tables.loss import Loss
from matest.tables.noise import estimated_noise, first_noise, stated_noise
from tests.tables.goniometer import hemispherical, measured

GLOSS = CookTorrance([0.3, 0.02, 0.1], 1.0, 0.15)


@pytest.mark.parametrize(("relative", "floor"), [(0.01, 1e-4), (0.1, 1e-2)])
def test_relative_noise_and_floor_are_told_apart(relative: float, floor: float) -> None:
    clean = measured(GLOSS, hemispherical(), noise=0)
    model = clean.values * clean.wi[:, 2:]
    generator = torch.Generator().manual_seed(3)
    draws = [torch.randn(model.shape, generator=generator, dtype=torch.float64) for _ in range(2)]
    noise = estimated_noise(
        Loss.LIKELIHOOD, model + relative * model * draws[0] + floor * draws[1], model, torch.ones(len(model), 1)
    )
    assert noise.relative.tolist() == pytest.approx([relative] * 3, rel=0.15)
    assert noise.floor.tolist() == pytest.approx([floor] * 3, rel=0.4)


def test_a_cost_has_one_variance_for_all_values() -> None:
    clean = measured(GLOSS, hemispherical(), noise=0)
    y = clean.values * clean.wi[:, 2:]
    generator = torch.Generator().manual_seed(3)
    spread = 0.01 * torch.randn(y.shape, generator=generator, dtype=torch.float64)
    noise = estimated_noise(Loss.CUBE_ROOT, (y ** (1 / 3) + spread) ** 3, y, torch.ones(len(y), 1))
    assert noise.relative.tolist() == [0, 0, 0]
    assert noise.floor.tolist() == pytest.approx([0.01] * 3, rel=0.02)


def test_stated_noise_is_checked() -> None:
    table = measured(GLOSS, hemispherical())
    assert stated_noise(table, 0.01, 0.002).floor.tolist() == [0.002] * 3
    assert bool((stated_noise(table, 0.01).floor > 0).all())
    for relative, floor in ((0.0, None), (1.5, None), (0.01, 0.0)):
        with pytest.raises(InputError, match="noise is a share of the value between 0 and 1"):
            stated_noise(table, relative, floor)


def test_a_first_noise_is_positive_even_where_most_values_are_dark() -> None:
    table = measured(GLOSS, hemispherical())
    table.values[:-10] = 0
    assert all(bool((part > 0).all()) for part in first_noise(table, Loss.LIKELIHOOD))
