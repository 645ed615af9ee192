"""When one model predicts what was left out better than another one: by more than chance, and by enough."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

from torch import Tensor

from matest.brdf import Brdf
from matest.estimation.recipes import Recipe
from matest.estimators.leave_out import LeftOut
from matest.parameters import Role

# χ² by which a bigger model has to be better, in units of the residuals: noise alone lets no model win by so much.
_LEAST_GAIN = 12.0
# Standard errors over the parts by which it has to be better, so that it is not by chance.
_STANDARD_ERRORS = 2.0
# Share of the squared error by which it has to be better: one per cent of the error.
_LEAST_SHARE = 0.02
# Instead, the share of the squared error beyond the noise: a small part of a model can be seen under much noise.
_LEAST_SHARE_BEYOND_NOISE = 0.2
# χ² per value of a model that describes the samples, with room for noise that was estimated from the photographs.
_DESCRIBED_CHI2 = 1.1
# Share of the misfit below which a smaller one is none that a person would speak of.
_LEAST_WORTH_SAYING = 5e-4
# Squared errors relative to the noise below this are rounding.
_LEAST_ERROR = 1e-12


class Contender(Protocol):
    """A model and how it predicts what was left out."""

    @property
    def expression(self) -> str:
        """Of the model."""

    @property
    def costs(self) -> Tensor:
        """Squared error of each part when it was left out, in units of the noise."""

    @property
    def values(self) -> int:
        """Number of values."""

    @property
    def holds(self) -> bool:
        """Whether the model meets the samples to their noise."""


Model = TypeVar("Model", bound=Contender)


@dataclass(frozen=True, eq=False)
class Trial:
    """A candidate fitted to the pilot.

    Attributes:
        recipe: of the candidate.
        left_out: its fit, and its error on what was left out.
        values: number of values.
        relative_rmse: error of all parts when they were left out, every usable value counting alike; not a number
            before the comparison is over.
    """

    recipe: Recipe
    left_out: LeftOut
    values: int
    relative_rmse: float = math.nan

    @property
    def holds(self) -> bool:
        """Whether the model meets the samples to their noise."""
        return describes(self.left_out.reduced_chi2, self.values)

    @property
    def expression(self) -> str:
        """Of the model."""
        return self.recipe.expression

    @property
    def costs(self) -> Tensor:
        """Squared error of each part when it was left out, in units of the noise."""
        return self.left_out.costs

    @property
    def score(self) -> float:
        """Error of single values left out, in units of the noise."""
        return score(self)

    @property
    def material(self) -> Brdf:
        """The model at the optimum of the pilot."""
        return self.left_out.problem.material(self.left_out.unknowns)

    @property
    def surface(self) -> str:
        """What kind of surface the model shows at the optimum of the pilot, in words."""
        declared, values = self.material.declared, self.material.parameters
        f0 = [float(value.mean()) for name, value in values.items() if declared[name].role is Role.FRESNEL]
        return self.recipe.surface_of(max(f0, default=1.0))


def describes(chi2: float, values: int) -> bool:
    """Whether χ² per degree of freedom says that a model meets so many values to their noise."""
    return chi2 < _DESCRIBED_CHI2 + 5 * math.sqrt(2 / max(values, 1))


def score(trial: Contender) -> float:
    """Error of single values left out, in units of the noise."""
    return math.sqrt(float(trial.costs.sum()) / max(trial.values, 1))


def judge_trials(trials: Sequence[Model]) -> tuple[Model, list[str]]:
    """The smallest trial that no later one beats, and the reason why each one was chosen or not; `{unit}` is a part."""
    best, reasons = trials[0], ["the simplest model tried"]
    for trial in trials[1:]:
        name, share = best.expression, 1 - score(trial) / max(score(best), _LEAST_ERROR)
        if share < _LEAST_WORTH_SAYING:
            reasons.append(f"predicts {{unit}}s left out no better than {name}")
        elif not is_better(trial, best):
            reasons.append(f"not clearly better than {name}: its misfit is {share:.1%} smaller, within chance")
        elif trial.holds and not best.holds:
            reasons.append(f"meets {{unit}}s left out to their noise, which {name} does not")
        else:
            reasons.append(f"predicts {{unit}}s left out better than {name}: its misfit is {share:.1%} smaller")
        best = trial if share >= _LEAST_WORTH_SAYING and is_better(trial, best) else best
    return best, reasons


def is_better(trial: Contender, other: Contender) -> bool:
    """Whether a trial predicts what was left out better than another one, by more than chance and by enough."""
    if not is_enough(float(trial.costs.sum()), other):
        return False
    # Where the model holds, noise is the only chance there is.
    return trial.holds or _is_consistent(other.costs, trial.costs)


def is_enough(cost: float, other: Contender) -> bool:
    """Whether such a squared error of all parts left out is smaller by enough than that of a trial."""
    before = float(other.costs.sum())
    gain, beyond_noise = before - cost, max(before - other.values, 0.0)
    if gain < _LEAST_GAIN * max(cost / max(other.values, 1), 1.0):
        return False
    return gain >= _LEAST_SHARE * before or gain >= _LEAST_SHARE_BEYOND_NOISE * beyond_noise


def _is_consistent(before: Tensor, after: Tensor) -> bool:
    """Whether errors of the parts fall by more than chance, by like amounts or by like factors."""
    amounts = before - after
    factors = before.clamp(min=_LEAST_ERROR).log() - after.clamp(min=_LEAST_ERROR).log()
    return any(
        float(gains.mean()) > _STANDARD_ERRORS * float(gains.std()) / math.sqrt(len(gains))
        for gains in (amounts, factors)
    )
