"""Which model a capture supports where every pixel has values of its own: photographs left out of a fit tell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from matest.errors import InputError
from matest.estimation.comparison import describes, judge_trials, score
from matest.estimation.mapping import mappable, mapped_names
from matest.estimation.options import Options
from matest.estimation.result import Candidate
from matest.estimation.selection import none_fits
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
# Parts of the photographs that are left out in turn, at most.
_FOLDS = 4
# Fewest photographs: what is common to all pixels needs two beside the one that is predicted.
FEWEST_IMAGES = 3
# Relative standard error of parameters in common that suffices to start from.
_PRECISION = 0.02


@dataclass(frozen=True)
class MapSelection:
    """The model that predicts photographs left out best, and all that were tried.

    Attributes:
        expression: of the model.
        candidates: the record of the comparison.
    """

    expression: str
    candidates: Sequence[Candidate]


def select_mapped(samples: CalibratedSamples, options: Options, progress: Progress) -> MapSelection:
    """The smallest candidate that no later one beats, by the rules of `judge_trials`; every photograph is left out.

    Args:
        samples: to fit.
        options: `maps` names the parameters.
        progress: called with a word on what is being done.

    Raises:
        InputError: no candidate has the constrained parameters, or those of the maps.
    """
    problems, unfit, unmapped = {}, [], []
    for expression in CANDIDATES:
        try:
            problem = specify_unknowns(
                expression, options, channels=samples.channels, relative=samples.relative, scene=samples
            ).problem
        except InputError as error:
            unfit.append(str(error))
            continue
        try:
            problems[expression] = problem, [name for word in options.maps for name in mapped_names(problem, word)]
        except InputError as error:
            unmapped.append((problem, str(error)))
    if not problems:
        raise InputError(_none_has_maps(options, unmapped) if unmapped else none_fits(options, unfit))
    trials = []
    for expression, (problem, names) in problems.items():
        progress(f"trying {expression}")
        trials.append(_tried(expression, problem, names, samples, options.seed))
    best, reasons = judge_trials(trials)
    candidates = [
        Candidate(trial.expression, score(trial), trial.relative, reason.format(unit="image"), chosen=trial is best)
        for trial, reason in zip(trials, reasons, strict=True)
    ]
    return MapSelection(best.expression, candidates)


def _none_has_maps(options: Options, unmapped: Sequence[tuple[Problem, str]]) -> str:
    """Why no model has the maps, and what to do."""
    words = ",".join(options.maps)
    names = sorted({name.rpartition(".")[2] for problem, _ in unmapped for name in mappable(problem)})
    return (
        f"--maps {words}: no model that 'auto' tries can have these maps; name some of {', '.join(names)}, which one "
        "model has, or the model with --model."
    )


@dataclass(frozen=True, eq=False)
class _Trial:
    """A candidate, and its errors on photographs left out.

    Attributes:
        expression: of the model.
        costs: squared errors on each photograph, in units of the noise.
        values: number of values.
        holds: whether the model meets the photographs that were not left out to their noise.
        relative: rms error over rms signal.
    """

    expression: str
    costs: Tensor
    values: int
    holds: bool
    relative: float


@single_threaded_torch()
def _tried(expression: str, problem: Problem, mapped: Sequence[str], samples: CalibratedSamples, seed: int) -> _Trial:
    """The errors of some texels on every photograph, when it was left out of their fit."""
    start = fit(problem, samples, seed, precision=_PRECISION)
    texels = TexelUnknowns(start.problem, tuple(name for name in problem.free if name in mapped))
    images, few = range(len(samples.account.images)), samples.some_texels(_TEXELS, seed)
    costs, sums, chi2 = torch.zeros(len(images), dtype=torch.float64), [], []
    with torch.no_grad():
        for fold in range(min(_FOLDS, len(images))):
            left_out = images[fold::_FOLDS]
            rest = few.of_images([image for image in images if image not in left_out])
            sample = descend(texels, started(texels.without_shapes(), start.unknowns, rest), rest)
            model, theta = texel_model(texels, sample.fitter.unknowns), sample.fit.theta
            chi2.append(sample.inflation)
            for image in left_out:
                tile = few.of_images([image])
                values = radiance(model.columns(tile, theta), model.coefficients(theta), 1)
                sums.append(totals(tile, tile.about(values, sample.residual_scale), values).sum(0))
                costs[image] = sums[-1][SCORES.index("chi2")]
    total = dict(zip(SCORES, torch.stack(sums).sum(0).tolist(), strict=True))
    count = int(total["values"])
    relative = math.sqrt(total["squared_residual"] / total["squared_signal"]) if total["squared_signal"] else math.inf
    return _Trial(expression, costs, count, describes(max(chi2), count), relative)
