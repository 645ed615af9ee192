"""Errors of the calibration are found together with the material, and their spread with them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
import torch

from matest.brdf import OrenNayar
from matest.capture import Capture
from matest.estimators import Problem, Solution, fit
from matest.estimators.refinement import fit_calibrated
from matest.photographs.world import TERMS
from tests.miscalibrated import brighter, normal_deviates, photographed, tilted, under_sky
from tests.problems import problem

MATERIAL = OrenNayar([0.7, 0.5, 0.3], 0.4)
SIGMA = 0.4


def refined(capture: Capture, spreads: Mapping[str, float], stated: tuple[str, ...] = ()) -> Solution:
    samples = capture.samples()
    plain = fit(problem(MATERIAL.expression, channels=3), samples, 0)
    families = samples.calibration([*spreads])
    return fit_calibrated(plain.problem.calibrated(families, spreads, samples.groups), plain, samples, 0, stated)


def std_of(solution: Solution, name: str) -> float:
    covariance = torch.linalg.inv(solution.statistics.information)
    return float(covariance.diagonal()[solution.problem.where[name]].sqrt()[0])


def errors_of(solution: Solution, name: str) -> torch.Tensor:
    return solution.unknowns[solution.problem.where[name]]


def sigma_of(solution: Solution) -> float:
    return float(solution.problem.values(solution.unknowns)["sigma"])


def test_lights_that_are_too_strong_or_too_weak_are_found() -> None:
    errors = 0.03 * normal_deviates(8, seed=1)
    solution = refined(photographed(MATERIAL, brighter(errors), 1), {"intensity": 0.03})
    found = errors_of(solution, "intensity")
    # Their mean is that of the albedo too.
    ratio = (1 + found) / (1 + errors)
    assert float((ratio / ratio.mean() - 1).abs().max()) < 0.003
    assert abs(sigma_of(solution) - SIGMA) < 4 * std_of(solution, "sigma") < 0.02
    assert solution.statistics.reduced_chi2 < 1.05


def test_lights_that_stand_elsewhere_are_found_to_a_tenth_of_a_degree() -> None:
    errors = 0.0175 * normal_deviates(8, 3, seed=2)
    capture = photographed(MATERIAL, tilted(errors), 2)
    solution = refined(capture, {"direction": 0.0175})
    across = errors_of(solution, "direction").reshape(8, 2)
    stated = torch.stack([light.direction for (light,) in capture.scene.lights])
    first = torch.nn.functional.normalize(torch.linalg.cross(torch.tensor([[0.0, 1.0, 0.0]]).double(), stated), dim=1)
    second = torch.linalg.cross(stated, first)
    first, second = (torch.where(stated[:, 1:2].abs() > 0.9, torch.nan, part) for part in (first, second))
    expected = torch.stack([(errors * first).sum(1), (errors * second).sum(1)], dim=1)
    assert float(torch.rad2deg((across - expected).nan_to_num()).abs().max()) < 0.15
    assert abs(sigma_of(solution) - SIGMA) < 4 * std_of(solution, "sigma") < 0.02


def test_a_large_family_without_errors_is_shrunk_to_nothing() -> None:
    capture = photographed(MATERIAL, under_sky(0.02), 3)
    solution = refined(capture, {"ambient": 0.05, "direction": 0.0175, "intensity": 0.03, "albedo_field": 0.1})
    assumed = {"direction": 0.0175, "intensity": 0.03, "albedo_field": 0.1 / (TERMS - 1) ** 0.5}
    for name, spread in assumed.items():
        assert solution.problem.spreads[name] < 0.1 * spread, name
    assert solution.problem.spreads["ambient"] == 0.05
    assert float(errors_of(solution, "ambient")) == pytest.approx(0.02, abs=0.002)


def test_the_spread_of_a_family_is_that_of_its_errors() -> None:
    errors = 0.06 * normal_deviates(8, seed=5)
    solution = refined(photographed(MATERIAL, brighter(errors), 4), {"intensity": 0.01})
    assert solution.problem.spreads["intensity"] == pytest.approx(float(errors.square().mean().sqrt()), rel=0.15)


def test_a_spread_that_is_stated_is_kept() -> None:
    capture = photographed(MATERIAL, brighter(0.06 * normal_deviates(8, seed=5)), 4)
    solution = refined(capture, {"intensity": 0.01}, stated=("intensity",))
    assert solution.problem.spreads["intensity"] == 0.01


def test_errors_that_are_centred_are_zero_on_average() -> None:
    samples = photographed(MATERIAL, brighter(0.03 * normal_deviates(8, seed=6) + 0.1), 5).samples()
    plain = fit(problem(MATERIAL.expression, channels=3), samples, 0)
    chosen: Problem = plain.problem.calibrated(
        samples.calibration(["intensity"]), {"intensity": 0.03}, samples.groups, ("intensity",)
    )
    solution = fit_calibrated(chosen, plain, samples, 0)
    assert abs(float(errors_of(solution, "intensity").mean())) < 1e-4


@pytest.mark.parametrize("share", [0.01, 0.03])
def test_estimates_scatter_as_their_error_bars_say(share: float) -> None:
    deviations = []
    for seed in range(8):
        solution = refined(photographed(MATERIAL, under_sky(share), 10 + seed), {"ambient": 0.05})
        deviations.append((sigma_of(solution) - SIGMA) / std_of(solution, "sigma"))
    # Eight standard deviates: rms 1 ± 0.25.
    assert 0.4 < float(np.sqrt(np.mean(np.square(deviations)))) < 1.9
