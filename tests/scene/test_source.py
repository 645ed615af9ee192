"""Sources with a size, against sums over many points of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from matest.brdf import Brdf, CookTorrance, Lambert
from matest.brdf.curvature import curvature
from matest.scene import PointLight, illuminate
from matest.scene.source import LARGEST_ORDER, Source
from matest.shading import shade
from tests.quadrature_of_sources import radiance

INTENSITY = torch.tensor([2.0], dtype=torch.float64)
AXIS = torch.tensor([0.0, 0.0, -1.0], dtype=torch.float64)


def panel(place: tuple[float, ...], width: float, height: float, *, disc: bool = False, order: int = 3) -> PointLight:
    sides = torch.tensor([[width / 2, 0, 0], [0, height / 2, 0]], dtype=torch.float64)
    position = torch.tensor(place, dtype=torch.float64)
    return PointLight(position, INTENSITY, axis=AXIS, source=Source(sides, disc, order))


def normals_at(*angles: float) -> Tensor:
    """Normals that tilt by so much from z, toward −x and a little toward y, [n, 3]."""
    tilt = torch.tensor(angles, dtype=torch.float64)
    turned = torch.stack([-tilt.sin(), 0.3 * tilt.sin(), tilt.cos()], dim=1)
    return torch.nn.functional.normalize(turned, dim=1)


def shaded(light: PointLight, normals: Tensor, material: Brdf) -> Tensor:
    view = torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64)
    return shade(material, illuminate(normals, view, [light], positions=torch.zeros_like(normals)))[:, 0]


def summed(light: PointLight, normals: Tensor, material: Brdf) -> Tensor:
    """The same from 200×200 points of the source."""
    assert light.source is not None
    return torch.tensor(
        radiance(
            light.position.numpy(),
            light.source.sides.numpy(),
            disc=light.source.round,
            axis=AXIS.numpy(),
            intensity=2.0,
            normals=normals.numpy(),
            brdf=lambda wi, wo: material(torch.from_numpy(wi), torch.from_numpy(wo))[..., 0].numpy(),
        )
    )


@pytest.mark.parametrize("disc", [False, True], ids=["rectangle", "disc"])
def test_a_matte_surface_sees_a_source_from_its_rise_to_the_zenith(disc: bool) -> None:
    light = panel((0.9, 0.2, 0.5), 0.4, 0.3 if not disc else 0.4, disc=disc)
    # The source sets between 0.9 and 1.3 rad.
    normals = normals_at(*np.linspace(-0.6, 1.5, 60))
    expected = summed(light, normals, Lambert(albedo=0.6))
    assert int(((expected > 0) & (expected < 0.05 * expected.max())).sum()) > 3
    error = (shaded(light, normals, Lambert(albedo=0.6)) - expected).abs().max() / expected.max()
    assert error < 5e-4


@pytest.mark.parametrize("disc", [False, True], ids=["rectangle", "disc"])
@pytest.mark.parametrize(("slope", "half"), [(0.3, 0.3), (0.1, 0.08), (0.1, 0.2)])
def test_highlights_of_a_source_are_exact_with_the_nodes_that_their_curvature_asks_for(
    disc: bool, slope: float, half: float
) -> None:
    material = CookTorrance(diffuse=0.2, specular=0.5, slope=slope)
    light = panel((0.3, 0.1, 1.0), 2 * half, 2 * half, disc=disc)
    assert light.source is not None
    distance = float(light.position.norm())
    source = light.source.for_curvature(curvature(material), distance)
    assert source.order < LARGEST_ORDER
    light = PointLight(light.position, light.intensity, axis=light.axis, source=source)
    normals = normals_at(*np.linspace(-0.7, 0.5, 16))
    expected = summed(light, normals, material)
    assert (shaded(light, normals, material) - expected).abs().max() < 3e-3 * expected.max()


def test_a_far_or_small_source_is_a_point() -> None:
    source = Source(torch.eye(3, dtype=torch.float64)[:2] * 0.01)
    assert source.for_curvature(1.0, 1.0).nodes == 1
    assert source.for_curvature(1.0, 0.1).nodes == 4
    assert source.for_curvature(5000.0, 1.0).nodes > 4
    assert source.for_curvature(1e9, 1.0).order == LARGEST_ORDER


def test_a_source_radiates_in_all_what_its_point_does() -> None:
    light = panel((0.0, 0.0, 30.0), 0.4, 0.2)
    up = normals_at(0.0)
    far = PointLight(light.position, light.intensity, axis=light.axis)
    torch.testing.assert_close(
        shaded(light, up, Lambert(albedo=0.5)), shaded(far, up, Lambert(albedo=0.5)), rtol=1e-4, atol=0
    )
    assert light.source is not None
    assert float(light.source.area) == pytest.approx(0.08)
    disc = Source(light.source.sides[:1].repeat(2, 1), round=True)
    assert float(disc.area) == pytest.approx(math.pi * 0.04)


@pytest.mark.parametrize("disc", [False, True], ids=["rectangle", "disc"])
def test_gradients_of_a_half_risen_source_are_right(disc: bool) -> None:
    def value(position: Tensor, sides: Tensor, normal: Tensor) -> Tensor:
        light = PointLight(position, INTENSITY, axis=AXIS, source=Source(sides, disc, 3))
        unit = torch.nn.functional.normalize(normal, dim=-1)
        return shaded(light, unit, CookTorrance(diffuse=0.3, specular=0.3, slope=0.4))

    position = torch.tensor([0.9, 0.2, 0.02], dtype=torch.float64, requires_grad=True)
    sides = torch.tensor([[0.02, 0.0, 0.2], [0.1, 0.2, -0.03]], dtype=torch.float64, requires_grad=True)
    normal = torch.tensor([[0.05, 0.02, 1.0], [-0.1, 0.0, 1.0]], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(value, (position, sides, normal))


def test_level_and_sunken_sources_have_finite_gradients() -> None:
    position = torch.tensor([0.0, 0.0, 1.0], requires_grad=True)
    sides = torch.tensor([[0.1, 0.0, 0.0], [0.0, 0.1, 0.0]], requires_grad=True)
    normals = torch.tensor([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    source = Source(sides, round=True)
    light = PointLight(position, INTENSITY.float(), axis=AXIS.float(), source=source)
    shaded_points = illuminate(normals, normals, [light], positions=torch.zeros_like(normals))
    value = shade(Lambert(albedo=0.5), shaded_points)
    assert float(value[1].detach()) == 0
    value.sum().backward()
    for tensor in (position, sides):
        assert tensor.grad is not None
        assert bool(torch.isfinite(tensor.grad).all())
