"""Whatever fulfils the protocol of samples can be fitted and judged; unknowns may be of images, lights, groups."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import pytest
import torch
from torch import Tensor

import matest
from matest.brdf import Brdf, CookTorrance, OrenNayar
from matest.estimators import Problem, Solution, fit
from matest.estimators.blocks import Block, multipliers
from matest.inference.posterior import judge
from matest.parameters import unit_interval
from matest.samples import Samples
from matest.samples.groups import GroupAxis
from tests.captures import directional
from tests.problems import problem
from tests.samples.table import Table
from tests.simulated import DIRECTIONS, Studio

INCIDENCES = torch.deg2rad(torch.tensor([10.0, 25.0, 40.0, 55.0], dtype=torch.float64))
MATERIALS = {
    "oren-nayar": OrenNayar([0.6, 0.5, 0.4], 0.5),
    "cook-torrance": CookTorrance([0.3, 0.2, 0.1], 0.8, 0.25),
}


def spherical(theta: Tensor, phi: Tensor) -> Tensor:
    return torch.stack([theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()], dim=-1)


def measured(material: Brdf, seed: int, noise: float = 0.002) -> Table:
    """A gonioreflectometer: four incidences in the plane of x, the detector on a lattice of the hemisphere."""
    polar, azimuth = torch.meshgrid(
        torch.linspace(0.02, 1.2, 20, dtype=torch.float64),
        torch.linspace(0, 2 * math.pi, 25).double()[:-1],
        indexing="ij",
    )
    detector = spherical(polar.flatten(), azimuth.flatten())
    wi = spherical(INCIDENCES, torch.full_like(INCIDENCES, math.pi)).repeat_interleave(len(detector), 0)
    wo = detector.repeat(len(INCIDENCES), 1)
    incidence = torch.arange(len(INCIDENCES)).repeat_interleave(len(detector))
    truth = material(wi, wo) * wi[:, 2:]
    std = torch.full_like(truth, noise)
    generator = torch.Generator().manual_seed(seed)
    values = truth + std * torch.randn(truth.shape, generator=generator, dtype=torch.float64)
    return Table(wi, wo, values, std, incidence)


def in_standard_errors(chosen: Problem, solution: Solution, std: Tensor, material: Brdf) -> Tensor:
    return (solution.unknowns - chosen.unknowns_at(material.parameters)) / std


def test_a_table_and_photographs_fulfil_the_protocol() -> None:
    assert isinstance(measured(MATERIALS["oren-nayar"], seed=0), Samples)
    assert isinstance(Studio(size=24).photograph(OrenNayar(0.5, 0.4)).samples(), Samples)


@pytest.mark.parametrize("expression", MATERIALS)
def test_a_table_is_fitted_and_judged_like_photographs(expression: str) -> None:
    material, chosen = MATERIALS[expression], problem(expression, channels=3)
    # Oren-Nayar's second bounce has its strength under lights that are known, and is not reported.
    fixed = {"fixed"} if expression == "oren-nayar" else set[str]()
    errors = []
    for seed in range(4):
        table = measured(material, seed)
        solution = fit(chosen, table, seed=0)
        posterior = judge(solution, table)
        assert solution.converged
        assert posterior.bars.holds
        assert {estimate.status for estimate in posterior.estimates.values()} == {"determined", "fixed"} - fixed
        errors.append(in_standard_errors(chosen, solution, posterior.bars.covariance.std, material))
    squares = torch.stack(errors).square()
    # Mean square of so many errors is 1 within three times √(2/n).
    assert float(squares.mean()) == pytest.approx(1, abs=3 * math.sqrt(2 / squares.numel()))


def test_a_table_trains_a_material() -> None:
    table = measured(MATERIALS["oren-nayar"], seed=1)
    material = matest.Trainable(OrenNayar([0.5, 0.5, 0.5], 0.3), dtype=torch.float64)
    matest.fit_gradient(table, material, epochs=60, batch_size=500)
    assert float(material().parameters["sigma"].detach()) == pytest.approx(0.5, abs=0.02)


def strays(count: int, spread: float, seed: int) -> Tensor:
    return 1 + spread * torch.randn(count, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def exposed(material: Brdf, factors: Tensor, seed: int) -> Samples:
    """Photographs of which each is so many times as bright as its stated exposure says."""
    studio = Studio(size=40)
    radiance = studio.clean(material) * factors.numpy()[:, None, None]
    return studio.expose(radiance, seed).samples(dtype=torch.float64)


def with_exposures(chosen: Problem, samples: Samples, prior: float) -> Problem:
    return replace(chosen, blocks=(*chosen.blocks, multipliers("exposure", "image", prior)), groups=samples.groups)


@pytest.mark.parametrize("expression", ["oren-nayar", "cook-torrance"])
def test_exposures_of_images_are_unknowns_with_a_prior(expression: str) -> None:
    material = {"oren-nayar": OrenNayar(0.6, 0.5), "cook-torrance": CookTorrance(0.3, 0.8, 0.25)}[expression]
    spread, squares, naive = 0.03, [], []
    for seed in range(4):
        factors = strays(6, spread, seed)
        samples = exposed(material, factors, seed)
        plain = problem(expression)
        chosen = with_exposures(plain, samples, spread)
        solution = fit(chosen, samples, seed=0)
        posterior = judge(solution, samples)
        bars = posterior.bars
        assert solution.converged
        assert bars.holds, bars.reason
        assert bars.kind == "fisher"
        assert posterior.nuisance["exposure"].status == "determined"
        assert posterior.nuisance["exposure"].value == pytest.approx(solution.unknowns[plain.size :].tolist())
        truth = torch.cat([plain.unknowns_at(material.parameters), factors])
        errors = (solution.unknowns - truth) / bars.covariance.std
        squares.append(errors.square())
        stray = fit(plain, samples, seed=0).unknowns - plain.unknowns_at(material.parameters)
        naive.append(float((stray.abs() / bars.covariance.std[: plain.size]).max()))
    mean = float(torch.stack(squares).mean())
    # Errors of exposures and albedo hang together: as if by some three independent ones a capture.
    assert 0.2 < mean < 2.5
    # Without the block parameters are off by more than these error bars.
    assert max(naive) > 2.5


def test_no_prior_leaves_the_common_factor_of_exposures_and_albedo_open() -> None:
    samples = exposed(OrenNayar(0.6, 0.5), strays(6, 0.03, 0), 0)
    plain = problem("lambert")
    chosen = replace(plain, blocks=(*plain.blocks, multipliers("exposure", "image", None)), groups=samples.groups)
    posterior = judge(fit(chosen, samples, seed=0), samples)
    assert posterior.estimates["albedo"].status == "not determined"


def bracketed(lights: Sequence[Tensor], seed: int) -> Samples:
    """Photographs of the same lights with two exposures each."""
    studio = Studio(size=24, lights=tuple((directional(d, 3.0),) for d in DIRECTIONS[:3] for _ in range(2)))
    radiance = studio.clean(OrenNayar(0.6, 0.5)) * torch.cat(list(lights)).repeat_interleave(2).numpy()[:, None, None]
    return studio.expose(radiance, seed).samples(dtype=torch.float64)


@pytest.mark.parametrize("expression", ["oren-nayar", "cook-torrance"])
@pytest.mark.parametrize("axes", [("image",), ("light",), ("group",), ("image", "light")])
def test_gradients_by_multipliers_are_those_of_the_cost(expression: str, axes: tuple[GroupAxis, ...]) -> None:
    samples, plain = bracketed([strays(3, 0.03, 1)], 1), problem(expression)
    blocks = tuple(multipliers(f"multiple of {axis}", axis, 0.03) for axis in axes)
    chosen = replace(plain, blocks=(*plain.blocks, *blocks), groups=samples.groups)
    unknowns = torch.cat([0.9 * plain.anywhere, strays(chosen.size - plain.size, 0.02, 2)])
    statistics = matest.estimators.accumulate(chosen, unknowns, samples.tiles(), unknowns)
    assert statistics.information.shape == (chosen.size, chosen.size)
    by_image = statistics.regrouped(samples.groups.image)
    torch.testing.assert_close(by_image.information, statistics.information)
    torch.testing.assert_close(by_image.gradient, statistics.gradient)
    step = 1e-5
    for position in [*range(plain.size), *range(plain.size, chosen.size, 37), chosen.size - 1]:
        ahead, behind = unknowns.clone(), unknowns.clone()
        ahead[position] += step
        behind[position] -= step
        costs = [matest.estimators.accumulate(chosen, u, samples.tiles(), unknowns).cost for u in (ahead, behind)]
        gradient = float(statistics.gradient[position])
        assert (costs[1] - costs[0]) / (4 * step) == pytest.approx(gradient, rel=1e-4, abs=1e-2)


def test_one_light_has_one_power_however_many_images_it_lights() -> None:
    powers, plain, squares = strays(3, 0.03, 5), problem("oren-nayar"), []
    for seed in range(6):
        samples = bracketed([powers], seed)
        block = multipliers("light_power", "light", 0.03)
        chosen = replace(plain, blocks=(*plain.blocks, block), groups=samples.groups)
        posterior = judge(fit(chosen, samples, seed=0), samples)
        power, covariance = torch.tensor(posterior.nuisance["light_power"].value), posterior.bars.covariance.matrix
        assert len(power) == 3
        # Ratios are known far better than the prior knows any.
        for other in (1, 2):
            contrast = torch.zeros(chosen.size, dtype=torch.float64)
            contrast[plain.size], contrast[plain.size + other] = -1, 1
            variance = contrast @ covariance @ contrast
            assert variance < 0.006**2
            squares.append(float((power[other] - power[0] - (powers[other] - powers[0])) ** 2 / variance))
    # Within three times √(2/n) of the mean square of so many errors.
    assert sum(squares) / len(squares) == pytest.approx(1, abs=3 * math.sqrt(2 / len(squares)))


def test_powers_of_lights_need_one_light_an_image() -> None:
    pairs = tuple((directional(a, 3.0), directional(b, 3.0)) for a, b in itertools.pairwise(DIRECTIONS[:3]))
    samples, plain = Studio(size=24, lights=pairs).photograph(OrenNayar(0.6, 0.5), 0).samples(), problem("oren-nayar")
    block = multipliers("light_power", "light", 0.03)
    with pytest.raises(ValueError, match="one light each"):
        fit(replace(plain, blocks=(*plain.blocks, block), groups=samples.groups), samples, seed=0)


def test_only_multipliers_are_for_images_lights_or_groups() -> None:
    for axis, kind in (("image", "parameter"), ("one", "multiplier")):
        with pytest.raises(ValueError, match="cannot have the axis"):
            Block("albedo", unit_interval, axis, kind)
