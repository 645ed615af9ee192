"""Errors of the calibration estimated together with the material, with variance components of their families."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import replace

from matest.estimators.covariance import fisher
from matest.estimators.fit import refine
from matest.estimators.levenberg_marquardt import Solution, at_bound
from matest.estimators.pilot import follow
from matest.estimators.unknowns import Problem
from matest.progress import Progress, silent
from matest.samples import Samples, Tile
from matest.samples.batch import join
from matest.samples.tiles import in_memory
from matest.workers import single_threaded_torch

# Samples that are enough to linearise a model in the errors of the calibration.
_PILOT_SAMPLES = 8_000
# Rounds of refits after the spreads have changed.
_MAX_ROUNDS = 4
# Relative change of every spread that ends them.
_SPREAD_CHANGE = 0.1
# Steps to the fixed point of the spreads for given sums over the samples.
_MAX_SPREAD_STEPS = 100
# Relative change of the spreads at which these steps end.
_SPREAD_TOLERANCE = 0.01
# Unknowns of a family that say how large its errors are; with fewer their spread is the one assumed.
MIN_UNKNOWNS = 4
# Share of the assumed spread below which an estimated one is nothing.
_LEAST_SPREAD = 1e-3
# Multiple of the assumed spread above which an estimated one is no error of a calibration any more.
_LARGEST_SPREAD = 100.0
# Unknowns of a family that count as determined at least, so that the fixed point stays finite.
_LEAST_DETERMINED = 1e-6


@single_threaded_torch()
def fit_calibrated(
    problem: Problem,
    solution: Solution,
    samples: Samples,
    seed: int,
    stated: Collection[str] = (),
    progress: Progress = silent,
) -> Solution:
    """The maximum of the posterior of a material and errors of the calibration.

    The spread of a family of many unknowns that nobody states is estimated too, so that a large family cannot explain
    everything.

    Args:
        problem: with nuisances.
        solution: without, of the same samples.
        samples: all of them.
        seed: of the pilot's random draw.
        stated: names of the families whose spread is stated.
        progress: called with a word on what is being done.
    """
    progress("refining the calibration")
    tiles = [Tile(join(samples.pilot(_PILOT_SAMPLES, seed)), cache={})]
    start = problem.unknowns_at({name: solution.problem.values(solution.unknowns)[name] for name in problem.free})
    unstated = {name: spread for name, spread in problem.spreads.items() if name not in stated}
    pilot = follow(replace(problem, inflation=solution.statistics.inflation), start, tiles)
    for _ in range(_MAX_ROUNDS):
        before, inflation = pilot.problem, pilot.statistics.inflation
        spreads = _spreads(pilot, unstated)
        changes = [spread / before.spreads[name] for name, spread in spreads.items()]
        if all(abs(change - 1) < _SPREAD_CHANGE for change in (*changes, inflation / before.inflation)):
            break
        pilot = follow(replace(before.with_priors(spreads), inflation=inflation), pilot.unknowns, tiles)
    progress("refining over all samples")
    return refine(replace(pilot, tiles=in_memory(tiles)), samples)


def _spreads(solution: Solution, assumed: Mapping[str, float]) -> dict[str, float]:
    """The spread of each of some families with many unknowns, as their estimates show it.

    The fixed point of MacKay 1992 (Neural Computation 4, 415, section 4): the sum of the squared estimates is the
    variance times the number of unknowns that the samples determine. The likelihood is quadratic about the solution.

    Args:
        solution: with any spreads.
        assumed: spread of each of the families at first.
    """
    problem, unknowns, inflation = solution.problem, solution.unknowns, solution.statistics.inflation
    by_samples = replace(solution.statistics, prior=None)
    information, gradient = by_samples.information / inflation, by_samples.gradient / inflation
    free = ~at_bound(problem, unknowns, solution.statistics.gradient)
    # Of errors that are 0 on average one follows from the others.
    counts = {block.name: problem.family(block.name).count - block.centred for block in problem.nuisances}
    names = [name for name in assumed if counts[name] >= MIN_UNKNOWNS]
    for _ in range(_MAX_SPREAD_STEPS):
        before, precision = problem.spreads, problem.prior_precision
        covariance = fisher(information + precision, free).matrix
        mean = unknowns + covariance @ (gradient + precision @ (problem.anywhere - unknowns))
        spreads = {}
        for name in names:
            place = problem.where[name]
            determined = counts[name] - float(covariance.diagonal()[place].sum()) / before[name] ** 2
            spread = math.sqrt(float(mean[place].square().sum()) / max(determined, _LEAST_DETERMINED))
            spreads[name] = min(max(spread, _LEAST_SPREAD * assumed[name]), _LARGEST_SPREAD * assumed[name])
        problem = problem.with_priors(spreads)
        if all(abs(spreads[name] / before[name] - 1) < _SPREAD_TOLERANCE for name in names):
            break
    return {name: problem.spreads[name] for name in names}
