"""Facets of two widths."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from matest.brdf.microfacet import smith_ggx
from matest.directions import Directions, from_angles
from matest.export.conversion import pairs
from matest.export.facets import beckmann_facets, correlated_ggx, ggx_facets, is_pair, pair, reach, separate_ggx

SAMPLE = pairs(200)
DIRECTIONS = Directions(SAMPLE.wi, SAMPLE.wo)
ONE = torch.tensor(0.2, dtype=torch.float64)
ALIKE = ONE.expand(2)
TWO = torch.tensor([0.3, 0.1], dtype=torch.float64)


@pytest.mark.parametrize("function", [beckmann_facets, ggx_facets, separate_ggx, correlated_ggx])
def test_two_widths_that_are_alike_are_one(function) -> None:
    torch.testing.assert_close(function(DIRECTIONS, ALIKE), function(DIRECTIONS, ONE), rtol=1e-9, atol=0)
    assert not torch.allclose(function(DIRECTIONS, TWO), function(DIRECTIONS, ONE), rtol=1e-2)


def test_masking_of_one_width_is_smiths() -> None:
    torch.testing.assert_close(separate_ggx(DIRECTIONS, ONE), smith_ggx(DIRECTIONS, ONE))


@pytest.mark.parametrize("facets", [beckmann_facets, ggx_facets])
def test_facets_cover_the_surface_once(facets) -> None:
    # With light and viewer on the half vector the directions are those of the facets: ∫ D cos α dω = 1.
    nodes, weights = np.polynomial.legendre.leggauss(200)
    # tan α = t/(1 − t): facets far out have their share.
    t, azimuth = np.meshgrid((nodes + 1) / 2, math.pi * (nodes + 1), indexing="ij")
    theta = np.arctan(t / (1 - t))
    half = from_angles(torch.from_numpy(theta).flatten(), torch.from_numpy(azimuth).flatten())
    slant = 1 / ((1 - t) ** 2 + t**2)
    measure = np.outer(weights / 2, math.pi * weights) * np.sin(theta) * np.cos(theta) * slant
    density = facets(Directions(half, half), TWO)[:, 0].numpy()
    assert (density * measure.flatten()).sum() == pytest.approx(1, rel=2e-3)


def test_reach_is_the_width_along_the_azimuth() -> None:
    azimuth = torch.tensor([0.0, 0.5 * math.pi, 0.7], dtype=torch.float64)
    light = from_angles(torch.tensor(0.6, dtype=torch.float64), azimuth)
    toward, away = reach(Directions(light, light), TWO)
    along = torch.sqrt((0.3 * azimuth.cos()) ** 2 + (0.1 * azimuth.sin()) ** 2) * math.sin(0.6)
    torch.testing.assert_close(toward[:, 0], along)
    torch.testing.assert_close(away, toward)


def test_a_width_of_a_map_is_one() -> None:
    assert not is_pair(ONE)
    assert not is_pair(ONE[None])
    assert is_pair(TWO)
    assert pair(ONE[None]) == [0.2, 0.2]
    assert pair(TWO) == [0.3, 0.1]
