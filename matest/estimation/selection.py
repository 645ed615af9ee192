"""Which model the images support: a bigger one must predict images left out of the fit better."""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from matest.errors import InputError
from matest.estimation.result import Candidate
from matest.estimation.specification import Constraints, specify
from matest.estimators import Linearisation, Problem, fit_batches
from matest.photographs.pilot import pilot
from matest.photographs.samples import Samples
from matest.samples import Batch

# From few to many parameters; a later one replaces an earlier one only if it predicts better.
CANDIDATES = (
    "lambert",
    "oren-nayar-qualitative",
    "oren-nayar",
    "cook-torrance",
    "oren-nayar+torrance-sparrow",
    "oren-nayar+cook-torrance",
)
_SAMPLES = 8_000
_FOLDS = 4
# Fewer images than this: parts of images are left out instead.
_MIN_IMAGES = 3
_BANDS = 4
# Better by chance is not better: two standard errors over the parts, and at least this share of the error.
_STANDARD_ERRORS, _LEAST_GAIN = 2.0, 0.01
# A model that holds to the noise replaces one that does not: mean squared errors of single values, in units of the
# noise and each no larger than the second of these, lie below the first.
_HOLDS, _WILD = 1.1, 16.0
# Squared relative errors below this are rounding.
_LEAST_ERROR = 1e-12


@dataclass(frozen=True)
class _Trial:
    """Prediction of one candidate.

    Attributes:
        expression: of the model.
        errors: squared error of every part when it was left out, relative to its signal.
        misfit: the same in units of the noise, all parts together; single values count no more than `_WILD`.
        by_chance: standard deviation of that where the model holds.
    """

    expression: str
    errors: np.ndarray
    misfit: float
    by_chance: float

    @property
    def holds(self) -> bool:
        """Whether what was left out is met to the noise."""
        return self.misfit < _HOLDS + 5 * self.by_chance

    @property
    def score(self) -> float:
        return math.sqrt(float(self.errors.mean()))


def select(
    samples: Samples, constraints: Constraints, seed: int, progress: Callable[[str], None]
) -> tuple[str, list[Candidate]]:
    """The smallest candidate that no other one beats, and the record of the comparison.

    Candidates that lack a constrained parameter are not tried.

    Raises:
        InputError: no candidate has the constrained parameters.
    """
    photographs = samples.photographs
    parts = _parts(pilot(samples, _SAMPLES, seed))
    problems: dict[str, Problem] = {}
    for expression in CANDIDATES:
        # A candidate that the constraints do not fit is not tried.
        with contextlib.suppress(InputError):
            found = specify(
                expression,
                constraints,
                channels=photographs.channels,
                relative=photographs.relative,
                scene=photographs.scene,
            )
            problems[expression] = found.problem
    if not problems:
        names = ", ".join([*constraints.fix, *constraints.free, *constraints.tie])
        raise InputError(f"no model that 'auto' tries fits what was said of {names}: name the model with --model.")
    trials, verdicts = [], {}
    best: _Trial | None = None
    for expression, problem in problems.items():
        progress(f"trying {expression}")
        errors, squares = np.empty(len(parts)), []
        for fold in range(min(_FOLDS, len(parts))):
            left = range(fold, len(parts), _FOLDS)
            solution = fit_batches(problem, [part for k, part in enumerate(parts) if k not in left])
            linearisation = Linearisation(solution.problem, solution.unknowns, derivatives=False)
            for k in left:
                predicted = linearisation.radiance(parts[k])
                errors[k] = _error(predicted, parts[k])
                squares.append(_in_noise(predicted, parts[k]))
        met = torch.cat(squares)
        trial = _Trial(expression, errors, float(met.mean()), math.sqrt(2 / max(met.numel(), 1)))
        wins, verdicts[expression] = _verdict(trial, best)
        trials.append(trial)
        if wins:
            best = trial
    assert best is not None
    unit = "image" if len(parts) == len(samples.images) else "band"
    candidates = [Candidate(t.expression, t.score, t.score, verdicts[t.expression].format(unit=unit)) for t in trials]
    return best.expression, candidates


def _verdict(trial: _Trial, best: _Trial | None) -> tuple[bool, str]:
    """Whether a trial replaces the best one so far, and why."""
    if best is None:
        return True, "the simplest model tried"
    # By what factor each part's error falls: parts differ in how much they show, not in which model is better.
    gains = 0.5 * np.log(np.maximum(best.errors, _LEAST_ERROR) / np.maximum(trial.errors, _LEAST_ERROR))
    gain, spread = float(gains.mean()), float(gains.std(ddof=1)) / math.sqrt(len(gains))
    share = 1 - math.exp(-gain)
    if trial.holds and not best.holds:
        return True, f"meets {{unit}}s left out to their noise, which {best.expression} does not"
    if gain > _STANDARD_ERRORS * spread and share > _LEAST_GAIN:
        return True, f"predicts {{unit}}s left out better than {best.expression}: error typically {share:.0%} smaller"
    if share > 0:
        return False, f"not clearly better than {best.expression}: error typically {share:.1%} smaller, within chance"
    return False, f"predicts {{unit}}s left out no better than {best.expression}"


def _error(predicted: Tensor, batch: Batch) -> float:
    # What is dark says nothing of any model.
    signal = float(batch.radiance.square().mean())
    return float((predicted - batch.radiance).square().mean()) / signal if signal > 0 else 1.0


def _in_noise(predicted: Tensor, batch: Batch) -> Tensor:
    """Squared errors of single values in units of the noise, those of saturated ones left out."""
    squares = ((batch.radiance - predicted).square() / batch.variance(predicted)).clamp(max=_WILD)
    return (squares if batch.clipped is None else squares[batch.clipped == 0]).flatten()


def _parts(batches: list[Batch]) -> list[Batch]:
    """What is left out in turn: whole images or, where there are few of them, horizontal bands of each."""
    if len(batches) >= _MIN_IMAGES:
        return batches
    bands = [np.linspace(0, len(batch), _BANDS + 1).astype(int) for batch in batches]
    return [
        batch[int(start) : int(end)]
        for batch, edges in zip(batches, bands, strict=True)
        for start, end in itertools.pairwise(edges)
        if start < end
    ]
