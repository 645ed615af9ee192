"""What a bound holds of a texel has the error bar of a Gaussian that the bound cuts off."""

from __future__ import annotations

import math

import pytest
import torch
from scipy.stats import truncnorm

from matest.estimators.texels.elimination import _of_held


@pytest.mark.parametrize("inflation", [1.0, 4.0])
@pytest.mark.parametrize("push", [0.0, 2.0, 30.0])
def test_a_bound_cuts_the_gaussian_off(push: float, inflation: float) -> None:
    """Two unknowns, the first held; the second follows its mean square distance from the bound."""
    information = torch.tensor([[5.0, 2.0], [2.0, 4.0]])[..., None]
    own = information.clone()
    own[0, 0] *= 1e12
    added = inflation * _of_held(0, information, torch.tensor([push]), own, inflation)[..., 0]
    left, follows = 5 - 2 * 2 / 4, -2 / 4
    std = math.sqrt(inflation / left)
    cut = truncnorm(push / left / std, math.inf, loc=-push / left, scale=std)
    square = cut.var() + cut.mean() ** 2
    expected = square * torch.tensor([[1, follows], [follows, follows**2]])
    torch.testing.assert_close(added, expected.float(), rtol=1e-4, atol=0)
