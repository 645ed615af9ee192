"""Directions in the local frame and what follows from them."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from matest.directions import Directions, above_horizon, to_local
from tests import tolerances
from tests.exact import angles_and_directions, relative_deviation
from tests.sampling import closed_domain_pairs, degrees, random_pairs, spherical

QUANTITIES = [
    "cos_i",
    "cos_o",
    "sin_i",
    "sin_o",
    "theta_i",
    "theta_o",
    "tangential",
    "half_squared",
    "cos_d",
    "cos2_half",
    "tan2_half",
    "theta_half",
]


def unit_normals(n: int, seed: int) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.nn.functional.normalize(torch.randn(n, 3, generator=generator, dtype=torch.float64), dim=-1)


def test_angles_are_those_of_fifty_digits() -> None:
    geometries, wi, wo = angles_and_directions(100, seed=1)
    d = Directions(wi, wo)
    for actual, expected in (
        (d.theta_i, [g.theta_i for g in geometries]),
        (d.theta_o, [g.theta_o for g in geometries]),
        (d.theta_half, [g.alpha for g in geometries]),
        (d.cos_d, [g.cos_difference for g in geometries]),
        (d.cos2_half, [g.half[2] ** 2 for g in geometries]),
        (d.tan2_half, [1 / g.half[2] ** 2 - 1 for g in geometries]),
    ):
        assert relative_deviation(actual, expected) < tolerances.INDEPENDENT


def test_tangential_carries_the_azimuth() -> None:
    wi, wo = spherical(0.7, 0.2), spherical(1.1, 1.5)
    expected = math.sin(0.7) * math.sin(1.1) * math.cos(1.3)
    assert Directions(wi, wo).tangential.item() == pytest.approx(expected, rel=tolerances.INDEPENDENT)


def test_half_vector_relates_the_cosines() -> None:
    """cos θi + cos θr = 2 cos θh cos α, and |L+V|² = 4 cos²θh."""
    d = Directions(*random_pairs(200, seed=2))
    torch.testing.assert_close(d.cos_i + d.cos_o, 2 * d.cos_d * d.cos2_half.sqrt())
    torch.testing.assert_close(d.half_squared, 4 * d.cos_d.square())


def test_rounding_makes_no_cosine_larger_than_one() -> None:
    wi = unit_normals(1000, seed=10).float()
    assert (Directions(wi, wi).half_squared > 4).any()
    assert Directions(wi, wi).cos_d.max() == 1


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_every_quantity_has_one_channel_and_is_computed_once(quantity: str) -> None:
    d = Directions(*(vector.reshape(3, 4, 3) for vector in random_pairs(12, seed=3)))
    assert getattr(d, quantity).shape == (3, 4, 1)
    assert getattr(d, quantity) is getattr(d, quantity)


@pytest.mark.parametrize("quantity", QUANTITIES)
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32], ids=["float64", "float32"])
def test_every_quantity_has_finite_derivatives_on_the_closed_domain(quantity: str, dtype: torch.dtype) -> None:
    wi, wo = (vector.requires_grad_() for vector in closed_domain_pairs(dtype))
    directions, _ = above_horizon(wi, wo)
    value = getattr(directions, quantity)
    assert value.isfinite().all()
    for gradient in torch.autograd.grad(value.sum(), [wi, wo], materialize_grads=True, allow_unused=True):
        assert gradient.isfinite().all()


@pytest.mark.parametrize("offset", [1e-2, 1e-4, 1e-6])
def test_small_and_grazing_angles_keep_their_digits_in_float32(offset: float) -> None:
    single = [spherical(theta).float() for theta in (offset, math.pi / 2 - offset)]
    d, exact = (Directions(*(vector.to(dtype) for vector in single)) for dtype in (torch.float32, torch.float64))
    for quantity in ("theta_i", "theta_o", "sin_i", "cos_o"):
        assert getattr(d, quantity).item() == pytest.approx(
            getattr(exact, quantity).item(), rel=tolerances.FLOAT32_GEOMETRY
        )


@pytest.mark.parametrize("tilt", [1e-1, 1e-3, 1e-5])
def test_half_angle_near_the_mirror_direction_keeps_its_digits_in_float32(tilt: float) -> None:
    single = spherical(0.8 + tilt).float(), spherical(0.8 - tilt, math.pi).float()
    d, exact = (Directions(*(vector.to(dtype) for vector in single)) for dtype in (torch.float32, torch.float64))
    for quantity in ("tan2_half", "theta_half"):
        assert getattr(d, quantity).item() == pytest.approx(
            getattr(exact, quantity).item(), rel=tolerances.FLOAT32_GEOMETRY
        )


@pytest.mark.parametrize("cosine", [1e-2, 1e-5, 1e-8, 1e-12])
def test_half_vector_of_opposite_grazing_directions_is_the_normal(cosine: float) -> None:
    sine = math.sqrt(1 - cosine * cosine)
    wi = torch.tensor([sine, 0.0, cosine], dtype=torch.float64)
    d = Directions(wi, wi * torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64))
    assert d.cos2_half.item() == pytest.approx(1, rel=tolerances.INDEPENDENT)
    assert d.tan2_half.item() == 0


def test_both_ends_must_be_above_the_horizon() -> None:
    wi = torch.stack([degrees(40), degrees(95), degrees(40), degrees(100)])
    wo = torch.stack([degrees(50), degrees(50), degrees(91), degrees(120)])
    assert above_horizon(wi, wo)[1].squeeze(-1).tolist() == [True, False, False, False]


def test_pairs_below_the_horizon_are_evaluated_at_the_normal() -> None:
    directions, _ = above_horizon(degrees(100), degrees(20))
    assert directions.cos_i.item() == directions.cos_o.item() == 1


def test_local_frame_has_the_normal_as_z() -> None:
    normal = unit_normals(200, seed=4)
    (local,) = to_local(normal, normal)
    expected = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64).expand_as(local)
    torch.testing.assert_close(local, expected, rtol=0, atol=tolerances.INDEPENDENT)


def test_local_frame_is_a_rotation() -> None:
    normal = unit_normals(200, seed=5)
    axes = torch.eye(3, dtype=torch.float64)
    frame = torch.stack(to_local(normal, *axes), dim=-1)
    torch.testing.assert_close(frame @ frame.mT, axes.expand_as(frame), rtol=0, atol=tolerances.INDEPENDENT)
    torch.testing.assert_close(torch.linalg.det(frame), torch.ones(200, dtype=torch.float64))


def test_local_frame_facing_the_viewer_is_the_world() -> None:
    vectors = unit_normals(20, seed=6)
    (local,) = to_local(degrees(0).expand(20, 3), vectors)
    torch.testing.assert_close(local, vectors)


def test_local_frame_along_the_world_axis_is_finite() -> None:
    normal = torch.tensor([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.9, math.sqrt(0.19), 0.0]])
    (local,) = to_local(normal, normal.roll(1, dims=-1))
    torch.testing.assert_close(local.norm(dim=-1), torch.ones(4))


def test_local_frame_leaves_angles_between_vectors() -> None:
    normal, a, b = (unit_normals(100, seed=seed) for seed in (7, 8, 9))
    local_a, local_b = to_local(normal, a, b)
    torch.testing.assert_close((local_a * local_b).sum(-1), (a * b).sum(-1), rtol=0, atol=tolerances.INDEPENDENT)
