"""The whole fit, against a general-purpose solver on the same weighted residuals."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.optimize import least_squares
from torch import Tensor

from matest.benchmark.instruments.trial import draw
from matest.benchmark.suites.outliers import SPOILT
from matest.brdf import CookTorrance, Lambert, OrenNayar, OrenNayarQualitative, TorranceSparrow
from matest.estimators import Problem, at_bound, fit, fit_batches
from matest.estimators.levenberg_marquardt import minimise
from matest.estimators.moments import scores
from matest.estimators.plausibility import distance, most_plausible
from matest.estimators.statistics import Statistics
from matest.photographs.samples import PhotographSamples
from matest.samples import Batch, Tile
from matest.shading import shade
from tests.captures import directional
from tests.environments import normals
from tests.problems import problem
from tests.simulated import Studio, coloured

# Distance between two solvers' optima, in standard errors.
AGREES = 1e-3

COMMON_SIGMA = {"torrance-sparrow.sigma": "oren-nayar.sigma"}
MATERIALS = [
    Lambert([0.6, 0.5, 0.4]),
    OrenNayar([0.7, 0.5, 0.3], 0.6),
    OrenNayarQualitative([0.7, 0.5, 0.3], 0.4),
    CookTorrance([0.3, 0.2, 0.1], [0.8, 0.7, 0.6], 0.2),
    OrenNayar([0.6, 0.5, 0.4], 0.5) + TorranceSparrow(0.04, 0.15),
]


def weighted_residuals(chosen: Problem, batch: Batch, weights_at: Tensor) -> Callable[[np.ndarray], np.ndarray]:
    response, weight, *_ = Tile(batch).about(shade(chosen.material(weights_at), batch.points))

    def residuals(unknowns: np.ndarray) -> np.ndarray:
        model = shade(chosen.material(torch.from_numpy(unknowns)), batch.points)
        return (weight.sqrt() * (response - model)).reshape(-1).numpy()

    return residuals


def scipy_optimum(
    chosen: Problem, samples: PhotographSamples, start: Tensor, weights_at: Tensor
) -> tuple[Tensor, Tensor]:
    """scipy's optimum of the residuals that the fit minimises, and its standard errors."""
    (batch,) = samples.batches(10**7, shuffle=True)
    found = least_squares(
        weighted_residuals(chosen, batch, weights_at),
        start.numpy(),
        jac="3-point",
        bounds=(chosen.lower.numpy(), chosen.upper.numpy()),
        x_scale="jac",
        xtol=1e-13,
        ftol=1e-15,
        gtol=1e-13,
    )
    return torch.from_numpy(found.x), torch.from_numpy(np.linalg.inv(found.jac.T @ found.jac).diagonal().copy()).sqrt()


def distance_to_scipy(chosen: Problem, samples: PhotographSamples) -> float:
    """How far the fit ends from scipy's optimum, in standard errors."""
    solution = fit(chosen, samples, seed=0)
    assert solution.converged
    # The fit weighs by the optimum of its pilot, which the same seed draws again.
    weights_at = fit_batches(chosen, samples.pilot(24_000, seed=0)).unknowns
    expected, standard_error = scipy_optimum(chosen, samples, weights_at, weights_at)
    return float(((solution.unknowns - expected) / standard_error).abs().max())


@pytest.mark.parametrize("material", MATERIALS, ids=lambda material: material.expression)
def test_fit_ends_at_the_optimum_of_a_general_solver(material: object) -> None:
    samples = Studio(size=32, lights=coloured()).photograph(material, seed=1).samples(dtype=torch.float64)
    assert distance_to_scipy(problem(material.expression, channels=3), samples) < AGREES


def test_fit_of_more_samples_than_the_pilot_ends_at_the_optimum_of_a_general_solver() -> None:
    samples = Studio(size=128).photograph(OrenNayar(0.7, 0.6), seed=2).samples(dtype=torch.float64)
    assert len(samples) > 40_000
    assert distance_to_scipy(problem("oren-nayar"), samples) < AGREES


def test_fit_with_a_tie_ends_at_the_optimum_of_a_general_solver() -> None:
    material = OrenNayar([0.6, 0.5, 0.4], 0.4) + TorranceSparrow(0.04, 0.4)
    samples = Studio(size=32, lights=coloured()).photograph(material, seed=3).samples(dtype=torch.float64)
    chosen = problem("oren-nayar+torrance-sparrow", channels=3, tie=COMMON_SIGMA)
    assert distance_to_scipy(chosen, samples) < AGREES


