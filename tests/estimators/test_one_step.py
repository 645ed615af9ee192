"""Whether one step over all samples is enough, judged by those of the pilot."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from matest.benchmark.instruments.photographs import Sensor, ring, sphere, subject
from matest.brdf import Brdf, CookTorrance
from matest.estimators import accumulate, fit, fit_batches
from matest.estimators.levenberg_marquardt import Solution, minimise
from matest.estimators.moments import SCORES
from matest.estimators.one_step import END_TOLERANCE, single_step
from matest.estimators.statistics import Statistics
from matest.photographs.noise import Noise
from matest.photographs.pilot import pilot
from matest.photographs.samples import PhotographSamples
from tests.problems import problem
from tests.simulated import Studio

GLOSSY = CookTorrance(0.3, 0.6, 0.3, 0.04)


def photographed(material: Brdf = GLOSSY, size: int = 96) -> PhotographSamples:
    return Studio(size=size).photograph(material, seed=3).samples()


def begun(samples: PhotographSamples, count: int = 8000) -> tuple[Solution, Statistics]:
    """The optimum of a small pilot, and the statistics of all samples there."""
    found = fit_batches(problem("cook-torrance", fix={"f0": 0.04}), pilot(samples, count, seed=0))
    return found, accumulate(
        found.problem, found.unknowns, samples.tiles(merge=False), found.unknowns, found.residual_scale
    )


def standard_errors(one: Solution, other: Solution) -> float:
    change = one.unknowns - other.unknowns
    return float(change @ one.statistics.information @ change) ** 0.5


def test_one_step_from_the_pilot_ends_where_many_do() -> None:
    samples = photographed()
    start, statistics = begun(samples)
    once = single_step(start, statistics)
    assert once is not None
    assert (once.iterations, once.converged) == (1, True)

    def evaluate(unknowns: torch.Tensor) -> Statistics:
        return accumulate(start.problem, unknowns, samples.tiles(merge=False), start.unknowns, start.residual_scale)

    whole = minimise(start.problem, start.unknowns, evaluate, passes=20, tolerance=1e-3)
    assert standard_errors(start, whole) > 0.5
    assert standard_errors(once, whole) < END_TOLERANCE
    assert once.statistics.reduced_chi2 == pytest.approx(whole.statistics.reduced_chi2, rel=1e-3)
    assert fit(start.problem, samples, 0).iterations == 1


def test_a_step_so_long_that_the_model_bends_is_not_enough() -> None:
    samples = photographed()
    assert single_step(*begun(samples, 2000)) is None
    start, _ = begun(samples)
    far = start.unknowns.clone()
    far[start.problem.where["slope"]] *= 1.2
    away = replace(start, unknowns=far)
    assert single_step(away, accumulate(start.problem, far, samples.tiles(merge=False), far)) is None


def test_a_model_that_misses_takes_another_pass() -> None:
    start, statistics = begun(photographed())
    scores = statistics.scores.clone()
    scores[:, SCORES.index("chi2")] *= 1.1
    assert single_step(start, statistics) is not None
    assert single_step(start, replace(statistics, scores=scores)) is None


def test_the_tail_of_noise_near_the_ends_of_the_range_does_not_widen_it() -> None:
    # A dim body, two in five values of which are clipped at black, under a highlight that few pixels see: these alone
    # are judged, and the few values of the body that lie four deviations off must not be judged with them.
    material = CookTorrance(
        diffuse=torch.full((3,), 0.007), specular=torch.full((3,), 0.03), slope=0.01, f0=0.14, normalisation="ngan"
    )
    lights = ring(6)
    captures = [subject(sphere(128), lights, material, Sensor(noise=Noise(2e-3, 2e-4)), seed=seed) for seed in range(4)]
    for capture in captures:
        samples, problem = capture.photograph().samples(), capture.problem({"f0": 0.14})
        solution = fit(problem, samples, 0)
        truth = problem.unknowns_at(material.parameters)
        assert not bool((solution.residual_scale.values > 1).any())
        deviations = (solution.unknowns - truth) / capture.cramer_rao(problem).std
        assert float(deviations.abs().max()) < 4
