"""Which model a capture supports where every pixel has values of its own: photographs left out of a fit tell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import torch

from matest.errors import InputError
from matest.estimation.mapping import mapped_names
from matest.estimation.options import Options
from matest.estimation.result import Candidate
from matest.estimation.specification import specify_unknowns
from matest.estimators import Problem, fit
from matest.estimators.moments import SCORES
from matest.estimators.texels.models import radiance, texel_model
from matest.estimators.texels.some import descend, started
from matest.estimators.texels.trust import totals
from matest.estimators.texels.unknowns import TexelUnknowns
from matest.progress import Progress
from matest.samples.account import CalibratedSamples
from matest.workers import single_threaded_torch

if TYPE_CHECKING:
    from matest.capture import Capture

# Bodies alone and under a lobe of either distribution: what differs from pixel to pixel leaves finer choices open.
CANDIDATES = (
    "lambert",
    "oren-nayar",
    "cook-torrance",
    "cook-torrance(distribution=ggx)",
    "oren-nayar+cook-torrance",
    "oren-nayar+cook-torrance(distribution=ggx)",
)
# Texels that candidates are compared on.
_TEXELS = 400
# Of so many photographs one is left out.
_FOLD = 4
# Fewest photographs of which one can be left out.
FEWEST_IMAGES = 4
# Relative standard error of parameters in common that suffices to start from.
_PRECISION = 0.02
# A larger model has to predict by this factor better.
_BETTER = 0.99
# Errors that differ by less are the same to people.
_ALIKE = 1.005


@dataclass(frozen=True)
class MapSelection:
    """The model that predicts photographs left out best, and all that were tried.

    Attributes:
        expression: of the model.
        candidates: the record of the comparison.
    """

    expression: str
    candidates: Sequence[Candidate]


def select_mapped(capture: Capture, samples: CalibratedSamples, options: Options, progress: Progress) -> MapSelection:
    """The smallest candidate that no later one predicts better than.

    Args:
        capture: that the samples are of.
        samples: to fit.
        options: `maps` names the parameters.
        progress: called with a word on what is being done.

    Raises:
        InputError: no candidate has the parameters of the maps.
    """
    images = list(samples.account.images)
    left_out = images[1::_FOLD]
    rest = [image for image in images if image not in left_out]
    trials: list[_Trial] = []
    refusal = InputError("")
    for expression in CANDIDATES:
        progress(f"trying {expression}")
        try:
            specification = specify_unknowns(
                expression, options, channels=samples.channels, relative=samples.relative, scene=samples
            )
            names = [name for word in options.maps for name in mapped_names(specification.problem, word)]
        except InputError as error:
            refusal = error
            continue
        trials.append(_Trial(expression, *_errors(capture, specification.problem, names, rest, left_out, options)))
    if not trials:
        raise refusal
    best = trials[0]
    for trial in trials[1:]:
        if trial.relative < _BETTER * best.relative:
            best = trial
    candidates = [
        Candidate(trial.expression, trial.score, trial.relative, _reason(trial, best), chosen=trial is best)
        for trial in trials
    ]
    return MapSelection(best.expression, candidates)


class _Trial(NamedTuple):
    """A candidate and its errors on photographs left out: in units of the noise, and relative to the signal."""

    expression: str
    score: float
    relative: float


def _reason(trial: _Trial, best: _Trial) -> str:
    if trial is best:
        return "the smallest that predicts photographs left out as well as any"
    if trial.relative <= best.relative:
        return "larger, and hardly better"
    if trial.relative < _ALIKE * best.relative:
        return "predicts photographs left out no better"
    return f"photographs left out err {trial.relative / best.relative:.2f} times as much"


@single_threaded_torch()
def _errors(
    capture: Capture,
    problem: Problem,
    mapped: Sequence[str],
    rest: Sequence[int],
    left_out: Sequence[int],
    options: Options,
) -> tuple[float, float]:
    """The errors of some texels on photographs left out of their fit: in units of the noise, and relative."""
    fitted, unseen = (capture.photographs.samples(images, distinct=True) for images in (rest, left_out))
    start = fit(problem, fitted, options.seed, precision=_PRECISION)
    texels = TexelUnknowns(start.problem, tuple(name for name in problem.free if name in mapped))
    with torch.no_grad():
        some = fitted.some_texels(_TEXELS, options.seed)
        sample = descend(texels, started(texels.without_shapes(), start.unknowns, some), some)
        tile = unseen.some_texels(_TEXELS, options.seed)
        model, theta = texel_model(texels, sample.fitter.unknowns), sample.fit.theta
        values = radiance(model.columns(tile, theta), model.coefficients(theta), tile.images)
        sums = totals(tile, tile.about(values, sample.residual_scale), values).sum(0)
    names = ("squared_residual", "squared_signal", "chi2", "values")
    squared, signal, chi2, count = (float(sums[SCORES.index(name)]) for name in names)
    if not (signal > 0 and count):
        return math.inf, math.inf
    return math.sqrt(chi2 / count), math.sqrt(squared / signal)
