from __future__ import annotations

import torch

from matest.estimators.columns import Columns
from matest.estimators.moments import moments
from matest.samples.likelihood import LeastSquares


def test_samples_without_a_column_have_moments_of_none() -> None:
    """As of a dictionary whose every component is 0, where all values are negative."""
    residual = torch.arange(15.0).reshape(5, 3)
    problem = LeastSquares(residual, torch.ones(5, 3), torch.ones(5, 3, dtype=torch.bool))
    columns = Columns(torch.zeros(1, 0, 5), torch.ones(3))
    sums = moments(columns, problem, residual, torch.tensor([0, 0, 1, 1, 1]))
    assert sums.gram.shape == (2, 3, 0, 0)
    assert sums.labels.tolist() == [0, 1]
