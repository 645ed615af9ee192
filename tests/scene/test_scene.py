from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch

from matest.brdf import CookTorrance, Lambert, OrenNayar
from matest.directions import to_local
from matest.scene import Camera, Scene
from matest.scene.bits import Bits
from matest.scene.surface import from_normals
from matest.shading import render
from tests.captures import directional, point, scene_of, sphere_surface

DOUBLE = torch.float64
NEAR = (0.8, 0.6, 2.5)
FAR = (0.3, 0.4, 0.9)


def total(scene: Scene, material: object) -> torch.Tensor:
    """A scalar that depends on every pixel differently."""
    images = render(scene, material, dtype=DOUBLE)
    weights = torch.linspace(0.5, 1.5, images.numel(), dtype=DOUBLE).reshape(images.shape)
    return (weights * images).sum()


def finite_difference(value, tensor: torch.Tensor, step: float = 1e-6) -> torch.Tensor:
    """Central differences of the scalar `value(tensor)` in every element."""
    flat = tensor.detach().reshape(-1)
    slopes = []
    for k in range(len(flat)):
        moved = [flat.clone(), flat.clone()]
        moved[0][k] -= step
        moved[1][k] += step
        low, high = (value(m.reshape(tensor.shape)).detach() for m in moved)
        slopes.append((high - low) / (2 * step))
    return torch.stack(slopes).reshape(tensor.shape)


def perspective_surface():
    """A patch with normals, positions and viewing directions that all differ."""
    rng = np.random.default_rng(8)
    normals = rng.uniform(-0.4, 0.4, (5, 6, 3)) + np.array([0, 0, 1.0])
    positions = rng.uniform(-1, 1, (5, 6, 3)) * np.array([1, 1, 0.2])
    return from_normals(normals, Camera(position=(0.3, -0.4, 6), fov_y=0.4), None, positions)


def test_local_directions_keep_angles_lengths_and_handedness(rng):
    normal, a, b, c = (torch.from_numpy(v / np.linalg.norm(v, axis=1)[:, None]) for v in rng.normal(size=(4, 500, 3)))
    local = to_local(normal, a, b, c)
    for first, second in ((0, 1), (1, 2), (0, 0)):
        world = ((a, b, c)[first] * (a, b, c)[second]).sum(-1)
        torch.testing.assert_close((local[first] * local[second]).sum(-1), world, rtol=0, atol=1e-14)
    volume = (torch.linalg.cross(a, b) * c).sum(-1)
    torch.testing.assert_close((torch.linalg.cross(local[0], local[1]) * local[2]).sum(-1), volume, rtol=0, atol=1e-14)


def test_the_third_local_component_is_the_cosine_to_the_normal():
    surface = perspective_surface()
    near, far = point(NEAR), directional(FAR)
    points = scene_of(surface, near, far).points(0, dtype=DOUBLE)
    assert points.wi.shape == (30, 2, 3)
    torch.testing.assert_close(points.wo[:, 2], (surface.normals * surface.view).sum(-1), rtol=0, atol=1e-14)
    torch.testing.assert_close(points.wi[:, 1, 2], surface.normals @ far.direction, rtol=0, atol=1e-14)
    toward = near.position - surface.positions
    cosine = (surface.normals * toward).sum(-1) / toward.norm(dim=-1)
    torch.testing.assert_close(points.wi[:, 0, 2], cosine, rtol=0, atol=1e-14)
    torch.testing.assert_close(points.irradiance[:, 0, 0], toward.square().sum(-1).reciprocal(), rtol=1e-14, atol=0)


def test_the_angle_between_light_and_viewer_is_that_of_the_world():
    surface = perspective_surface()
    light = directional(FAR)
    points = scene_of(surface, light).points(0, dtype=DOUBLE)
    torch.testing.assert_close(
        (points.wi[:, 0] * points.wo).sum(-1), surface.view @ light.direction, rtol=0, atol=1e-14
    )
    for direction in (points.wi, points.wo):
        torch.testing.assert_close(direction.norm(dim=-1), torch.ones(direction.shape[:-1], dtype=DOUBLE))


def test_points_of_chosen_pixels_are_rows_of_all_points():
    scene = scene_of(perspective_surface(), point(NEAR), directional(FAR))
    index = torch.tensor([3, 17, 4])
    whole, part = scene.points(0, dtype=DOUBLE), scene.points(0, index, dtype=DOUBLE)
    torch.testing.assert_close(part.wi, whole.wi[index])
    torch.testing.assert_close(part.wo, whole.wo[index])
    torch.testing.assert_close(part.irradiance, whole.irradiance[index])


def test_a_blocked_light_has_no_irradiance():
    surface = sphere_surface(12)
    shadow = np.zeros((2, len(surface)), bool)
    shadow[1, ::3] = True
    scene = scene_of(surface, directional(FAR, 2.0, 3.0), directional((0.0, 0.0, 1.0), 5.0, 7.0))
    irradiance = dataclasses.replace(scene, shadows=(tuple(map(Bits.of, shadow)),)).points(0).irradiance
    expected = torch.tensor([[2.0, 3.0], [5.0, 7.0]]).repeat(len(surface), 1, 1)
    expected[::3, 1] = 0
    assert torch.equal(irradiance.expand_as(expected), expected)


