"""Valleys of χ²: bent, locked, and flat at a bound."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest
import torch
from torch import Tensor

from matest.brdf import CookTorrance, OrenNayar
from matest.estimators import Solution, Statistics
from matest.estimators.levenberg_marquardt import Evaluate
from matest.estimators.moments import scores
from matest.inference.error_bars import error_bars
from matest.inference.expansion import Expansion
from matest.inference.lobes import LobesNotSeen
from matest.inference.profiles import Surroundings
from matest.inference.valleys import locked_unknowns
from tests.inference.judged import Judged, judged, source
from tests.problems import problem
from tests.simulated import Studio

FEW = Studio(size=24, lights=Studio().lights[:2])
METAL = "cook-torrance(fresnel=conductor)"


@cache
def with_lobe() -> Judged:
    return judged(Studio(size=24).photograph(CookTorrance(0.4, 0.6, 0.25), 0), "cook-torrance")


@cache
def metal(lights: int, seed: int) -> Judged:
    material = CookTorrance(0.0, 1.0, 0.2, eta=1.5, k=3.0, fresnel="conductor")
    capture = Studio(size=32, lights=Studio().lights[:lights]).photograph(material, seed)
    return judged(capture, METAL, fix={"diffuse": 0.0, "specular": 1.0})


def test_n_and_k_of_a_metal_lie_along_a_bent_valley() -> None:
    found = metal(3, 2)
    assert found.posterior.valleys.bent >= found.positions("eta", "k")
    assert not found.posterior.valleys.bent & found.positions("slope")


def test_a_straight_valley_is_not_bent() -> None:
    assert with_lobe().posterior.valleys.bent == frozenset()


def product_with(steepness: float) -> Evaluate:
    """Statistics of one value, known to 1e-4, that is albedo · (1 + steepness · sigma²); measured: 0.5."""

    def evaluate(unknowns: Tensor) -> Statistics:
        albedo, sigma = unknowns.tolist()
        residual = 0.5 - albedo * (1 + steepness * sigma**2)
        slope = torch.tensor([1 + steepness * sigma**2, 2 * steepness * albedo * sigma], dtype=torch.float64)
        cost = 1e8 * residual**2
        found = scores(cost=cost, chi2=cost, values=1e6, samples=1e6, squared_signal=1.0)
        return Statistics(torch.zeros(1).long(), 1e8 * torch.outer(slope, slope)[None], 1e8 * residual * slope[None],
                          found)  # fmt: skip

    return evaluate


def smooth(steepness: float) -> tuple[Solution, Evaluate]:
    """The optimum of such a value at sigma = 0, where sigma has no effect to first order."""
    unknowns, evaluate = torch.tensor([0.5, 0.0], dtype=torch.float64), product_with(steepness)
    return Solution(problem("oren-nayar"), unknowns, evaluate(unknowns), 1, 0.0, True), evaluate


@pytest.mark.parametrize(("steepness", "locked"), [(8.0, {0}), (1e-6, set())])
def test_what_moves_with_an_unknown_without_effect_is_locked(steepness: float, locked: set[int]) -> None:
    solution, evaluate = smooth(steepness)
    bars = error_bars(solution, source(1))
    assert (
        locked_unknowns(Expansion.of(solution), bars, LobesNotSeen(), lambda: Surroundings(solution, evaluate))
        == locked
    )


def test_an_unknown_at_a_flat_bound_has_a_profile_of_its_own_and_locks_nothing() -> None:
    solution, evaluate = smooth(8.0)
    bars = error_bars(solution, source(1))
    around = lambda: Surroundings(solution, evaluate)  # noqa: E731
    assert locked_unknowns(Expansion.of(solution), bars, LobesNotSeen(), around, flat={1: 0.1}) == frozenset()


def test_a_gauge_without_effect_locks_nothing() -> None:
    solution, evaluate = smooth(8.0)
    gauge = problem("oren-nayar", relative=True, fix={"sigma": 0.3}).limited(1.5)
    solution = replace(solution, problem=gauge)
    bars = error_bars(solution, source(1))
    around = lambda: Surroundings(solution, evaluate)  # noqa: E731
    assert locked_unknowns(Expansion.of(solution), bars, LobesNotSeen(), around) == frozenset()


def test_nothing_is_locked_where_everything_has_an_effect() -> None:
    assert with_lobe().posterior.valleys.locked == frozenset()


def test_a_smooth_surface_is_flat_in_its_sigma() -> None:
    found = judged(FEW.photograph(OrenNayar(0.6, 0.0), 0), "oren-nayar")
    (position,) = found.positions("sigma")
    assert {*found.posterior.valleys.flat} == {position}
    assert 0.01 < found.posterior.valleys.flat[position] < 0.2
    sigma = found.posterior.estimates["sigma"]
    assert (sigma.value, sigma.std, sigma.status) == (0.0, None, "at bound")
    assert sigma.interval95[0] == 0


def test_a_rough_surface_is_not_flat_in_its_sigma() -> None:
    assert judged(FEW.photograph(OrenNayar(0.6, 0.5), 0), "oren-nayar").posterior.valleys.flat == {}
