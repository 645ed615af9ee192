"""A map says of every pixel what its value is worth."""

from __future__ import annotations

import math

import torch

from matest.brdf import OrenNayar
from matest.estimation.parameter_map import ParameterMap, TexelStatus, map_file, with_maps


def albedo() -> ParameterMap:
    value = torch.tensor([[0.2], [0.4], [math.nan], [0.3]])
    status = [TexelStatus.DETERMINED, TexelStatus.AT_BOUND, TexelStatus.UNSEEN, TexelStatus.SHARED]
    return ParameterMap("albedo", value, 0.1 * value, torch.tensor(status, dtype=torch.uint8))


def test_values_of_a_pixel_of_its_own_count_as_determined() -> None:
    assert albedo().determined == 0.5


def test_pixels_that_nothing_shows_take_the_mean_of_the_others() -> None:
    each = albedo()
    assert float(each.mean) == float(each.filled[2]) == torch.tensor([0.2, 0.4, 0.3]).mean()


def test_a_material_gets_a_value_at_every_pixel() -> None:
    material = with_maps(OrenNayar(0.5, 0.3), {"albedo": albedo()})
    assert material.parameters["albedo"].shape == (4, 1)
    assert float(material.parameters["sigma"]) == 0.3


def test_files_are_named_by_parameter_and_kind() -> None:
    assert map_file("lambert.albedo") == "maps/lambert.albedo.exr"
    assert map_file("albedo", "std") == "maps/albedo_std.exr"
