"""One uniform material: pilot, global search, Levenberg-Marquardt, then all samples."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial

import torch
from torch import Tensor

from matest.capture import Batch, Samples
from matest.capture.batch import REJECTED, TRUSTED, Readout
from matest.capture.patches import Patches
from matest.estimators.levenberg_marquardt import Evaluate, Solution, at_bound, minimise
from matest.estimators.linearise import Linearisation, accumulate
from matest.estimators.pilot import pilot
from matest.estimators.problem import Problem
from matest.estimators.search import search
from matest.estimators.separable import compress, separates, statistics
from matest.estimators.walk import Tiles, in_memory, single_threaded_torch
from matest.uncertainty import fisher

_PILOT, _SEARCH = 24_000, 4_000
# Expansions of the likelihood about the last optimum, until they move it by less than so many standard errors.
_EXPANSIONS, _SETTLED = 40, 0.05
# First guesses further apart are followed each to its end.
_DISTINCT = 1.0
# With more outliers than this the search is repeated, at most so many times, with less weight for all that lies further
# than so many standard deviations from the best solution so far. What it finds closer to that than so many standard
# errors is the same.
_SPOILT, _SECOND_THOUGHTS, _HUBER, _ELSEWHERE = 0.001, 3, 2.0, 10.0
# Subsamples grow by this factor until they are precise enough, or a walk over all samples costs no more.
_GROWTH, _SUBSAMPLE = 4, 0.1
# χ² of solutions along a valley of the likelihood differs by less than this.
_ALIKE = 0.1
# No more of the values than this can be outliers.
_MOST_OUTLIERS = 0.1
# Median of |N(0, 1)|.
_MEDIAN_DEVIATION = 0.6745
_GAUGE_ROUNDS = 6
# Images worked on at once.
_GROUP = 4
_PILOT_PASSES, _FULL_PASSES = 60, 20

Progress = Callable[[str], None]


def fit_batches(problem: Problem, batches: list[Batch], start: Tensor | None = None) -> Solution:
    """The optimum on a few thousand samples held in memory.

    Args:
        problem: what is estimated.
        batches: the samples.
        start: u [P] near the optimum; None: searched for globally, no initial guess is needed.
    """
    tiles = in_memory(batches)

    def descend(problem: Problem, start: Tensor, reference: Tensor) -> Solution:
        misfit = typical_residual(problem, batches, reference)
        evaluate = passes_over(problem, tiles, start, reference, misfit)
        found = minimise(problem, start, evaluate, passes=_PILOT_PASSES, tolerance=0.01)
        return replace(found, misfit=misfit)

    def settle(found: Solution) -> Solution:
        for _ in range(_EXPANSIONS):
            before, found = found, descend(found.problem, found.unknowns, found.unknowns)
            if distance(found, before) < _SETTLED:
                break
        return found

    best = most_plausible([settle(guess) for guess in first_guesses(problem, batches, start)])
    for _ in range(_SECOND_THOUGHTS if start is None and best.statistics.outliers > _SPOILT else 0):
        # Outliers had bent the first guess: once they are known for what they are, the search may end elsewhere.
        before = best
        again = first_guesses(best.problem, doubtful(best, thinned(batches)), None)
        best = most_plausible([before, *(settle(guess) for guess in again if distance(before, guess) > _ELSEWHERE)])
        if implausibility(best) > implausibility(before) - _ALIKE * before.misfit**2:
            break
    for _ in range(_GAUGE_ROUNDS if problem.gauges else 0):
        # The limit was taken from a fit without the second bounce, which makes albedos too bright and it too low.
        limit = best.problem.limit_of_gauges(best.unknowns)
        if abs(limit / best.problem.gauge_limit - 1) < 1e-6:
            break
        wider = replace(best.problem, gauge_limit=limit)
        best = descend(wider, torch.minimum(best.unknowns, wider.upper), best.unknowns)
    return best


def first_guesses(problem: Problem, batches: list[Batch], start: Tensor | None) -> list[Solution]:
    """Distinct optima of least squares with the weights of `Batch.measured`, from a global search or from `start`."""
    guesses: list[Solution] = []
    for view in views(batches):
        starts = [] if start is None else [start]
        if start is None:
            with single_threaded_torch():
                found = search(problem, thinned(view))
            problem, starts = found.problem, found.starts()
        for first in starts:
            evaluate = passes_over(problem, in_memory(view), first, None, 1.0)
            guesses.append(minimise(problem, first, evaluate, passes=_PILOT_PASSES, tolerance=0.01))
    distinct: list[Solution] = []
    for guess in sorted(guesses, key=implausibility):
        if all(distance(other, guess) > _DISTINCT for other in distinct):
            distinct.append(guess)
    return distinct


def thinned(batches: list[Batch]) -> list[Batch]:
    """Every so many-th sample, a few thousand in all."""
    step = max(sum(len(batch) for batch in batches) // _SEARCH, 1)
    return [batch[::step] for batch in batches]


def doubtful(found: Solution, batches: list[Batch]) -> list[Batch]:
    """The samples with a larger noise the farther they lie from a solution, so that least squares is Huber's (1964).

    Unlike weights that reject what lies far, these still let a highlight that the solution has missed be found.
    """
    linearisation = Linearisation(found.problem, found.unknowns, derivatives=False)
    out = []
    with torch.no_grad():
        for batch in batches:
            radiance = linearisation.radiance(batch)
            variance = batch.variance(radiance)
            deviation = (batch.radiance - radiance).abs() / variance.sqrt() / found.misfit
            variance = variance * (deviation / _HUBER).clamp(min=1)
            out.append(replace(batch, readout=Readout(variance, torch.zeros_like(variance[:1]))))
    return out


def views(batches: list[Batch]) -> list[list[Batch]]:
    """The samples as first guesses see them: with clipped values as measured and, where there are any, without them.

    Without its saturated middle a highlight may not be seen at all; with it, it is taken for flat.
    """
    if all(batch.clipped is None for batch in batches):
        return [batches]
    without = []
    for batch in batches:
        inside = slice(None) if batch.clipped is None else (batch.clipped == 0).all(-1).nonzero()[:, 0]
        without.append(batch[inside])
    return [batches, [batch for batch in without if len(batch)]] if any(map(len, without)) else [batches]


def distance(found: Solution, other: Solution) -> float:
    """Between two solutions of a problem, in standard errors."""
    change = other.unknowns - found.unknowns
    return float((change @ found.statistics.information @ change / found.statistics.misfit).clamp(min=0)) ** 0.5


def implausibility(found: Solution) -> float:
    """The cost that solutions with different outliers are compared by: an outlier counts as one just rejected."""
    return found.statistics.total("cost") + (REJECTED * found.misfit) ** 2 * found.statistics.total("outliers")


def most_plausible(found: list[Solution]) -> Solution:
    """The best of several solutions; of those that the data cannot tell apart the one with the fewest at a bound."""
    least = min(found, key=implausibility)
    rivals = [one for one in found if implausibility(one) - implausibility(least) < _ALIKE * least.misfit**2]

    def bounds(one: Solution) -> int:
        return int(((one.unknowns <= one.problem.lower) | (one.unknowns >= one.problem.upper)).sum())

    return min(rivals, key=bounds)


def typical_residual(problem: Problem, batches: list[Batch], unknowns: Tensor) -> float:
    """Median residual in standard deviations of the noise, as a multiple of a Gaussian's; at least 1.

    Large enough for no more than a tenth of the values to be outliers: a model that misses more does not fit.
    """
    linearisation = Linearisation(problem, unknowns, derivatives=False)
    deviations = []
    with torch.no_grad():
        for batch in batches:
            radiance = linearisation.radiance(batch)
            deviation = (batch.radiance - radiance).abs() / batch.variance(radiance).sqrt()
            deviations.append(deviation[batch.working(radiance).plain])
    found = torch.cat(deviations).double()
    if not len(found):
        return 1.0
    most = float(found.kthvalue(max(int((1 - _MOST_OUTLIERS) * len(found)), 1)).values)
    return max(float(found.median()) / _MEDIAN_DEVIATION, most / TRUSTED, 1.0)


def fit(
    problem: Problem,
    samples: Samples,
    seed: int,
    progress: Progress = lambda _: None,
    start: Tensor | None = None,
    precision: float = 0.0,
) -> Solution:
    """The maximum-likelihood estimate from all samples: from the pilot's optimum, passes over everything.

    From there one Gauss-Newton step has the full efficiency; a second pass proves that it did. The likelihood stays
    expanded about the pilot's optimum: that need not be exact, and makes its cost one that passes can be compared by.

    Args:
        problem: what is estimated.
        samples: all of them.
        seed: of the pilot's random draw.
        progress: called with a word on what is being done.
        start: u [P] near the optimum; None: searched for globally.
        precision: a subsample is enough once it gives every parameter a relative standard error below this.
    """
    progress("searching")
    count = _PILOT
    batches = pilot(samples, count, seed)
    found = fit_batches(problem, batches, start)
    while largest_relative_std(found) > precision > 0 and _GROWTH * count < _SUBSAMPLE * len(samples):
        count *= _GROWTH
        batches = pilot(samples, count, seed)
        found = fit_batches(found.problem, batches, found.unknowns)
    tiles: Tiles = in_memory(batches)
    if largest_relative_std(found) > precision:
        progress("refining over all samples")
        reference, misfit = found.unknowns, found.misfit
        tiles = AllTiles(samples, merge=True, misfit=misfit)
        evaluate = passes_over(found.problem, tiles, reference, reference, misfit)
        found = minimise(found.problem, reference, evaluate, passes=_FULL_PASSES, tolerance=0.03)
        found = replace(found, misfit=misfit)
    return replace(found, unknowns=found.problem.wrapped(found.unknowns), tiles=tiles)


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
        merge: let four samples stand for every smooth patch of pixels (`Patches`).
        misfit: see `Batch.working`.
    """

    samples: Samples
    merge: bool = False
    misfit: float = 1.0

    @cached_property
    def patches(self) -> Patches:
        return Patches(self.samples, self.misfit, merge=self.merge)

    def __iter__(self) -> Iterator[list[Callable[[], Batch]]]:
        count = len(self.samples.images)
        for first in range(0, count, _GROUP):
            group = range(first, min(first + _GROUP, count))
            yield [partial(self.patches.batch, k, part) for k in group for part in range(self.patches.parts(k))]
            for k in group:
                self.samples.capture.release(self.samples.images[k])


def passes_over(
    problem: Problem,
    tiles: Tiles,
    origin: Tensor,
    reference: Tensor | None,
    misfit: float,
) -> Evaluate:
    """Statistics at any unknowns near `origin`: by a pass each, or from a single one where the model separates."""
    if separates(problem):
        return partial(statistics, problem, compress(problem, tiles, origin, reference, misfit))
    return partial(accumulate, problem, tiles=tiles, reference=reference, misfit=misfit)
