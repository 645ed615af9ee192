"""Which model the images support: a bigger one must predict images left out of the fit better."""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from matest.errors import InputError
from matest.estimation.options import Options
from matest.estimation.result import Candidate
from matest.estimation.specification import specify_unknowns
from matest.estimators import Problem, fit_batches
from matest.estimators.passes import predict_radiance
from matest.progress import Progress, silent
from matest.samples import Batch, Samples
from matest.samples.likelihood import squared_errors

# From few to many parameters; a later one replaces an earlier one only if it predicts better.
CANDIDATES = (
    "lambert",
    "oren-nayar-qualitative",
    "oren-nayar",
    "cook-torrance",
    "oren-nayar+torrance-sparrow",
    "oren-nayar+cook-torrance",
)
# Samples that candidates are compared on: enough to tell them apart by one per cent of the error.
_SAMPLES = 8_000
# Times that a candidate is fitted, each without another share of the parts.
_FOLDS = 4
# Fewer images than this: bands of images are left out instead.
_MIN_IMAGES = 3
# Horizontal bands of an image, so that one image gives every fold a part.
_BANDS = 4
# Standard errors over the parts by which a bigger model has to be better, so that it is not by chance.
_STANDARD_ERRORS = 2.0
# Share of the error by which it has to be better in any case.
_LEAST_GAIN = 0.01
# Mean squared error of single values, in units of the noise. A model with a smaller one holds, and replaces one that
# does not.
_HOLDS = 1.1
# Largest squared error of a single value in that mean, in units of the noise: outliers count no more.
_LARGEST_SQUARE = 16.0
# Squared relative errors below this are rounding.
_LEAST_ERROR = 1e-12


@dataclass(frozen=True)
class _Trial:
    """Prediction of one candidate.

    Attributes:
        expression: of the model.
        errors: squared error of every part when it was left out, relative to its signal.
        misfit: the same in units of the noise, all parts together; single values count no more than `_LARGEST_SQUARE`.
        by_chance: standard deviation of that where the model holds.
        relative_rmse: error of all parts when they were left out, every usable value counting alike.
    """

    expression: str
    errors: np.ndarray
    misfit: float
    by_chance: float
    relative_rmse: float

    @property
    def holds(self) -> bool:
        """Whether what was left out is met to the noise."""
        return self.misfit < _HOLDS + 5 * self.by_chance

    @property
    def score(self) -> float:
        return math.sqrt(float(self.errors.mean()))


def select(samples: Samples, options: Options, progress: Progress = silent) -> tuple[str, list[Candidate]]:
    """The smallest candidate that no other one beats, and the record of the comparison.

    Candidates that lack a constrained parameter are not tried.

    Raises:
        InputError: no candidate has the constrained parameters.
    """
    problems = _problems(samples, options)
    pilot = samples.pilot(_SAMPLES, options.seed)
    parts, even = _parts(pilot), _parts(_even(samples, pilot, options.seed))
    unit = "image" if len(parts) == samples.groups.images else "band"
    candidates: list[Candidate] = []
    best: _Trial | None = None
    for expression, problem in problems.items():
        progress(f"trying {expression}")
        trial = _tried(expression, problem, parts, even)
        wins, verdict = _verdict(trial, best)
        candidates.append(Candidate(expression, trial.score, trial.relative_rmse, verdict.format(unit=unit)))
        if wins:
            best = trial
    assert best is not None
    return best.expression, candidates


def _problems(samples: Samples, options: Options) -> dict[str, Problem]:
    """The problem of every candidate that has the constrained parameters, by its expression.

    Raises:
        InputError: none has them.
    """
    problems: dict[str, Problem] = {}
    for expression in CANDIDATES:
        with contextlib.suppress(InputError):
            problems[expression] = specify_unknowns(
                expression, options, channels=samples.channels, relative=samples.relative, scene=samples
            ).problem
    if not problems:
        names = ", ".join([*options.fix, *options.free, *options.tie])
        raise InputError(f"no model that 'auto' tries fits what was said of {names}: name the model with --model.")
    return problems


def _tried(expression: str, problem: Problem, parts: Sequence[Batch], even: Sequence[Batch]) -> _Trial:
    """Predict every part from the parts of the other folds.

    Args:
        expression: of the candidate.
        problem: of the candidate.
        parts: samples that carry most of the information.
        even: samples of the same parts in which every usable value counts alike.
    """
    errors, in_noise, sums = np.empty(len(parts)), [], np.zeros(2)
    for fold in range(min(_FOLDS, len(parts))):
        held_out = range(fold, len(parts), _FOLDS)
        solution = fit_batches(problem, [part for k, part in enumerate(parts) if k not in held_out])
        for k in held_out:
            radiance = predict_radiance(solution.problem, solution.unknowns, parts[k])
            errors[k] = _error(radiance, parts[k])
            in_noise.append(_in_noise(radiance, parts[k]))
            even_radiance = predict_radiance(solution.problem, solution.unknowns, even[k])
            sums += squared_errors(even_radiance, even[k].radiance, even[k].noise)
    squares = torch.cat(in_noise)
    relative_rmse = math.sqrt(sums[0] / sums[1]) if sums[1] > 0 else 0.0
    return _Trial(expression, errors, float(squares.mean()), math.sqrt(2 / max(squares.numel(), 1)), relative_rmse)


def _even(samples: Samples, pilot: Sequence[Batch], seed: int) -> list[Batch]:
    """A sample in which every usable value counts alike, one batch per image of the pilot."""
    batch = next(iter(samples.batches(_SAMPLES, shuffle=True, seed=seed)))
    images = samples.groups.image_of(batch)
    wanted = [int(samples.groups.image_of(part)[0]) for part in pilot]
    return [batch[(images == image).nonzero()[:, 0]] for image in wanted]


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
    squares = ((batch.radiance - predicted).square() / batch.variance(predicted)).clamp(max=_LARGEST_SQUARE)
    clipped = batch.noise.clipped
    return (squares if clipped is None else squares[clipped == 0]).flatten()


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
