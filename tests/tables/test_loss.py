"""Costs of fits to tables."""

from __future__ import annotations

import pytest
import torch

from matest.tables.loss import Loss, cube_root

COSTS = [loss for loss in Loss if loss.comparison is not None]


def test_there_is_one_likelihood() -> None:
    assert [loss for loss in Loss if loss.comparison is None] == [Loss.LIKELIHOOD]


@pytest.mark.parametrize("loss", COSTS)
def test_slopes_are_derivatives(loss: Loss) -> None:
    assert loss.comparison is not None
    y = torch.logspace(-5, 2, 40, dtype=torch.float64).requires_grad_()
    (slope,) = torch.autograd.grad(loss.comparison.function(y).sum(), y)
    torch.testing.assert_close(loss.comparison.slope(y.detach()), slope)


@pytest.mark.parametrize("loss", COSTS)
def test_dark_and_negative_values_are_finite(loss: Loss) -> None:
    assert loss.comparison is not None
    y = torch.tensor([-0.01, -1e-9, 0.0, 1e-12], dtype=torch.float64)
    assert bool(torch.isfinite(loss.comparison.function(y)).all())
    assert bool(torch.isfinite(loss.comparison.slope(y)).all())
    assert bool((loss.comparison.function(y).diff() >= 0).all())


def test_the_cube_root_of_a_negative_value_is_negative() -> None:
    assert cube_root(torch.tensor([-8.0, 0.0, 27.0])).tolist() == pytest.approx([-2, 0, 3])
