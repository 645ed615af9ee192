"""Materials that differ from place to place."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from matest.benchmark.instruments.photographs import sphere
from matest.benchmark.instruments.varying import KINDS, estimated, known_to, photographed, relative_errors, tells
from matest.estimation.parameter_map import ParameterMap, TexelStatus

SURFACE = sphere(32)


@pytest.mark.parametrize("name", KINDS)
def test_every_map_varies_within_its_range_and_the_rest_is_one_value(name: str) -> None:
    kind = KINDS[name]
    material = photographed(kind, SURFACE, 2, seed=3).material
    for mapped, (low, high) in kind.ranges.items():
        value = material.parameters[mapped]
        assert len(value) == len(SURFACE)
        assert low < float(value.min()) < low + 0.4 * (high - low)
        assert low + 0.6 * (high - low) < float(value.max()) < high
    for shared, value in {**kind.shared, **kind.fixed}.items():
        torch.testing.assert_close(material.parameters[shared], torch.tensor(value, dtype=torch.float64))


def test_a_seed_draws_the_same_and_another_one_something_else() -> None:
    first, again, other = (photographed(KINDS["oren-nayar"], SURFACE, 2, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.photograph().radiance(0), again.photograph().radiance(0))
    assert not torch.equal(first.material.parameters["sigma"], other.material.parameters["sigma"])


def test_two_materials_meet_in_the_middle() -> None:
    material = photographed(KINDS["oren-nayar"], SURFACE, 2, seed=1, materials=2).material
    left = torch.from_numpy(SURFACE.pixels % 32) < 16
    for value in (material.parameters["albedo"], material.parameters["sigma"]):
        assert len(value[left].unique()) == len(value[~left].unique()) == 1
        assert len(value.unique()) == 2


def test_what_is_fixed_is_stated_and_what_varies_has_a_map() -> None:
    kind = KINDS["cook-torrance"]
    estimate = estimated(kind, photographed(kind, SURFACE, 4, seed=0).photograph())
    assert set(estimate.maps) == {"diffuse", "slope"}
    assert estimate.parameters["f0"].status == "fixed"
    assert estimate.parameters["specular"].status != "fixed"


def test_pixels_are_known_by_their_own_photographs_and_small_errors() -> None:
    status = torch.tensor([TexelStatus.DETERMINED, TexelStatus.SHARED, TexelStatus.AT_BOUND, TexelStatus.UNSEEN])
    value, std = torch.full((4, 1), 0.5), torch.tensor([[0.004], [0.004], [0.006], [0.004]])
    one = ParameterMap("slope", value, std, status)
    assert tells(one).tolist() == [True, False, True, False]
    assert known_to(one, 0.01).tolist() == [True, False, False, False]


def test_errors_are_relative_to_the_truth() -> None:
    errors = relative_errors(torch.tensor([[0.5], [0.4]]), torch.tensor([[0.4], [0.5]], dtype=torch.float64))
    assert errors.flatten().tolist() == pytest.approx([0.25, 0.2])
