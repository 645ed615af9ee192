"""Regions of an object are those whose amplitudes stand apart."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from matest.estimators.texels.regions import Regions
from matest.estimators.texels.unknowns import TexelUnknowns
from tests.problems import problem

TEXELS = TexelUnknowns(problem("oren-nayar", channels=3), ("albedo", "sigma"))


def theta(albedo: np.ndarray, noise: float = 0.05) -> Tensor:
    """Texels of some albedos [n], σ being 0.4, [4, n]."""
    generator = np.random.default_rng(0)
    channels = albedo * (1 + noise * generator.standard_normal((3, len(albedo))))
    return torch.from_numpy(np.vstack([channels, np.full((1, len(albedo)), 0.4)]))


@pytest.mark.parametrize("albedos", [[0.3], [0.3, 0.6], [0.1, 0.3, 0.8], [0.06, 0.15, 0.35, 0.8]])
def test_materials_that_stand_apart_are_counted(albedos: list[float]) -> None:
    found = Regions.of(TEXELS, theta(np.resize(albedos, 1_200)), None, 0)
    if len(albedos) > 1:
        np.testing.assert_allclose(np.sort(np.exp(found.features).mean(axis=1)), albedos, rtol=0.03)
    assert found.values.shape[1] == len(albedos)


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.3])
def test_albedos_that_vary_smoothly_are_one_region(noise: float) -> None:
    smooth = np.random.default_rng(1).uniform(0.1, 0.7, 1_200)
    assert len(Regions.of(TEXELS, theta(smooth, noise), None, 0).features) == 1


def test_a_few_odd_texels_are_no_region() -> None:
    albedo = np.full(1_200, 0.3)
    albedo[:10] = 0.01
    assert len(Regions.of(TEXELS, theta(albedo), None, 0).features) == 1


def test_where_no_shape_is_mapped_there_is_one_region() -> None:
    texels = TexelUnknowns(TEXELS.problem, ("albedo",))
    assert len(Regions.of(texels, theta(np.resize([0.3, 0.6], 1_200))[:3], None, 0).features) == 1


def of_scatter(scatter: float, error: float, outliers: int, common: float = 0.3) -> Regions:
    """A region of 1,200 texels of albedo 0.3, known to 0.01, and of σ 0.4 that scatters, some being far off."""
    generator = np.random.default_rng(2)
    values = theta(np.full(1_200, 0.3), 0.03)
    values[3] += torch.from_numpy(math.hypot(scatter, error) * generator.standard_normal(1_200))
    values[3, :outliers] = 0.01
    std = torch.full((4, 1_200), 0.01, dtype=torch.float64)
    std[3] = error
    single, labels = Regions.of(TEXELS, values, 1, 0), torch.zeros(1_200, dtype=torch.int64)
    means = torch.tensor([[common], [0.3], [0.3], [0.4]], dtype=torch.float64)
    return single.filled(labels, values, std, means, torch.zeros_like(means))


@pytest.mark.parametrize("outliers", [0, 60])
def test_the_scatter_is_that_of_most_texels_beyond_their_errors(outliers: int) -> None:
    assert float(of_scatter(0.05, 0.05, outliers).spreads[3, 0]) == pytest.approx(0.055, rel=0.1)


def test_a_region_has_the_albedo_of_its_texels_though_the_fit_in_common_has_none() -> None:
    assert float(of_scatter(0.0, 0.05, 0, common=1e-4).values[0, 0]) == pytest.approx(0.3, rel=0.01)


def test_texels_that_fit_badly_are_drawn_as_strongly_as_by_their_errors() -> None:
    region, labels = of_scatter(0.05, 0.05, 0), torch.zeros(1, dtype=torch.int64)
    untold = torch.zeros(4, 1, dtype=torch.bool)
    plain, bad = (region.prior(labels, untold, inflation).precision for inflation in (1.0, 1.4))
    torch.testing.assert_close(bad, 1.4 * plain)


def test_where_the_model_does_not_hold_shapes_are_the_regions_with_its_scatter_as_their_error() -> None:
    region, labels = of_scatter(0.05, 0.05, 0), torch.zeros(1, dtype=torch.int64)
    untold = torch.zeros(4, 1, dtype=torch.bool)
    prior = region.prior(labels, untold, 7.0)
    # The last row is the shape.
    assert float((7.0 / prior.precision[3]).sqrt()) < 0.01 * float(region.spreads[3, 0])
    torch.testing.assert_close(prior.precision[:3], 7 * region.prior(labels, untold, 1.0).precision[:3])
    assert float(region.errors(7.0)[3, 0]) == pytest.approx(math.hypot(region.spreads[3, 0], region.doubts[3, 0]))
    assert float(region.errors(1.0)[3, 0]) == float(region.doubts[3, 0])