def test_fit_under_relative_radiometry_ends_at_the_optimum_of_a_general_solver() -> None:
    studio = Studio(size=32, lights=coloured(), relative=True)
    capture = studio.photograph(OrenNayar([0.8, 0.5, 0.3], 0.6), seed=4, brightness=2.0)
    chosen = problem("oren-nayar", channels=3, relative=True)
    assert distance_to_scipy(chosen, capture.samples(dtype=torch.float64)) < AGREES


def test_single_precision_samples_give_the_same_answer() -> None:
    capture = Studio(size=32, lights=coloured()).photograph(MATERIALS[3], seed=5)
    chosen = problem("cook-torrance", channels=3)
    double = fit(chosen, capture.samples(dtype=torch.float64), seed=0)
    single = fit(chosen, capture.samples(), seed=0)
    standard_error = double.statistics.information.inverse().diagonal().sqrt()
    assert float(((single.unknowns - double.unknowns) / standard_error).abs().max()) < 0.01


def test_the_same_seed_gives_the_same_answer() -> None:
    capture = Studio(size=32, lights=coloured()).photograph(MATERIALS[3], seed=6)
    chosen = problem("cook-torrance", channels=3)
    first, second = (fit(chosen, capture.samples(), seed=0) for _ in range(2))
    # Not to the last bit: libraries solve small systems differently at other addresses.
    torch.testing.assert_close(first.unknowns, second.unknowns, rtol=1e-13, atol=0)


def test_a_start_near_the_optimum_replaces_the_search() -> None:
    capture = Studio(size=32, lights=coloured()).photograph(MATERIALS[1], seed=7)
    chosen, samples = problem("oren-nayar", channels=3), capture.samples(dtype=torch.float64)
    said: list[str] = []
    searched = fit(chosen, samples, 0, said.append)
    near = torch.tensor([0.65, 0.55, 0.35, 0.5], dtype=torch.float64)
    started = fit(chosen, samples, 0, start=near)
    standard_error = searched.statistics.information.inverse().diagonal().sqrt()
    # Weights are those of the pilot's optimum, which both reach to a hundredth of a standard error.
    assert float(((started.unknowns - searched.unknowns) / standard_error).abs().max()) < 0.02
    assert said[0] == "searching"
    assert set(said[1:]) == {"refining over all samples"}


@pytest.mark.parametrize("seed", range(12))
def test_a_nearly_smooth_surface_is_not_left_at_the_flat_end(seed: int) -> None:
    # By symmetry every derivative by sigma vanishes at sigma = 0, the worst place for a descent to come by.
    lights = Studio().lights[:2]
    samples = Studio(size=24, lights=lights).photograph(OrenNayar(0.6, 0.08), seed=seed).samples(dtype=torch.float64)
    chosen = problem("oren-nayar")
    solution = fit(chosen, samples, seed=0)
    weights_at = fit_batches(chosen, samples.pilot(24_000, seed=0)).unknowns
    (batch,) = samples.batches(10**7, shuffle=True)
    residuals = weighted_residuals(chosen, batch, weights_at)
    others = [
        scipy_optimum(chosen, samples, torch.tensor([0.6, sigma], dtype=torch.float64), weights_at)[0]
        for sigma in (0.02, 0.1, 0.2)
    ]
    least = min(float(np.sum(residuals(other.numpy()) ** 2)) for other in others)
    # A tenth of a standard error from the optimum.
    assert float(np.sum(residuals(solution.unknowns.numpy()) ** 2)) < least + 0.01


def test_a_parameter_at_its_bound_does_not_disturb_the_others() -> None:
    samples = (
        Studio(size=32, lights=coloured()).photograph(Lambert([0.6, 0.5, 0.4]), seed=8).samples(dtype=torch.float64)
    )
    chosen = problem("lambert+torrance-sparrow", channels=3, fix={"torrance-sparrow.sigma": 0.2})
    solution = fit(chosen, samples, seed=0)
    bound = at_bound(chosen, solution.unknowns, solution.statistics.gradient)
    specular = chosen.where["torrance-sparrow.specular"]
    assert bool((bound[specular] == (solution.unknowns[specular] == 0)).all())
    assert not bool(bound[chosen.where["lambert.albedo"]].any())
    assert distance_to_scipy(chosen, samples) < AGREES


def test_a_problem_without_unknowns_is_only_measured() -> None:
    samples = Studio(size=24).photograph(Lambert(0.6), seed=9).samples()
    solution = fit(problem("lambert", fix={"albedo": 0.6}), samples, seed=0)
    assert solution.unknowns.shape == (0,)
    assert solution.statistics.inflation == pytest.approx(1, abs=0.1)


