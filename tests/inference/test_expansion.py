"""χ² to second order, and what the domain of a gauge adds to it."""

from __future__ import annotations

import math

import pytest
import torch

from matest.inference.expansion import Expansion
from tests.inference.judged import solved
from tests.problems import problem


def about(gauge: float, limit: float) -> Expansion:
    relative = problem("oren-nayar", relative=True).limited(limit)
    none = torch.zeros(3, dtype=torch.float64)
    return Expansion(relative, torch.tensor([0.5, 0.3, gauge], dtype=torch.float64), torch.diag(none), none)


def test_residuals_larger_than_the_noise_make_the_information_smaller() -> None:
    gradients = torch.tensor([[3.0, -1.0], [1.0, 2.0]])
    exact, missed = Expansion.of(solved(gradients)), Expansion.of(solved(gradients, chi2=4.0))
    torch.testing.assert_close(missed.information, exact.information / 4)
    torch.testing.assert_close(missed.gradient, exact.gradient / 4)
    assert exact.information.diagonal().tolist() == pytest.approx([200, 50])


def test_without_a_gauge_nothing_is_added_to_the_samples() -> None:
    expansion = Expansion.of(solved(torch.zeros(2, 2)))
    assert torch.equal(expansion.precision, expansion.information)
    assert not bool(expansion.gauges.any())


@pytest.mark.parametrize("gauge", [0.0, 0.4, 1.0, 2.0])
def test_a_gauge_is_known_as_well_as_its_domain_says(gauge: float) -> None:
    # Places drawn evenly from the domain deviate from the value by so much.
    places = (torch.arange(100_000, dtype=torch.float64) + 0.5) / 50_000
    expected = float((places - gauge).square().mean())
    prior = about(gauge, 2.0).prior
    assert prior.tolist() == pytest.approx([0, 0, 1 / expected], rel=1e-6)
    assert float(about(gauge, 2.0).covariance.std[2]) == pytest.approx(math.sqrt(expected), rel=1e-6)


def test_a_gauge_without_an_end_is_known_by_the_samples_alone() -> None:
    assert about(1.0, math.inf).prior.tolist() == [0, 0, 0]
