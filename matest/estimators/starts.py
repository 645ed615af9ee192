"""Where to start: the distinct optima that a global search leads to."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import torch
from torch import Tensor

from matest.errors import InputError
from matest.estimators.basis import TangentBasis
from matest.estimators.levenberg_marquardt import Solution, minimise
from matest.estimators.passes import accumulate, compress, statistics
from matest.estimators.search import search
from matest.estimators.unknowns import Problem
from matest.samples import Batch, Tile
from matest.samples.batch import join
from matest.samples.likelihood import REJECTED, Readout
from matest.samples.tiles import in_memory

_SEARCH = 4_000
# First guesses further apart than so many standard errors are followed each to its end.
_DISTINCT = 1.0
# Samples further than so many standard deviations from a solution are doubted.
_HUBER = 2.0
# χ² of solutions along a valley of the likelihood differs by less than this.
ALIKE = 0.1
# Share of its domain: Fresnel's reflectance is the same for all f0 nearer to 1.
_END = 1e-4
_PASSES = 60


def first_guesses(problem: Problem, batches: list[Batch], start: Tensor | None) -> list[Solution]:
    """Distinct optima of least squares with the weights of `likelihood.first_guess` on a few thousand of the samples.

    Args:
        problem: what is estimated.
        batches: single samples.
        start: u [P] near the optimum; None: searched for globally.

    Raises:
        InputError: the model gives nothing that can be compared with the samples.
    """
    guesses: list[Solution] = []
    for view in views(thinned(batches)):
        tile = Tile(view)
        settled = replace(tile, least_squares=tile.first_guess())
        # Moments of images that no unknown touches serve the search and every descent from it.
        compressed = compress(problem, in_memory([settled]), None, None) if problem.separates else None
        starts = [] if start is None else [start]
        if start is None:
            found = search(problem, [view], compressed)
            problem, starts = found.problem, found.starts()
        for first in starts:
            evaluate = partial(accumulate, problem, tiles=in_memory([settled]), reference=None)
            if compressed is not None:
                evaluate = partial(statistics, problem, compressed)
            guesses.append(minimise(problem, first, evaluate, passes=_PASSES, tolerance=0.01))
    guesses = [guess for guess in guesses if math.isfinite(implausibility(guess))]
    if not guesses:
        raise InputError(
            f"{problem.brdf.expression} cannot be compared with the images: the misfit is not finite, whatever its "
            "parameters; check the noise and the images, or try another model."
        )
    distinct: list[Solution] = []
    for guess in sorted(guesses, key=implausibility):
        if all(apart(other, guess) > _DISTINCT for other in distinct):
            distinct.append(guess)
    return distinct


def thinned(batches: list[Batch]) -> Batch:
    """Every so many-th sample, a few thousand in all."""
    step = max(sum(len(batch) for batch in batches) // _SEARCH, 1)
    return join([batch[::step] for batch in batches]).ungrouped


def doubtful(found: Solution, batch: Batch) -> Batch:
    """The samples with a larger noise the farther they lie from a solution, so that least squares is Huber's (1964).

    Unlike weights that reject what lies far, these still let a highlight that the solution has missed be found.
    """
    with torch.no_grad():
        radiance = TangentBasis(found.problem, found.unknowns, derivatives=False).radiance(batch)
        variance = batch.variance(radiance)
        deviation = (batch.radiance - radiance).abs() / variance.sqrt() / found.residual_scale
        variance = variance * (deviation / _HUBER).clamp(min=1)
    readout = Readout(variance, torch.zeros_like(variance[:1]))
    return replace(batch, noise=replace(batch.noise, readout=readout))


def views(batch: Batch) -> list[Batch]:
    """The samples as first guesses see them: with clipped values as measured and, where any are saturated, without.

    Without its saturated middle a highlight may not be seen at all; with it, it is taken for flat.
    """
    clipped = batch.noise.clipped
    if clipped is None or not bool((clipped > 0).any()):
        return [batch]
    inside = (clipped == 0).all(-1).nonzero()[:, 0]
    return [batch, batch[inside]] if len(inside) else [batch]


def distance(found: Solution, other: Solution) -> float:
    """Between two solutions of a problem, in standard errors."""
    change = other.unknowns - found.unknowns
    return float((change @ found.statistics.information @ change / found.statistics.inflation).clamp(min=0)) ** 0.5


def apart(one: Solution, other: Solution) -> float:
    """The distance as either of two solutions sees it, whichever sees more: one may lie where the model is flat."""
    return max(distance(one, other), distance(other, one))


def implausibility(found: Solution) -> float:
    """The cost that solutions with different outliers are compared by: an outlier counts as one just rejected."""
    return found.statistics.cost + (REJECTED * found.residual_scale) ** 2 * found.statistics.total("outliers")


def most_plausible(found: list[Solution]) -> Solution:
    """The best of several solutions; of those that the data cannot tell apart the one with the fewest at a bound."""
    least = min(found, key=implausibility)
    rivals = [one for one in found if implausibility(one) - implausibility(least) < ALIKE * least.residual_scale**2]
    return min(rivals, key=at_ends)


def at_ends(found: Solution) -> int:
    """How many unknowns lie at an end of their domain, or so near that a model may no longer depend on them."""
    problem, unknowns = found.problem, found.unknowns
    width = problem.upper - problem.lower
    margin = _END * torch.where(torch.isfinite(width), width, 0.0)
    return int(((unknowns <= problem.lower + margin) | (unknowns >= problem.upper - margin)).sum())