@pytest.mark.parametrize("expression", ["oren-nayar", "cook-torrance"])
@pytest.mark.parametrize("seed", [3, 4])
def test_steps_that_are_not_looked_at_end_where_small_ones_do(
    expression: str, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Outliers and saturated pixels: many expansions, each far from the last.
    drawn = draw(expression, seed, SPOILT)
    samples = drawn.photograph().samples()
    chosen = problem(expression, channels=samples.channels)
    batches = samples.pilot(24_000, seed=0)
    found = fit_batches(chosen, batches)
    monkeypatch.setattr(importlib.import_module("matest.estimators.pilot"), "_TOLERANCE_SHARE", 0.0)
    slow = fit_batches(chosen, batches)
    assert distance(slow, found) < 0.1


def test_a_long_step_of_a_bent_curve_is_looked_at() -> None:
    # r = 45 atan(10 (u - 0.3)): the first Gauss-Newton step overshoots to the bound.
    chosen = problem("lambert", channels=1)
    labels, visited = torch.tensor([0]), []

    def evaluate(u: Tensor) -> Statistics:
        visited.append(float(u))
        bent, slope = 45 * torch.atan(10 * (u - 0.3)), 450 / (1 + (10 * (u - 0.3)) ** 2)
        gradient, information = (-slope * bent)[None], (slope**2)[None, None]
        return Statistics(labels, information.reshape(1, 1, 1), gradient.reshape(1, 1), scores(cost=float(bent**2)))

    start = torch.tensor([0.5], dtype=torch.float64)
    found = minimise(chosen, start, evaluate, passes=60, tolerance=1.0)
    assert float(found.unknowns) == pytest.approx(0.3, abs=1e-3)
    assert len(visited) > 2


def test_of_optima_that_the_data_cannot_tell_apart_one_inside_the_domain_is_taken() -> None:
    chosen = problem("cook-torrance", channels=1, fix={"f0": 0.04})
    samples = Studio(size=16).photograph(CookTorrance([0.3], [0.5], 0.2)).samples()
    inside = fit_batches(chosen, samples.pilot(24_000, seed=0))
    edge = inside.unknowns.clone()
    edge[chosen.where["slope"]] = float(chosen.domain("slope").upper) - 1e-5
    alike = replace(inside, unknowns=edge)
    assert most_plausible([alike, inside]) is inside
    assert most_plausible([inside, alike]) is inside


@pytest.mark.parametrize("seed", [2, 3])
def test_lobes_come_out_from_narrow_to_wide(seed: int) -> None:
    material = CookTorrance(0.3, 0.7, 0.4, slope_2=0.1, weight_2=0.6, lobes="2")
    samples = Studio().photograph(material, seed=seed).samples()
    chosen = problem(material.expression, fix={"f0": 0.04})
    whole, quick = (fit(chosen, samples, 0, precision=given) for given in (0.0, 0.2))
    for found in (whole, quick):
        values = found.problem.values(found.unknowns)
        assert float(values["slope"]) == pytest.approx(0.1, rel=0.1)
        assert float(values["slope_2"]) == pytest.approx(0.4, rel=0.2)
        assert float(values["weight_2"]) == pytest.approx(0.4, rel=0.2)
    # What is held keeps its place.
    fixed = problem(material.expression, fix={"f0": 0.04, "slope": 0.4})
    values = fixed.values(fit(fixed, samples, 0).unknowns)
    assert (float(values["slope"]), float(values["slope_2"])) == pytest.approx((0.4, 0.1), rel=0.1)


def test_fewer_samples_of_many_lights_in_the_pilot_lead_to_the_same_optimum(monkeypatch: pytest.MonkeyPatch) -> None:
    lights = tuple(directional(tuple(toward.tolist()), 0.3, 0.2, 0.1) for toward in normals(40))
    samples = Studio(size=32, lights=(lights,)).photograph(OrenNayar([0.7, 0.5, 0.3], 0.5), seed=4).samples()
    chosen = problem("oren-nayar", channels=3)
    whole = fit(chosen, samples, seed=0)
    monkeypatch.setattr(importlib.import_module("matest.estimators.fit"), "_PILOT_SHADED", 300 * 40)
    few = fit(chosen, samples, seed=0)
    assert sum(len(tile.batch) for group in few.tiles for tile in (part() for part in group)) == len(samples)
    assert distance(few, whole) < 0.03
