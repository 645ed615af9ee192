"""Which model the images support: a bigger one must predict images left out of the fit better."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from matest.errors import InputError
from matest.estimation.comparison import Trial, is_enough, judge_trials
from matest.estimation.options import AUTO_ANY_DISTRIBUTION, Options
from matest.estimation.recipes import DISTRIBUTIONS, LAST_LEVEL_OF_ALL, RECIPES, Component, Recipe
from matest.estimation.result import Candidate
from matest.estimation.specification import specify_unknowns
from matest.estimators import Problem
from matest.estimators.leave_out import leave_out
from matest.estimators.mixture import Field, Mixture
from matest.estimators.one_step import expand_likelihood
from matest.progress import Progress, silent
from matest.samples import Batch, Samples, Tile
from matest.samples.batch import join
from matest.workers import single_threaded_torch

# Samples that candidates are compared on: enough to tell them apart by one per cent of the error.
_SAMPLES = 8_000
# The same where every usable value counts alike: for the relative error of each candidate.
_EVEN_SAMPLES = 4_000
# The last level of recipes whose columns the mixture has: recipes beyond refine what these can only mix.
_MIXED_LEVEL = 2
# χ² that a mixture's many columns take from the noise, in units of the residuals: about one for each that counts.
_MIXTURE_FREEDOM = 60.0
# Misfit, as a share of the signal, beside which the columns that the last levels add to those of the first are not
# seen: they differ from the nearest mixture of these by less than one per cent of the signal.
_GROSS_MISFIT = 0.05
# A model that a grid shows to be this many times worse than the best one on it is not refined.
_HOPELESS_RATIO = 30.0
# Models that are this many times worse than the closest one are no contenders.
_CONTENDER_RATIO = 4.0
# Fewer images than this: bands of images are left out instead.
_MIN_IMAGES = 3
# Horizontal bands of an image, so that one image gives every fit a part to leave out.
_BANDS = 4


@dataclass(frozen=True, eq=False)
class Selection:
    """The candidates that were tried, and the best of them.

    Attributes:
        best: the smallest candidate that no later one beats.
        trials: in the order of the recipes.
        reasons: why each one was chosen or not.
        unit: what was left out in turn: "image", "band" (of an image) or, in a table, "incidence".
        mixture_error: of single values, in units of the noise, for a free mixture of the columns of all candidates.
        unfit: expressions of the recipes that could not be tried.
        relative: whether the strength of the lights is unknown, which no metal without diffuse light can take up.
    """

    best: Trial
    trials: Sequence[Trial]
    reasons: Sequence[str]
    unit: str
    mixture_error: float
    unfit: Sequence[str]
    relative: bool

    @property
    def candidates(self) -> list[Candidate]:
        """The record of the comparison."""
        return [
            Candidate(
                trial.recipe.expression,
                trial.score,
                trial.relative_rmse,
                reason.format(unit=self.unit),
                chosen=trial is self.best,
            )
            for trial, reason in zip(self.trials, self.reasons, strict=True)
        ]

    @property
    def unsupported(self) -> list[str]:
        """Components that candidates have and the best one does without."""
        tried = {component for trial in self.trials for component in trial.recipe.components}
        return [component.value for component in Component if component in tried - self.best.recipe.components]


@dataclass(frozen=True, eq=False)
class _Pilot:
    """Samples that candidates are compared on.

    Attributes:
        tile: most of the information; the labels of its groups are the parts.
        even: every usable value counts alike; labels likewise.
        parts: number of parts.
        unit: what a part is.
    """

    tile: Tile
    even: Batch
    parts: int
    unit: str

    @property
    def has_clipped(self) -> bool:
        """Whether the sensor clipped any of the samples."""
        clipped = self.tile.batch.noise.clipped
        return clipped is not None and bool(clipped.any())


def select(samples: Samples, options: Options, progress: Progress = silent) -> Selection:
    """Fit candidates level by level to a pilot, until no mixture of their columns does better than one of them.

    Candidates that lack a constrained parameter, or anything that could take up an unknown scale of the lights, are not
    tried.

    Raises:
        InputError: no candidate has the constrained parameters.
    """
    problems = _problems(samples, options)
    progress("searching")
    with single_threaded_torch():
        pilot = _pilot(samples, options.seed)
        first = {recipe: problem for recipe, problem in problems.items() if recipe.level <= _MIXED_LEVEL} or problems
        with torch.no_grad():
            field = all_columns = Field([*first.values()], pilot.tile)
            mixture = field.mixture(pilot.tile)
        trials: list[Trial] = []
        for level, group in itertools.groupby(problems, lambda recipe: max(recipe.level, LAST_LEVEL_OF_ALL)):
            if trials and not _is_needed(level, trials, mixture, all_columns, pilot, options):
                continue
            recipes = [*group]
            if recipes[0] not in first:
                first = {recipe: problems[recipe] for recipe in recipes}
                with torch.no_grad():
                    field = Field([*first.values()], pilot.tile, mixture.squares)
            trials += _compete(recipes, [*first], field, mixture, pilot, progress)
        if pilot.has_clipped:
            trials = _about_closest(trials, pilot)
        trials = [replace(trial, relative_rmse=trial.left_out.relative_rmse(pilot.even)) for trial in trials]
    best, reasons = judge_trials(trials)
    mixture_error = math.sqrt(mixture.cost / max(mixture.values, 1))
    last = max(trial.recipe.level for trial in trials)
    unfit = [recipe.expression for recipe in RECIPES if recipe not in problems and recipe.level <= last]
    return Selection(best, trials, reasons, pilot.unit, mixture_error, unfit, samples.relative)


def _problems(samples: Samples, options: Options) -> dict[Recipe, Problem]:
    """The problem of every candidate that has the constrained parameters.

    Raises:
        InputError: none has them.
    """
    problems: dict[Recipe, Problem] = {}
    reasons: list[str] = []
    for recipe in RECIPES:
        try:
            problems[recipe] = specify_unknowns(
                recipe.expression, options, channels=samples.channels, relative=samples.relative, scene=samples
            ).problem
        except InputError as error:
            reasons.append(str(error))
    if not problems:
        raise InputError(none_fits(options, reasons))
    return problems


def none_fits(options: Options, reasons: Sequence[str]) -> str:
    """Why no model takes what was said of its parameters, from the refusals of all, and what to do."""
    names = ", ".join([*options.fix, *options.free, *options.tie])
    # That a model lacks a parameter says less than what is wrong with its value in a model that has it.
    telling = [reason for reason in reasons if "has no parameter" not in reason] or reasons
    return (
        f"no model that 'auto' tries takes what was said of {names} ({telling[0].rstrip('.')}): correct it, or name "
        "the model with --model."
    )


def _compete(
    recipes: Sequence[Recipe],
    members: Sequence[Recipe],
    field: Field,
    mixture: Mixture,
    pilot: _Pilot,
    progress: Progress,
) -> list[Trial]:
    """Fit some of the candidates that a field has; those that their grids show to be hopeless only roughly."""
    searches = {recipe: field.search(members.index(recipe)) for recipe in recipes}
    lowest = min(field.cost(search) for search in searches.values())
    trials = []
    for recipe, search in searches.items():
        progress(f"trying {recipe.expression}")
        hopeless = field.cost(search) > _HOPELESS_RATIO * lowest
        left_out = leave_out(
            search.problem, mixture.tile, search.starts(1)[0], mixture.residual_scale, pilot.parts, not hopeless
        )
        trials.append(Trial(recipe, left_out, mixture.values))
    return trials


def _about_closest(trials: Sequence[Trial], pilot: _Pilot) -> list[Trial]:
    """The trials with the likelihood expanded about the closest of them, in the place of the mixture.

    What clipped values say bends with the distance from where it is expanded, and the mixture has the nodes alone.
    """
    closest = min(trials, key=lambda trial: trial.left_out.cost)
    problem, unknowns = closest.left_out.problem, closest.left_out.unknowns
    residual_scale, (tile,) = expand_likelihood(problem, [pilot.tile], unknowns)
    renewed = []
    for trial in trials:
        left_out = trial.left_out
        if left_out.cost < _CONTENDER_RATIO * closest.left_out.cost:
            left_out = leave_out(left_out.problem, tile, left_out.unknowns, residual_scale, pilot.parts)
        renewed.append(replace(trial, left_out=left_out))
    return renewed


def _is_needed(
    level: int, trials: Sequence[Trial], mixture: Mixture, field: Field, pilot: _Pilot, options: Options
) -> bool:
    """Whether models of a level may be better than those tried, for the likelihood expanded about the mixture."""
    if level == DISTRIBUTIONS and options.model == AUTO_ANY_DISTRIBUTION:
        return True
    best, _ = judge_trials(trials)
    if _misfit(best, pilot) > _GROSS_MISFIT:
        # What a model of few columns could predict clearly better, a free mixture of many does too.
        return is_enough(float(field.costs_left_out(mixture).sum()), best)
    if pilot.has_clipped:
        trials = _about_closest(trials, pilot)
    if level == DISTRIBUTIONS and any(trial.holds for trial in trials):
        return False
    return not any(_explains(trial, mixture, pilot) for trial in trials)


def _misfit(trial: Trial, pilot: _Pilot) -> float:
    """The error of a trial beyond the noise, as a share of the signal; 0 where it holds."""
    if trial.holds:
        return 0.0
    beyond_noise = max(1 - trial.values / float(trial.costs.sum()), 0.0)
    return trial.left_out.relative_rmse(pilot.even) * math.sqrt(beyond_noise)


def _explains(trial: Trial, mixture: Mixture, pilot: _Pilot) -> bool:
    """Whether a model comes as close as the mixture, but for what the freedom of that takes from the noise.

    Where values are clipped, what they cost about the mixture is not what they cost about a model: it has to hold.
    """
    scale = max(mixture.cost / max(mixture.values, 1), 1.0)
    is_close = trial.left_out.cost - mixture.cost < _MIXTURE_FREEDOM * scale
    return is_close and (trial.holds or not pilot.has_clipped)


def _pilot(samples: Samples, seed: int) -> _Pilot:
    pilot = samples.pilot(_SAMPLES, seed)
    parts, even = _parts(pilot), _parts(_even(samples, pilot, seed))
    unit = "image" if len(parts) == samples.groups.images else "band"
    return _Pilot(Tile(join(_labelled(parts)), cache={}), join(_labelled(even)), len(parts), unit)


def _labelled(parts: Sequence[Batch]) -> list[Batch]:
    """The same batches with their positions as the labels of their groups."""
    return [
        replace(part, groups=torch.full((len(part),), position, dtype=torch.int64))
        for position, part in enumerate(parts)
    ]


def _even(samples: Samples, pilot: Sequence[Batch], seed: int) -> list[Batch]:
    """A sample in which every usable value counts alike, one batch per image of the pilot."""
    batch = next(iter(samples.batches(_EVEN_SAMPLES, shuffle=True, seed=seed)))
    images = samples.groups.image_of(batch)
    wanted = [int(samples.groups.image_of(part)[0]) for part in pilot]
    return [batch[(images == image).nonzero()[:, 0]] for image in wanted]


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
