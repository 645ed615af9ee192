"""What texels of little known shape do to what is in common is known, and allowed for."""

from __future__ import annotations

import numpy as np
import torch

from matest.benchmark.instruments.photographs import sphere
from matest.benchmark.instruments.varying import KINDS, estimated, photographed
from matest.estimators.texels.elimination import Elimination
from matest.estimators.texels.fit import TexelFitter
from matest.estimators.texels.regions import Regions
from matest.estimators.texels.trust import Reliable, ScoreBias
from matest.estimators.texels.unknowns import TexelUnknowns
from matest.samples.residual_scale import NOISE_ALONE
from tests.problems import problem

KIND = KINDS["cook-torrance"]
# Relative standard error of the slopes of texels that count.
LIMIT = 0.15


@torch.no_grad()
def test_the_bias_of_scores_is_their_mean_where_what_is_in_common_is_right() -> None:
    scores, foreseen = [], []
    for seed in range(6):
        subject = photographed(KIND, sphere(48), 3, seed, materials=2)
        samples = subject.photograph().photographs.samples()
        chosen = problem(KIND.expression, channels=3, fix=KIND.fixed)
        tile = samples.some_texels(1_000, 0)
        texels = TexelUnknowns(chosen, ("diffuse", "slope"))
        truth = {"diffuse": 0.4, "slope": 0.2, "specular": 0.9}
        unknowns = chosen.unknowns_at(
            {name: torch.full((chosen.count(name),), value).double() for name, value in truth.items()}
        )
        fitter = TexelFitter(texels, unknowns, NOISE_ALONE)
        here = fitter.fit(tile, Regions.single(texels, unknowns).weak_prior(len(tile)))
        elimination = Elimination.of(fitter, here)
        counted = Reliable.of(fitter, here, elimination, 1.0, LIMIT).counted
        scores.append(elimination.sums(counted).scores.numpy() / len(tile))
        foreseen.append(ScoreBias.of(fitter, here, 1.0, LIMIT, seed).mean.numpy())
    mean, chance = np.mean(scores), np.mean(scores, axis=1).std(ddof=1) / np.sqrt(len(scores))
    assert mean > 4 * chance
    assert abs(np.mean(foreseen) - mean) < 3 * chance


def test_a_specular_albedo_in_common_is_right_though_few_texels_tell_their_slopes() -> None:
    subject = photographed(KIND, sphere(64), 3, seed=0, materials=2)
    specular = estimated(KIND, subject.photograph()).parameters["specular"]
    for value, (low, high) in zip(specular.value, specular.interval95, strict=True):
        assert low < 0.9 < high
        assert abs(value - 0.9) < 0.05
