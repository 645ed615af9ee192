"""When one model predicts what was left out better than another one."""

from __future__ import annotations

import pytest
import torch

from matest.estimation.comparison import Trial, is_better, judge_trials
from matest.estimation.options import Options
from matest.estimation.recipes import RECIPES
from matest.estimation.specification import specify_unknowns
from matest.estimators.leave_out import LeftOut

VALUES = 6000


def trial(costs: list[float], number: int = 0, reduced_chi2: float | None = None) -> Trial:
    """A trial of six parts of a thousand values each with these costs per value."""
    problem = specify_unknowns(RECIPES[number].expression, Options(), channels=1, relative=False).problem
    total = torch.tensor(costs, dtype=torch.float64) * VALUES / len(costs)
    chi2 = float(total.sum()) / VALUES if reduced_chi2 is None else reduced_chi2
    moves = torch.zeros(len(costs), problem.size, dtype=torch.float64)
    left_out = LeftOut(problem, problem.anywhere, float(total.sum()), chi2, total, moves)
    return Trial(RECIPES[number], left_out, VALUES, 0.1)


def test_a_gain_that_noise_alone_may_bring_is_none() -> None:
    assert not is_better(trial([0.999] * 6), trial([1.0] * 6))


def test_a_small_part_of_a_model_is_seen_under_much_noise() -> None:
    # 60 units of χ² of 6,000: not by chance, although the error is but half a per cent smaller.
    assert is_better(trial([1.0] * 6), trial([1.01] * 6))


def test_where_nothing_holds_a_gain_below_one_per_cent_of_the_error_is_none() -> None:
    assert not is_better(trial([99.0] * 6), trial([100.0] * 6))
    assert is_better(trial([97.0] * 6), trial([100.0] * 6))


def test_a_gain_in_one_part_alone_is_chance_where_the_model_does_not_hold() -> None:
    assert not is_better(trial([90.0, 100, 100, 100, 100, 100]), trial([130.0, 100, 100, 100, 100, 100]))


def test_a_gain_in_one_part_alone_is_none_by_chance_where_the_model_holds() -> None:
    assert is_better(trial([1.0] * 6), trial([50.0, 1, 1, 1, 1, 1]))


@pytest.mark.parametrize(
    "before",
    # Like amounts: by factors the last part speaks against it. Like factors: the amounts differ by decades.
    [[62, 94, 56, 86, 96, 22], [4.0, 40, 400, 4, 40, 400]],
)
def test_gains_may_be_alike_in_amount_or_in_factor(before: list[float]) -> None:
    after = [45.0, 54, 35, 43, 55, 43] if before[0] == 62 else [value / 1.2 for value in before]
    assert is_better(trial(after), trial(before))


def test_the_smallest_model_that_no_later_one_beats_is_the_best() -> None:
    trials = [trial([30.0] * 6, 0), trial([1.0] * 6, 1), trial([1.0005] * 6, 2), trial([0.9985] * 6, 3)]
    best, reasons = judge_trials(trials)
    assert best is trials[1]
    names = [one.recipe.expression for one in trials]
    assert reasons == [
        "the simplest model tried",
        f"meets {{unit}}s left out to their noise, which {names[0]} does not",
        f"predicts {{unit}}s left out no better than {names[1]}",
        f"not clearly better than {names[1]}: its misfit is 0.1% smaller, within chance",
    ]


def test_a_better_model_that_does_not_hold_says_by_how_much_it_is_better() -> None:
    best, reasons = judge_trials([trial([100.0] * 6, 0), trial([64.0] * 6, 1)])
    assert best.recipe is RECIPES[1]
    assert reasons[1] == "predicts {unit}s left out better than lambert: its misfit is 20.0% smaller"
