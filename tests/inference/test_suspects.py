"""Evidence for a family of errors: chance is none, and the spread is that of the errors."""

from __future__ import annotations

import math

import pytest
import torch

from matest.inference.score_sums import PixelSums, ScoreSums
from matest.inference.suspects import Suspect, alike, suspects

UNKNOWNS = 200


def sums_of(scores: torch.Tensor, information: float, fitted: int = 1) -> ScoreSums:
    """Independent unknowns of like information, those after the first of one family."""
    count = len(scores)
    return ScoreSums(
        information=information * torch.eye(count, dtype=torch.float64),
        scores=scores,
        fitted=torch.arange(fitted),
        alone=(),
        places={"errors": slice(fitted, count)},
        by_pixel={},
        units={"errors": 1.0},
        cost=10_000.0,
        values=10_000,
    )


def deviates(count: int, seed: int) -> torch.Tensor:
    return torch.randn(count, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


@pytest.mark.parametrize("unknowns", [1, 3, UNKNOWNS])
def test_chance_is_no_suspect(unknowns: int) -> None:
    information = 25.0
    for seed in range(300):
        scores = math.sqrt(information) * deviates(1 + unknowns, seed)
        assert suspects(sums_of(scores, information)) == []


def test_the_spread_is_that_of_the_errors() -> None:
    information, spread = 25.0, 0.6
    scores = information * spread * deviates(1 + UNKNOWNS, 1) + math.sqrt(information) * deviates(1 + UNKNOWNS, 2)
    (found,) = suspects(sums_of(scores, information))
    assert found.spread == pytest.approx(spread, rel=0.2)
    assert found.unknowns == UNKNOWNS


def test_what_was_fitted_explains_its_part() -> None:
    """A column that is one of the fit's is no suspect, however large its score."""
    sums = sums_of(torch.tensor([300.0, 300.0], dtype=torch.float64), 25.0)
    sums.information[:] = 25.0
    assert suspects(sums) == []


def test_the_rounding_of_what_was_fitted_is_no_evidence() -> None:
    sums = sums_of(torch.tensor([3e6, 3e6 + 100], dtype=torch.float64), 1e7)
    sums.information[0, 1] = sums.information[1, 0] = 1e7 - 1
    assert suspects(sums) == []


def test_errors_of_pixels_are_judged_alike() -> None:
    information, spread = 25.0, 0.6
    scores = information * spread * deviates(UNKNOWNS, 1) + math.sqrt(information) * deviates(UNKNOWNS, 2)
    pixels = PixelSums(torch.full((UNKNOWNS, 1, 1), information, dtype=torch.float64), scores[:, None])
    common = sums_of(torch.cat([scores[:1] * 0, scores]), information)
    alone = ScoreSums(
        common.information[:1, :1],
        common.scores[:1],
        torch.arange(1),
        (),
        {},
        {"noise": pixels},
        {"noise": 1.0},
        1e4,
        10_000,
    )
    (by_pixel,), (together,) = suspects(alone), suspects(common)
    assert by_pixel.evidence == pytest.approx(together.evidence, rel=1e-3)
    assert by_pixel.spread == together.spread


def test_the_one_of_few_unknowns_stands_in_front() -> None:
    many = Suspect("many", 100.0, 1.0, 4_000, 210.0)
    few = Suspect("few", 90.0, 1.0, 3, 190.0)
    weak = Suspect("weak", 10.0, 1.0, 1, 30.0)
    assert [one.name for one in alike([many, few, weak])] == ["few", "many"]
