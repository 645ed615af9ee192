"""What a model lacks raises the scale of residuals where it shows, outliers nowhere."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from matest.samples.likelihood import Deviations
from matest.samples.residual_scale import NOISE_ALONE, ResidualScale, half_angle, like_angled
from matest.scene import Points

COUNT = 20_000


def half_angles() -> Tensor:
    """sin² of half angles from 0 to 90°, evenly in the angle."""
    return torch.linspace(0, math.pi / 2, COUNT).sin().square()


def residuals(seed: int = 0) -> Tensor:
    """Absolute residuals of a model that holds, three channels."""
    return torch.randn(COUNT, 3, generator=torch.Generator().manual_seed(seed)).abs()


def scale_of(size: Tensor, clear: Tensor | None = None) -> ResidualScale:
    everywhere = torch.ones_like(size, dtype=torch.bool)
    return ResidualScale.of(half_angles(), Deviations(size, everywhere if clear is None else clear))


def at(scale: ResidualScale, degrees: float) -> float:
    """The scale at a half angle."""
    return float(scale.values[torch.bucketize(math.sin(math.radians(degrees)) ** 2, scale.ends, right=True)])


def test_the_half_angle_is_that_of_the_lit_light_nearest_to_its_mirror_direction() -> None:
    def toward(degrees: float) -> list[float]:
        return [math.sin(math.radians(degrees)), 0.0, math.cos(math.radians(degrees))]

    wi = torch.tensor([[toward(-30), toward(10)], [toward(-30), toward(10)]])
    irradiance = torch.tensor([[[1.0], [1.0]], [[0.0], [1.0]]])
    sin2 = half_angle(Points(wi, torch.tensor([toward(30), toward(30)]), irradiance))
    assert sin2.sqrt().tolist() == pytest.approx([0.0, math.sin(math.radians(20))], abs=1e-6)
    unlit = half_angle(Points(wi, torch.tensor([toward(30)]), torch.zeros(2, 2, 1)))
    assert unlit.tolist() == [1.0, 1.0]
    assert half_angle(Points(wi[:, :0], torch.tensor([toward(30)]), irradiance[:, :0])).tolist() == [1.0, 1.0]


def test_every_sample_has_one_class_and_those_of_one_half_angle_the_same() -> None:
    angles = half_angles()
    angles[5_000:9_000] = 0.5
    ends, classes = like_angled(angles)
    assert len(classes) == len(ends) + 1
    assert torch.equal(torch.cat([*classes]).sort().values, torch.arange(COUNT))
    for number, rows in enumerate(classes):
        assert len(rows) >= 100
        assert (torch.bucketize(angles[rows], ends, right=True) == number).all()
    assert len(like_angled(angles[:150])[1]) == 1


@pytest.mark.parametrize("seed", range(3))
def test_residuals_as_large_as_the_noise_have_a_scale_of_one(seed: int) -> None:
    assert bool((scale_of(residuals(seed)).values == 1).all())
    assert NOISE_ALONE.at(Points(torch.zeros(2, 1, 3), torch.zeros(2, 3), torch.zeros(2, 1, 1))) == 1.0


def test_a_lobe_that_the_model_lacks_raises_the_scale_at_its_half_angles_alone() -> None:
    size = residuals()
    lobe = half_angles() < math.sin(math.radians(2)) ** 2
    size[lobe] += 30
    scale = scale_of(size)
    assert at(scale, 1.0) > 30
    assert at(scale, 5.0) == at(scale, 60.0) == scale.smallest == 1
    angles = scale.above(3.0)
    assert angles is not None
    assert angles[0] == 0
    assert math.degrees(angles[1]) == pytest.approx(2, rel=0.3)
    assert scale.above(1e3) is None


@pytest.mark.parametrize("wild", [10.0, 1e6, 1e30])
def test_scattered_outliers_of_any_size_raise_it_nowhere(wild: float) -> None:
    size = residuals()
    size[torch.rand(COUNT, generator=torch.Generator().manual_seed(1)) < 0.03] = wild
    assert float(scale_of(size).values.max()) < 1.2


def test_values_that_noise_may_clip_count_as_values_but_not_for_the_typical_residual() -> None:
    # A saturated highlight: of the values that are far from it, which are outliers, it is not to be judged.
    size, clear = residuals(), torch.ones(COUNT, 3, dtype=torch.bool)
    highlight = half_angles() < math.sin(math.radians(5)) ** 2
    size[highlight], clear[highlight] = 0.0, False
    size[::50] = 1e3
    assert float(scale_of(size, clear).values.max()) < 1.2
