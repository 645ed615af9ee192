"""What the images hardly see where a solution stands: lobes that are not there, valleys that bend, flat bounds."""

from __future__ import annotations

from functools import cache

import pytest
import torch
from torch import Tensor

from matest.brdf import CookTorrance, Lambert, OrenNayar
from matest.estimators import Solution, Statistics
from matest.estimators.levenberg_marquardt import Evaluate
from matest.estimators.moments import scores
from matest.inference.error_bars import error_bars
from matest.inference.profiles import Surroundings
from matest.inference.unseen import faint, locked_with_unseen, unseen_amplitudes, widening
from tests.inference.judged import Judged, judged, source
from tests.problems import problem
from tests.simulated import Studio

FEW = Studio(size=24, lights=Studio().lights[:2])
METAL = "cook-torrance(fresnel=conductor)"


@cache
def without_lobe() -> Judged:
    return judged(Studio(size=24).photograph(Lambert(0.6), 0), "cook-torrance")


@cache
def with_lobe() -> Judged:
    return judged(Studio(size=24).photograph(CookTorrance(0.4, 0.6, 0.25), 0), "cook-torrance")


@cache
def metal(lights: int, seed: int) -> Judged:
    material = CookTorrance(0.0, 1.0, 0.2, eta=1.5, k=3.0, fresnel="conductor")
    capture = Studio(size=32, lights=Studio().lights[:lights]).photograph(material, seed)
    return judged(capture, METAL, fix={"diffuse": 0.0, "specular": 1.0})


def test_a_lobe_of_no_strength_is_not_seen() -> None:
    found = without_lobe()
    assert faint(found.solution, found.bars, "slope")
    assert unseen_amplitudes(found.solution, found.bars) == {"specular"}


def test_the_interval_of_a_lobe_that_is_not_seen_begins_at_zero() -> None:
    assert without_lobe().estimates["specular"].interval95[0] == 0


def test_a_lobe_of_some_strength_is_seen() -> None:
    found = with_lobe()
    assert not faint(found.solution, found.bars, "slope")
    assert unseen_amplitudes(found.solution, found.bars) == set()


def test_an_amplitude_shapes_no_lobe() -> None:
    found = without_lobe()
    assert not faint(found.solution, found.bars, "diffuse")
    assert not faint(found.solution, found.bars, "specular")


def test_n_and_k_of_a_metal_lie_along_a_bent_valley() -> None:
    found = metal(3, 2)
    assert found.bars.bent >= found.positions("eta", "k")
    assert not found.bars.bent & found.positions("slope")


def test_a_straight_valley_is_not_bent() -> None:
    assert with_lobe().bars.bent == frozenset()


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
    assert locked_with_unseen(solution, bars, lambda: Surroundings(solution, evaluate)) == locked


def test_nothing_is_locked_where_everything_has_an_effect() -> None:
    assert with_lobe().bars.locked == frozenset()


def test_a_smooth_surface_is_flat_in_its_sigma() -> None:
    found = judged(FEW.photograph(OrenNayar(0.6, 0.0), 0), "oren-nayar")
    (position,) = found.positions("sigma")
    assert {*found.bars.flat} == {position}
    assert 0.01 < found.bars.flat[position] < 0.2
    sigma = found.estimates["sigma"]
    assert (sigma.value, sigma.std, sigma.status) == (0.0, None, "at bound")
    assert sigma.interval95[0] == 0


def test_a_rough_surface_is_not_flat_in_its_sigma() -> None:
    assert judged(FEW.photograph(OrenNayar(0.6, 0.5), 0), "oren-nayar").bars.flat == {}


def test_error_bars_of_noise_alone_are_not_widened_and_jackknifed_ones_are() -> None:
    found = with_lobe()
    assert widening(found.solution, found.bars) == pytest.approx(1)
    missed = judged(Studio(size=24).photograph(CookTorrance(0.4, 0.8, 0.2), 0), "lambert")
    assert missed.bars.kind == "jackknife over images"
    assert widening(missed.solution, missed.bars) > 1.2
