"""One uniform material: pilot, global search, Levenberg-Marquardt, then all samples."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import torch
from torch import Tensor

from matest.estimators.covariance import fisher
from matest.estimators.levenberg_marquardt import Solution, at_bound, minimise
from matest.estimators.one_step import CLOSE, settled, single_step
from matest.estimators.separable import passes_over, separates
from matest.estimators.starts import (
    ALIKE,
    apart,
    at_ends,
    distance,
    doubtful,
    first_guesses,
    implausibility,
    most_plausible,
    thinned,
)
from matest.estimators.unknowns import Problem
from matest.photographs.patches import Patches
from matest.photographs.pilot import pilot
from matest.photographs.samples import Samples, join
from matest.samples import Batch
from matest.samples.tiles import in_memory
from matest.workers import single_threaded_torch

_PILOT = 24_000
# Expansions of the likelihood about the last optimum, until they move it by less than so many standard errors.
_EXPANSIONS, _SETTLED = 40, 0.05
# One that comes this close to the end of another on its way is left.
_SAME = 0.2
# Steps that are taken without being looked at: so many standard errors, or this share of what the last expansion moved,
# up to one standard error. Were it all of it, such steps could go round in circles.
_CLOSE, _FREE = 0.01, 0.5
# With more outliers than this the search is repeated, at most so many times, with less weight for all that lies far
# from the best solution so far. What it finds closer to that than so many standard errors is the same.
_SPOILT, _SECOND_THOUGHTS, _ELSEWHERE = 0.001, 3, 10.0
# Where a precision is asked for, subsamples grow, with some to spare and not by more than a factor, until they give it,
# or a walk over all samples costs no more.
_FIRST, _SPARE, _LEAP, _SUBSAMPLE = 6_000, 1.2, 100.0, 0.04
# χ² per value of a subsample that the model describes, its noise perhaps estimated from the photographs.
_DESCRIBED = 1.1
_GAUGE_ROUNDS = 6
# Images worked on at once; captures with fewer samples are worked on in two tiles, subsamples with fewer in one.
_GROUP, _SMALL, _ONE_TILE = 4, 1 << 18, 10_000
_PASSES = 60

Progress = Callable[[str], None]


@single_threaded_torch()
def fit_batches(problem: Problem, batches: list[Batch], start: Tensor | None = None) -> Solution:
    """The optimum on a few thousand samples held in memory.

    Args:
        problem: what is estimated.
        batches: the samples.
        start: u [P] near the optimum; None: searched for globally, no initial guess is needed.
    """
    # Few large tiles: every call costs as much as a thousand samples.
    size = sum(len(batch) * batch.points.wi.shape[-2] for batch in batches)
    half = len(batches) if size < _ONE_TILE else (len(batches) + 1) // 2
    tiles = [replace(join(group), kept={}) for group in (batches[:half], batches[half:]) if group]

    def descend(problem: Problem, start: Tensor, reference: Tensor, tolerance: float) -> Solution:
        misfit, expanded = settled(problem, tiles, reference)
        evaluate = passes_over(problem, in_memory(expanded), start, None, misfit)
        found = minimise(problem, start, evaluate, passes=_PASSES, tolerance=tolerance)
        return replace(found, misfit=misfit)

    def settle(guesses: Sequence[Solution]) -> list[Solution]:
        """The distinct optima that guesses lead to."""
        optima: list[Solution] = []

        def known(found: Solution) -> bool:
            return any(apart(other, found) < _SAME and at_ends(other) <= at_ends(found) for other in optima)

        for found in guesses:
            moved = 1.0
            for _ in range(_EXPANSIONS):
                # The next expansion moves the optimum again: no use in knowing this one much better than that.
                tolerance = min(max(_FREE * moved, _CLOSE), 1.0)
                before, found = found, descend(found.problem, found.unknowns, found.unknowns, tolerance)
                moved = distance(found, before)
                if moved < _SETTLED or known(found):
                    break
            if not known(found):
                optima.append(found)
        return optima

    best = most_plausible(settle(first_guesses(problem, batches, start)))
    for _ in range(_SECOND_THOUGHTS if start is None and best.statistics.outliers > _SPOILT else 0):
        # Outliers had bent the first guess: once they are known for what they are, the search may end elsewhere.
        before = best
        again = first_guesses(best.problem, [doubtful(best, thinned(batches))], None)
        best = most_plausible([before, *settle([guess for guess in again if apart(before, guess) > _ELSEWHERE])])
        if implausibility(best) > implausibility(before) - ALIKE * before.misfit**2:
            break
    for _ in range(_GAUGE_ROUNDS if problem.gauges else 0):
        # The limit was taken from a fit without the second bounce, which makes albedos too bright and it too low.
        limit = best.problem.limit_of_gauges(best.unknowns)
        if abs(limit / best.problem.gauge_limit - 1) < 1e-6:
            break
        wider = replace(best.problem, gauge_limit=limit)
        best = descend(wider, torch.minimum(best.unknowns, wider.upper), best.unknowns, _CLOSE)
    ordered = best.problem.ordered(best.unknowns)
    if not torch.equal(ordered, best.unknowns):
        best = descend(best.problem, ordered, ordered, _CLOSE)
    return replace(best, tiles=in_memory(tiles))


def fit(
    problem: Problem,
    samples: Samples,
    seed: int,
    progress: Progress = lambda _: None,
    start: Tensor | None = None,
    precision: float = 0.0,
) -> Solution:
    """The maximum-likelihood estimate from all samples: from the pilot's optimum, passes over everything.

    From there one Gauss-Newton step has the full efficiency; where it might not, a second pass follows. The likelihood
    stays expanded about the pilot's optimum: that need not be exact, and makes its cost one that passes can be compared
    by.

    Args:
        problem: what is estimated.
        samples: all of them.
        seed: of the pilot's random draw.
        progress: called with a word on what is being done.
        start: u [P] near the optimum; None: searched for globally.
        precision: a subsample is enough once it gives every parameter a relative standard error below this, if the
            model describes it: otherwise errors do not fall with the number of samples.
    """
    progress("searching")
    drawn = _FIRST if precision > 0 else _PILOT
    found = fit_batches(problem, pilot(samples, drawn, seed), start)
    while (enough := _described(found)) and (error := largest_relative_std(found)) > precision > 0:
        # Errors fall with the root of the number of samples.
        wanted = math.ceil(min(_SPARE * (error / precision) ** 2, _LEAP) * drawn)
        if wanted > _SUBSAMPLE * len(samples):
            break
        drawn = wanted
        found = fit_batches(found.problem, pilot(samples, drawn, seed), found.unknowns)
    if not enough or error > precision:
        if drawn < _PILOT:
            # As without a precision: where the model does not hold, what is an outlier hangs on the pilot.
            found = fit_batches(problem, pilot(samples, _PILOT, seed), start)
        progress("refining over all samples")
        reference, misfit = found.unknowns, found.misfit
        tiles = AllTiles(samples, merge=True, misfit=misfit)
        evaluate = passes_over(found.problem, tiles, reference, reference, misfit)
        first = evaluate(reference)
        one_step = None if separates(found.problem) else single_step(found, first)
        found = one_step or minimise(found.problem, reference, evaluate, passes=_PASSES, tolerance=CLOSE, first=first)
        found = replace(found, misfit=misfit, tiles=tiles)
    return replace(found, unknowns=found.problem.wrapped(found.unknowns))


def _described(found: Solution) -> bool:
    """Whether the model describes a subsample to its noise."""
    by_chance = math.sqrt(2 / max(found.statistics.total("values"), 1))
    return found.statistics.reduced_chi2 < _DESCRIBED + 5 * by_chance


def largest_relative_std(found: Solution) -> float:
    """The largest relative standard error of the unknowns that are determined and not at a bound."""
    problem, statistics = found.problem, found.statistics
    free = ~at_bound(problem, found.unknowns, statistics.gradient)
    covariance = fisher(statistics.information / statistics.misfit, free)
    counted = free & ~covariance.undetermined
    for name in problem.gauges:
        counted[problem.where[name]] = False
    return float((covariance.std / found.unknowns.abs())[counted].max()) if bool(counted.any()) else math.inf


@dataclass(frozen=True)
class AllTiles:
    """Every sample, a few images at a time and tile by tile, computed when a worker asks for it.

    Attributes:
        samples: all of them.
        merge: let a few samples stand for every smooth patch of pixels (`Patches`).
        misfit: see `Batch.working`.
    """

    samples: Samples
    merge: bool = False
    misfit: float = 1.0

    @cached_property
    def patches(self) -> Patches:
        return Patches(self.samples, self.misfit, merge=self.merge)

    def __iter__(self) -> Iterator[list[Callable[[], Batch]]]:
        images, patches = range(len(self.samples.images)), self.patches
        tiles = [[partial(patches.batch, k, part) for part in range(patches.parts(k))] for k in images]
        if not patches.layout.patches.size and len(self.samples) < _SMALL:
            # Every tile costs as much as a thousand samples: few large ones.
            half = (len(images) + 1) // 2
            yield [partial(_joined, own) for own in (tiles[:half], tiles[half:]) if own]
            return
        for first in range(0, len(images), _GROUP):
            yield [tile for own in tiles[first : first + _GROUP] for tile in own]
            for k in images[first : first + _GROUP]:
                self.samples.photographs.release(self.samples.images[k])


def _joined(tiles: Sequence[Sequence[Callable[[], Batch]]]) -> Batch:
    parts = [tile() for own in tiles for tile in own]
    return join([part for part in parts if len(part)] or parts[:1])
