"""One uniform material: the optimum on a pilot of the samples, then one or a few passes over all of them."""

from __future__ import annotations

import math
from dataclasses import replace

from torch import Tensor

from matest.estimators.covariance import fisher
from matest.estimators.levenberg_marquardt import MAX_PASSES, Solution, at_bound, minimise
from matest.estimators.one_step import END_TOLERANCE, single_step
from matest.estimators.passes import passes_over
from matest.estimators.pilot import fit_batches
from matest.estimators.unknowns import Problem
from matest.progress import Progress, silent
from matest.samples import Batch, Samples
from matest.workers import single_threaded_torch

# Samples of the pilot: its own error is then small enough for one Gauss-Newton step to reach the optimum of all.
_PILOT_SAMPLES = 24_000
# Samples of the pilot times directions of light of each, at most: of 256 directions of a map 6,000 samples.
_PILOT_SHADED = 1_536_000
# Samples of the first subsample where a precision is asked for: few, since many captures need no more.
_FIRST_SUBSAMPLE = 6_000
# The next subsample has this many times the samples that the error bars ask for, lest they just miss the precision.
_SAMPLE_MARGIN = 1.2
# A subsample is at most this many times the one before: error bars from few samples are themselves uncertain.
_MAX_GROWTH = 100.0
# Above this share of all samples a subsample costs no less than a pass over all of them.
_MAX_SUBSAMPLE_SHARE = 0.04
# Passes over all samples with errors of the calibration: each costs several of those without.
_CALIBRATED_PASSES = 8
# χ² per value of a subsample that the model describes, with room for noise that was estimated from the photographs.
_DESCRIBED_CHI2 = 1.1


@single_threaded_torch()
def fit(
    problem: Problem,
    samples: Samples,
    seed: int,
    progress: Progress = silent,
    start: Tensor | None = None,
    precision: float = 0.0,
) -> Solution:
    """The maximum-likelihood estimate from all samples: from the pilot's optimum, passes over everything.

    From there one Gauss-Newton step has the full efficiency; where it might not, a second pass follows. The likelihood
    stays expanded about the pilot's optimum. That need not be exact, and all passes minimise the same cost.

    Args:
        problem: what is estimated.
        samples: all of them.
        seed: of the pilot's random draw.
        progress: called with a word on what is being done.
        start: u [P] near the optimum; None: searched for globally.
        precision: a subsample is enough once it gives every parameter a relative standard error below this, if the
            model describes it: otherwise errors do not fall with the number of samples.

    Raises:
        ValueError: the problem has another number of channels than the samples.
    """
    if problem.channels != samples.channels:
        raise ValueError(f"the problem has {problem.channels} channels, the samples have {samples.channels}.")
    progress("searching")
    count = _FIRST_SUBSAMPLE if precision > 0 else _PILOT_SAMPLES
    solution = fit_batches(problem, _pilot(samples, count, seed), start)
    if precision > 0:
        solution, count = _grow_subsample(solution, count, samples, seed, precision)
    if precision <= 0 or not _is_described(solution) or _largest_relative_std(solution) > precision:
        if count < _PILOT_SAMPLES:
            # Where the model does not hold, outliers depend on the pilot: take the one that is used without precision.
            solution = fit_batches(problem, _pilot(samples, _PILOT_SAMPLES, seed), start)
        progress("refining over all samples")
        solution = refine(solution, samples)
    return replace(solution, unknowns=solution.problem.wrapped(solution.unknowns))


@single_threaded_torch()
def fit_some(
    problem: Problem, samples: Samples, seed: int, progress: Progress = silent, start: Tensor | None = None
) -> Solution:
    """The maximum-likelihood estimate from a few thousand samples, to start from; arguments are those of `fit`."""
    progress("searching")
    solution = fit_batches(problem, _pilot(samples, _PILOT_SAMPLES, seed), start)
    return replace(solution, unknowns=solution.problem.wrapped(solution.unknowns))


def _pilot(samples: Samples, count: int, seed: int) -> list[Batch]:
    """About `count` samples, or fewer where light comes to each from many directions."""
    batches = samples.pilot(count, seed)
    directions = max((batch.points.wi.shape[-2] for batch in batches), default=1)
    fewer = _PILOT_SHADED // max(directions, 1)
    return batches if fewer >= count else samples.pilot(fewer, seed)


def _grow_subsample(
    solution: Solution, count: int, samples: Samples, seed: int, precision: float
) -> tuple[Solution, int]:
    """Fit larger subsamples until they give the precision, and the number of samples drawn for the last.

    It ends early where the model does not describe the samples, or where a pass over all of them costs no more.
    """
    while _is_described(solution) and (std := _largest_relative_std(solution)) > precision:
        # Standard errors fall with the root of the number of samples.
        next_count = math.ceil(min(_SAMPLE_MARGIN * (std / precision) ** 2, _MAX_GROWTH) * count)
        if next_count > _MAX_SUBSAMPLE_SHARE * len(samples):
            break
        count = next_count
        solution = fit_batches(solution.problem, samples.pilot(count, seed), solution.unknowns)
    return solution, count


def refine(pilot: Solution, samples: Samples) -> Solution:
    """The solution from all samples, starting from the pilot's."""
    problem, reference, residual_scale = pilot.problem, pilot.unknowns, pilot.residual_scale
    tiles = samples.tiles(residual_scale)
    evaluate = passes_over(problem, tiles, reference, reference, residual_scale)
    first = evaluate(reference)
    one_step = None if problem.separates else single_step(pilot, first)
    solution = one_step or minimise(
        problem,
        reference,
        evaluate,
        passes=_CALIBRATED_PASSES if problem.nuisances else MAX_PASSES,
        tolerance=END_TOLERANCE,
        first=first,
    )
    return replace(solution, residual_scale=residual_scale, tiles=tiles)


def _is_described(solution: Solution) -> bool:
    """Whether the model describes a subsample to its noise."""
    chance_std = math.sqrt(2 / max(solution.statistics.total("values"), 1))
    return solution.statistics.reduced_chi2 < _DESCRIBED_CHI2 + 5 * chance_std


def _largest_relative_std(solution: Solution) -> float:
    """The largest relative standard error of the unknowns that are determined and not at a bound."""
    problem, statistics = solution.problem, solution.statistics
    free = ~at_bound(problem, solution.unknowns, statistics.gradient)
    covariance = fisher(statistics.information / statistics.inflation, free)
    counted = free & ~covariance.undetermined
    for name in problem.gauges:
        counted[problem.where[name]] = False
    return float((covariance.std / solution.unknowns.abs())[counted].max()) if bool(counted.any()) else math.inf
