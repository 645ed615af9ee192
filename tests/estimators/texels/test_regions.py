"""Regions of an object are those whose amplitudes stand apart."""

from __future__ import annotations

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