def test_an_image_without_lights_is_black():
    scene = scene_of(sphere_surface(12))
    images = render(scene, Lambert(albedo=0.7))
    assert images.shape == (1, 12, 12, 1)
    assert not images.any()


def test_render_has_one_image_per_set_of_lights_and_zero_background():
    surface = sphere_surface(20)
    light, other = directional(FAR, 1.0, 2.0, 3.0), directional((-0.4, 0.1, 0.7), 0.5, 0.5, 0.5)
    scene = Scene(surface, ((light,), (other,), (light, other)), torch.zeros(3, 3, dtype=DOUBLE))
    images = render(scene, OrenNayar(albedo=[0.7, 0.5, 0.3], sigma=0.4), dtype=DOUBLE)
    assert images.shape == (3, 20, 20, 3)
    assert not images[:, ~torch.from_numpy(surface.mask)].any()
    assert (images[:, 10, 10] > 0).all()
    torch.testing.assert_close(images[0] + images[1], images[2])


def test_a_render_is_the_shading_of_its_pixels():
    surface = sphere_surface(20)
    light = directional(FAR, 1.5)
    image = render(scene_of(surface, light), Lambert(albedo=0.6), dtype=DOUBLE)[0, ..., 0]
    expected = 0.6 / torch.pi * 1.5 * (surface.normals @ light.direction).clamp(min=0)
    torch.testing.assert_close(image, torch.from_numpy(surface.image(expected.numpy())), rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("material", [OrenNayar(albedo=0.6, sigma=0.5), CookTorrance(diffuse=0.3, slope=0.4)])
def test_render_is_differentiable_in_the_direction_of_a_light(material):
    surface = perspective_surface()

    def value(direction: torch.Tensor) -> torch.Tensor:
        light = dataclasses.replace(directional(FAR), direction=direction / direction.norm())
        return total(scene_of(surface, light), material)

    direction = torch.tensor(FAR, dtype=DOUBLE, requires_grad=True)
    (slope,) = torch.autograd.grad(value(direction), direction)
    torch.testing.assert_close(slope, finite_difference(value, direction), rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("name", ["position", "intensity"])
def test_render_is_differentiable_in_a_point_light(name):
    surface = perspective_surface()
    light = point(NEAR, 2.0, 3.0)

    def value(changed: torch.Tensor) -> torch.Tensor:
        return total(scene_of(surface, dataclasses.replace(light, **{name: changed})), OrenNayar(albedo=0.6, sigma=0.5))

    leaf = getattr(light, name).clone().requires_grad_()
    (slope,) = torch.autograd.grad(value(leaf), leaf)
    torch.testing.assert_close(slope, finite_difference(value, leaf), rtol=1e-6, atol=1e-7)


def test_render_is_differentiable_in_irradiance_and_ambient_light():
    surface = perspective_surface()

    def value(changed: torch.Tensor) -> torch.Tensor:
        light = dataclasses.replace(directional(FAR), irradiance=changed[:1])
        scene = dataclasses.replace(scene_of(surface, light), ambient=changed[None, 1:])
        return total(scene, OrenNayar(albedo=0.6, sigma=0.5))

    leaf = torch.tensor([1.3, 0.2], dtype=DOUBLE, requires_grad=True)
    (slope,) = torch.autograd.grad(value(leaf), leaf)
    torch.testing.assert_close(slope, finite_difference(value, leaf), rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("name", ["normals", "positions"])
def test_render_is_differentiable_in_the_geometry(name):
    surface = perspective_surface()
    chosen = torch.tensor([2, 11, 29])

    def value(changed: torch.Tensor) -> torch.Tensor:
        geometry = getattr(surface, name).index_copy(0, chosen, changed)
        if name == "normals":
            geometry = torch.nn.functional.normalize(geometry, dim=-1)
        moved = dataclasses.replace(surface, **{name: geometry})
        return total(scene_of(moved, point(NEAR)), OrenNayar(albedo=0.6, sigma=0.5))

    leaf = getattr(surface, name)[chosen].clone().requires_grad_()
    (slope,) = torch.autograd.grad(value(leaf), leaf)
    assert slope.abs().max() > 1e-3
    torch.testing.assert_close(slope, finite_difference(value, leaf), rtol=1e-5, atol=1e-7)


def test_render_is_differentiable_in_the_material():
    surface = perspective_surface()

    def value(changed: torch.Tensor) -> torch.Tensor:
        return total(scene_of(surface, point(NEAR), directional(FAR)), OrenNayar(albedo=changed[0], sigma=changed[1]))

    leaf = torch.tensor([0.6, 0.5], dtype=DOUBLE, requires_grad=True)
    (slope,) = torch.autograd.grad(value(leaf), leaf)
    torch.testing.assert_close(slope, finite_difference(value, leaf), rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("material", [OrenNayar(albedo=0.6, sigma=0.5), CookTorrance(diffuse=0.3, slope=0.2)])
def test_single_precision_renders_like_double(material):
    scene = scene_of(sphere_surface(40), directional(FAR, 1.0), point(NEAR, 3.0), ambient=0.1)
    single, double = render(scene, material), render(scene, material, dtype=DOUBLE)
    assert single.dtype == torch.float32
    torch.testing.assert_close(single.double(), double, rtol=1e-4, atol=1e-6 * float(double.max()))
