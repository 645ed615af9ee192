"""What is wrong with a capture: the errors that would explain what a fit leaves, one after the other."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch

from matest.estimation.calibration import centred, families_of
from matest.estimators import Problem, Solution
from matest.estimators.covariance import fisher
from matest.estimators.pilot import follow
from matest.inference.budget import by_image
from matest.inference.score_sums import ScoreSums, score_sums
from matest.inference.suspects import Suspect, alike, suspects
from matest.progress import Progress, silent
from matest.samples import Tile
from matest.samples.account import CalibratedSamples
from matest.samples.calibration import Family
from matest.workers import single_threaded_torch

# Samples that a diagnosis is made on, and pixels at least: of each the samples of all images.
_SAMPLES, _PIXELS = 8_000, 100
# Samples times directions of light, at most: under a map of 256 directions a quarter of the samples do.
_SHADED = 512_000
# Causes that are looked for: more of them together explain anything.
_MOST_CAUSES = 4
# Standard errors up to which a number is zero by chance.
_CHANCE_DEVIATIONS = 4.0
# Variance, pixels², up to which a blur is that of a pixel's own area, 1/12, and of what interpolation adds.
_PIXEL_AREA = 0.2
# Families that a wrong estimate of the noise near black looks like, and χ² per value that they have to explain then.
_OFFSETS, _LEAST_OFFSET_GAIN = ("ambient", "black"), 0.05
# Families of single pixels, by that of the smooth fields whose rest they may be; as large a share of it is no more.
_RESTS, _REST = {"normal_noise": "normals", "albedo_noise": "albedo_field"}, 0.25
# Share of the misfit that a cause explains to be worth a word.
_LEAST_SHARE = 0.01


@dataclass(frozen=True)
class Cause:
    """Errors that explain residuals.

    Attributes:
        family: of the calibration, or what the model lacks.
        size: of the only unknown of the family, or the rms of the errors as a whole; in the family's unit.
            None: of what the model lacks.
        std: standard error of the only unknown; None: there are several.
        unit: "1", "rad", "px", "px²".
        chi2_before, chi2_after: per value, without and with it.
        refinable: whether they can be estimated with the material.
        others: families that would explain the same about as well.
        rivals: those of them that have no more unknowns than it, by order of magnitude.
        refined: whether they have been.
        largest: size beyond which errors are none of a calibration.
    """

    family: str
    size: float | None
    std: float | None
    unit: str
    chi2_before: float
    chi2_after: float
    refinable: bool
    others: Sequence[str]
    rivals: Sequence[str]
    refined: bool = False
    largest: float = math.inf

    @property
    def is_chance(self) -> bool:
        """Whether it is zero to its standard error."""
        return self.size is not None and self.std is not None and abs(self.size) < _CHANCE_DEVIATIONS * self.std

    @property
    def is_pixel_area(self) -> bool:
        """Whether it is no fault: every photograph averages over its pixels, and a model is shaded at their centres."""
        return self.family == "blur" and self.size is not None and 0 < self.size < _PIXEL_AREA

    @property
    def is_plausible(self) -> bool:
        """Whether a calibration may be off by so much."""
        return self.size is None or abs(self.size) < self.largest

    @property
    def gain(self) -> float:
        """χ² per value that they take away."""
        return self.chi2_before - self.chi2_after


@single_threaded_torch()
def causes(solution: Solution, samples: CalibratedSamples, seed: int, progress: Progress = silent) -> list[Cause]:
    """The errors that explain what a fit leaves, the first of which explains most.

    After each the material is fitted with it, on some of the samples, before the next is looked for.

    Args:
        solution: of the fit.
        samples: that were fitted.
        seed: of the random draw of samples.
        progress: called with a word on what is being done.
    """
    progress("looking for causes of residuals")
    count = min(_SAMPLES, _SHADED // max(samples.directions, 1))
    batch, _ = samples.of_pixels(max(count // max(samples.groups.images, 1), _PIXELS), seed)
    search = _Search(samples, Tile(by_image(batch, samples.groups), cache={}))
    start = last = search.at(solution)
    found: list[Cause] = []
    while len(found) < _MOST_CAUSES and (step := search.step(last)):
        if step.after is None:
            return found if _is_rest(step.cause, last.solution) else [*found, step.cause]
        cause, misfit = step.cause, (found[0] if found else step.cause).chi2_before - 1
        if cause.gain < _LEAST_SHARE * misfit or cause.is_chance or not cause.is_plausible:
            break
        if cause.family in _OFFSETS and not samples.noise_stated and cause.gain < _LEAST_OFFSET_GAIN:
            break
        found.append(cause)
        last = step.after
    return search.second_thoughts(found, start, last)


class _Fitted(NamedTuple):
    """A fit with the sums of every family that is not in it."""

    solution: Solution
    sums: ScoreSums


class _Step(NamedTuple):
    """A cause, and the fit with its errors; None: they are no unknowns of a fit."""

    cause: Cause
    after: _Fitted | None


class _Search:
    """Looks for causes on some samples, which a tile holds."""

    def __init__(self, samples: CalibratedSamples, tile: Tile) -> None:
        self._samples = samples
        self._tile = tile

    def at(self, solution: Solution) -> _Fitted:
        """A solution with its sums."""
        families = families_of(self._samples, solution.problem)
        rest = {name: family.assumed for name, family in families.items() if name not in solution.problem.spreads}
        problem = self._with(solution.problem, {**_spreads(solution.problem), **rest})
        return _Fitted(solution, score_sums(solution, problem, self._tile.batch))

    def step(self, fitted: _Fitted) -> _Step | None:
        """The errors that explain most of what a fit leaves."""
        if not (ranked := suspects(fitted.sums)):
            return None
        choice = alike(ranked)
        named = choice[0]
        family = families_of(self._samples, fitted.solution.problem).get(named.name)
        if family is None or family.of_pixels:
            return _Step(_without_refit(choice, family, fitted.sums), None)
        own = _spreads(fitted.solution.problem)
        inflation = (fitted.sums.cost - named.gain) / fitted.sums.values
        after = self._fit(fitted, {**own, named.name: named.spread / family.spread}, inflation)
        return _Step(_after_refit(choice, family, fitted.sums, after), after)

    def second_thoughts(self, found: list[Cause], start: _Fitted, last: _Fitted) -> list[Cause]:
        """The causes with the first replaced by one that explains more beside the others, if there is one."""
        if len(found) < 2 or not found[0].others:
            return found
        first, *rest = found
        spreads = {name: spread for name, spread in _spreads(last.solution.problem).items() if name != first.family}
        without = self._fit(last, spreads, last.sums.chi2)
        step = self.step(without)
        if step is None or step.after is None or step.cause.family not in first.others:
            return found
        return [replace(step.cause, chi2_before=start.sums.chi2, chi2_after=first.chi2_after), *rest]

    def _fit(self, fitted: _Fitted, spreads: Mapping[str, float], inflation: float) -> _Fitted:
        """The fit with the errors of these families, by name the standard deviation of each as a whole."""
        before = fitted.solution
        problem = self._with(before.problem, spreads)
        start = problem.anywhere.clone()
        for name, place in before.problem.where.items():
            if name in problem.where:
                start[problem.where[name]] = before.unknowns[place]
        # One expansion of the likelihood: errors that are left by it are far below those that are looked for.
        problem = replace(problem, inflation=max(inflation, 1.0))
        return self.at(follow(problem, start, [self._tile], expansions=1))

    def _with(self, problem: Problem, spreads: Mapping[str, float]) -> Problem:
        """A problem with the errors of these families."""
        return problem.calibrated(
            self._samples.calibration([*spreads]), spreads, self._samples.groups, centred(self._samples)
        )


def _is_rest(cause: Cause, solution: Solution) -> bool:
    """Whether errors of single pixels are what a smooth field that was fitted leaves."""
    problem, smooth = solution.problem, _RESTS.get(cause.family)
    if cause.size is None or smooth not in problem.spreads:
        return False
    field = solution.unknowns[problem.where[smooth]]
    return cause.size < _REST * float(field.square().mean().sqrt()) / problem.family(smooth).spread


def _spreads(problem: Problem) -> dict[str, float]:
    """The standard deviation of the errors of each family as a whole."""
    return {name: spread / problem.family(name).spread for name, spread in problem.spreads.items()}


def _without_refit(choice: Sequence[Suspect], family: Family | None, sums: ScoreSums) -> Cause:
    """Errors of single pixels, or of the model: no unknowns of a fit."""
    named = choice[0]
    return Cause(
        family=named.name,
        size=None if family is None else named.spread / family.spread,
        std=None,
        unit="1" if family is None else family.unit,
        chi2_before=sums.chi2,
        chi2_after=(sums.cost - named.gain) / sums.values,
        refinable=False,
        others=_names(choice),
        rivals=_rivals(choice),
    )


def _after_refit(choice: Sequence[Suspect], family: Family, before: ScoreSums, after: _Fitted) -> Cause:
    """Errors at their values in a fit with them."""
    solution = after.solution
    place, statistics = solution.problem.where[family.name], solution.statistics
    errors, alone = solution.unknowns[place], family.count == 1
    everything = torch.ones(len(solution.unknowns), dtype=torch.bool)
    std = fisher(statistics.information / statistics.inflation, everything).std[place]
    return Cause(
        family=family.name,
        size=float(errors[0]) if alone else float(errors.square().mean().sqrt()) / family.spread,
        std=float(std[0]) if alone else None,
        unit=family.unit,
        chi2_before=before.chi2,
        chi2_after=after.sums.chi2,
        refinable=True,
        others=_names(choice),
        rivals=_rivals(choice),
        largest=family.largest,
    )


def _names(choice: Sequence[Suspect]) -> list[str]:
    """Of those beside the first."""
    return [one.name for one in choice[1:]]


def _rivals(choice: Sequence[Suspect]) -> list[str]:
    """Of those beside the first that have as few unknowns."""
    return [one.name for one in choice[1:] if one.order <= choice[0].order]
