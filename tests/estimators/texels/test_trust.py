"""What texels of little known shape do to what is in common is known, and allowed for."""

from __future__ import annotations

import numpy as np
import torch

from matest.benchmark.instruments.photographs import sphere
from matest.benchmark.instruments.varying import KINDS, photographed
from matest.estimators.texels.elimination import Elimination
from matest.estimators.texels.fit import TexelFitter
from matest.estimators.texels.regions import Regions
from matest.estimators.texels.some import descend, unbiased
from matest.estimators.texels.trust import Reliable, ScoreBias, unlike_the_seen
from matest.estimators.texels.unknowns import TexelUnknowns
from matest.samples.residual_scale import NOISE_ALONE
from matest.samples.texels import TexelTile
from matest.workers import single_threaded_torch
from tests.problems import problem

KIND = KINDS["cook-torrance"]
# Relative standard error of the slopes of texels that count.
LIMIT = 0.15
# How far the specular albedo is drawn up, at least.
BIASED = 0.06
# Two standard errors of the mean of two; a correction by noise that it has raised itself was 0.06 off or more.
UNBIASED = 0.04


TRUTH = {"diffuse": 0.4, "slope": 0.2, "specular": 0.9}


def at_truth(size: int, seed: int, count: int) -> tuple[TexelFitter, TexelTile]:
    """A fitter with the specular albedo of two materials, and texels in three photographs of them."""
    samples = photographed(KIND, sphere(size), 3, seed, materials=2).photograph().photographs.samples()
    chosen = problem(KIND.expression, channels=3, fix=KIND.fixed)
    unknowns = chosen.unknowns_at(
        {name: torch.full((chosen.count(name),), value).double() for name, value in TRUTH.items()}
    )
    texels = TexelUnknowns(chosen, ("diffuse", "slope"))
    return TexelFitter(texels, unknowns, NOISE_ALONE), samples.some_texels(count, 0)


@torch.no_grad()
def test_the_bias_of_scores_is_their_mean_where_what_is_in_common_is_right() -> None:
    scores, foreseen = [], []
    for seed in range(6):
        fitter, tile = at_truth(48, seed, 1_000)
        here = fitter.fit(tile, Regions.single(fitter.texels, fitter.unknowns).weak_prior(len(tile)))
        elimination = Elimination.of(fitter, here)
        counted = Reliable.of(fitter, here, elimination, 1.0, LIMIT).counted
        scores.append(elimination.sums(counted).scores.numpy() / len(tile))
        foreseen.append(ScoreBias.of(fitter, here, 1.0, LIMIT, seed).mean.numpy())
    mean, chance = np.mean(scores), np.mean(scores, axis=1).std(ddof=1) / np.sqrt(len(scores))
    assert mean > 4 * chance
    assert abs(np.mean(foreseen) - mean) < 3 * chance


@torch.no_grad()
def test_a_specular_albedo_in_common_is_right_on_average_though_few_texels_tell_their_slopes() -> None:
    drawn, right, inflations = [], [], []
    for seed in range(2):
        fitter, tile = at_truth(64, seed, 2_000)
        with single_threaded_torch():
            sample = descend(fitter.texels, fitter.unknowns, tile)
            corrected, _, _ = unbiased(sample, seed)
        places = fitter.texels.common_places
        drawn.append(float(sample.fitter.unknowns[places].mean()))
        right.append(float(corrected.fitter.unknowns[places].mean()))
        inflations.append(corrected.inflation)
    assert min(drawn) > TRUTH["specular"] + BIASED
    assert abs(np.mean(right) - TRUTH["specular"]) < UNBIASED
    # The model holds.
    assert max(inflations) < 1.1


@torch.no_grad()
def test_a_narrow_lobe_that_no_photograph_looks_into_is_unlike_anything_seen() -> None:
    fitter, tile = at_truth(48, 0, 1_000)
    prior = Regions.single(fitter.texels, fitter.unknowns).weak_prior(len(tile))
    nearest = tile.half_angles.unflatten(0, (tile.images, -1))
    nearest = torch.where(tile.usable.unflatten(0, (tile.images, -1)), nearest, torch.inf).amin(0)

    def unlike(slope: float) -> torch.Tensor:
        theta = fitter.texels.spread(fitter.unknowns, len(tile)).to(tile.radiance)
        theta[fitter.texels.at("slope")] = slope
        return unlike_the_seen(fitter, fitter.at(tile, theta, prior))

    # Squares of sines: within a slope of the mirror direction, and three slopes beside it.
    seen, beside = nearest < 0.05**2, nearest > 0.15**2
    assert int(seen.sum()) > 2
    assert int(beside.sum()) > 100
    assert bool(unlike(0.05)[beside].all())
    assert not bool(unlike(0.05)[seen].any())
    # What a wide lobe would be there is much like what it was beside.
    assert not bool(unlike(0.3)[nearest.isfinite()].any())
