from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from matest.brdf import Brdf, CookTorrance, Lambert, OrenNayar, TorranceSparrow
from matest.scene import Points
from matest.scene.surface import from_normals
from matest.shading import gathered_light, reflectance, render_image, render_pixels, shade
from tests.captures import directional, point, scene_of
from tests.simulated import Studio, coloured

DOUBLE = torch.float64
NORMAL = torch.tensor([[0.6, 0.0, 0.8]], dtype=DOUBLE)
MODELS = [
    OrenNayar(albedo=[0.7, 0.5, 0.3], sigma=0.4),
    CookTorrance(diffuse=0.3, specular=0.8, slope=0.15, f0=0.05),
    Lambert(albedo=0.5) + TorranceSparrow(specular=0.7, sigma=0.2),
]


def plane(position: tuple[float, float, float] = (0.0, 0.0, 0.0)):
    """One pixel of a plane whose normal leans 36.9° toward x."""
    normal = NORMAL.numpy()[None]
    return from_normals(normal, None, None, np.array(position)[None, None])


def one_point(theta_i: float, theta_o: float, phi: float = 0.4, irradiance: float = 1.0) -> Points:
    wi = [math.sin(theta_i) * math.cos(phi), math.sin(theta_i) * math.sin(phi), math.cos(theta_i)]
    wo = [math.sin(theta_o), 0.0, math.cos(theta_o)]
    return Points(
        torch.tensor([[wi]], dtype=DOUBLE), torch.tensor([wo], dtype=DOUBLE), torch.full((1, 1, 1), irradiance).double()
    )


def brute_force_reflectance(brdf: Brdf, cos_o: float, nodes: int = 900) -> torch.Tensor:
    """Midpoint rule on an even grid of cos²θ and φ: each cell carries the same share of an even sky's irradiance."""
    share = (torch.arange(nodes, dtype=DOUBLE) + 0.5) / nodes
    cos_i, phi = torch.meshgrid(share.sqrt(), 2 * math.pi * share, indexing="ij")
    sin_i = (1 - cos_i**2).sqrt()
    wi = torch.stack([sin_i * phi.cos(), sin_i * phi.sin(), cos_i], dim=-1).reshape(-1, 3)
    wo = torch.tensor([math.sqrt(1 - cos_o**2), 0.0, cos_o], dtype=DOUBLE)
    return math.pi * brdf(wi, wo).mean(0)


def test_radiance_of_a_lambert_plane_is_albedo_over_pi_times_irradiance_times_cosine():
    light = directional((0.0, 0.6, 0.8), 2.0, 3.0, 5.0)
    points = scene_of(plane(), light).points(0, dtype=DOUBLE)
    radiance = shade(Lambert(albedo=[0.7, 0.5, 0.3]), points)
    expected = [[0.7 / math.pi * 2 * 0.64, 0.5 / math.pi * 3 * 0.64, 0.3 / math.pi * 5 * 0.64]]
    torch.testing.assert_close(radiance, torch.tensor(expected, dtype=DOUBLE), rtol=1e-14, atol=0)


def test_radiance_under_a_point_light_falls_with_the_square_of_its_distance():
    light = point((0.1, 0.2, 3.3), 4.0)
    points = scene_of(plane((0.1, 0.2, 0.3)), light).points(0, dtype=DOUBLE)
    expected = torch.tensor([[0.5 / math.pi * 4 / 9 * 0.8]], dtype=DOUBLE)
    torch.testing.assert_close(shade(Lambert(albedo=0.5), points), expected, rtol=1e-14, atol=0)


@pytest.mark.parametrize("model", MODELS)
def test_the_light_of_two_lamps_adds(model):
    lamps = directional((0.0, 0.6, 0.8), 2.0, 3.0, 5.0), point((1.0, 0.2, 2.0), 1.0, 4.0, 2.0)
    both, *single = (
        shade(model, scene_of(plane(), *chosen).points(0, dtype=DOUBLE)) for chosen in (lamps, lamps[:1], lamps[1:])
    )
    assert all((radiance > 0).all() for radiance in single)
    torch.testing.assert_close(both, sum(single), rtol=1e-14, atol=0)


@pytest.mark.parametrize("model", MODELS)
def test_radiance_is_the_brdf_times_gathered_light(model):
    points = one_point(0.7, 0.3, irradiance=2.5)
    torch.testing.assert_close(gathered_light(points), torch.full((1, 1, 1), 2.5 * math.cos(0.7)).double())
    expected = model(points.wi[:, 0], points.wo) * 2.5 * math.cos(0.7)
    torch.testing.assert_close(shade(model, points), expected, rtol=1e-14, atol=0)


@pytest.mark.parametrize("ambient", [0.0, 0.2])
@pytest.mark.parametrize("lamps", [1, 2])
def test_a_parameter_per_pixel_acts_on_its_own_pixel(lamps, ambient):
    normals = np.array([[[0.6, 0, 0.8], [0, 0, 1], [0, -0.6, 0.8]]])
    lights = [directional((0.0, 0.6, 0.8), 2.0), directional((0.3, 0.1, 0.9), 1.5)][:lamps]
    points = scene_of(from_normals(normals, None), *lights, ambient=ambient).points(0, dtype=DOUBLE)
    albedo = torch.tensor([[0.2], [0.5], [0.9]], dtype=DOUBLE)
    torch.testing.assert_close(
        shade(Lambert(albedo=albedo), points), albedo * shade(Lambert(albedo=1.0), points), rtol=1e-12, atol=0
    )


@pytest.mark.parametrize("model", MODELS)
def test_light_below_the_horizon_gives_nothing(model):
    points = scene_of(plane(), directional((-0.9, 0.0, 0.1), 2.0)).points(0, dtype=DOUBLE)
    assert points.wi[..., 2] < 0
    assert not shade(model, points).any()


def test_an_even_sky_shows_a_lambertian_surface_with_its_albedo():
    scene = scene_of(plane(), directional((-0.9, 0.0, 0.1), 2.0), ambient=0.25)
    radiance = shade(Lambert(albedo=0.6), scene.points(0, dtype=DOUBLE))
    torch.testing.assert_close(radiance, torch.full((1, 1), 0.6 * 0.25, dtype=DOUBLE), rtol=1e-12, atol=0)


@pytest.mark.parametrize("model", MODELS)
def test_ambient_light_adds_its_radiance_times_the_reflectance(model):
    lamp = directional((0.0, 0.6, 0.8), 2.0, 2.0, 2.0)
    dark, bright = (scene_of(plane(), lamp, ambient=a).points(0, dtype=DOUBLE) for a in (0.0, 0.3))
    assert dark.ambient is None
    added = shade(model, bright) - shade(model, dark)
    torch.testing.assert_close(added, (0.3 * reflectance(model, NORMAL[:, 2:])).expand_as(added), rtol=1e-12, atol=0)


@pytest.mark.parametrize("name", ["sigma", "slope"])
def test_under_the_sky_every_point_reflects_by_its_own_shape(name):
    cosines, shapes = torch.linspace(0.1, 1, 7, dtype=DOUBLE)[:, None], torch.linspace(0.1, 0.4, 7, dtype=DOUBLE)
    albedo = torch.linspace(0.2, 0.8, 7, dtype=DOUBLE)[:, None]
    models = {"sigma": lambda at, value: OrenNayar(at, value), "slope": lambda at, value: CookTorrance(at, 0.9, value)}
    together = reflectance(models[name](albedo, shapes.flip(0)[:, None]), cosines)
    for k, shape in enumerate(shapes.flip(0)):
        alone = reflectance(models[name](albedo[k], shape), cosines[k : k + 1])
        torch.testing.assert_close(together[k : k + 1], alone, rtol=2e-3, atol=0)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("node", [4, 16, 25, 32])
def test_reflectance_at_a_tabulated_cosine_is_the_integral_over_the_sky(model, node):
    cos_o = node / 32
    table = reflectance(model, torch.tensor([[cos_o]], dtype=DOUBLE))[0]
    torch.testing.assert_close(table, brute_force_reflectance(model, cos_o), rtol=1e-3, atol=0)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("cos_o", [0.11, 0.265, 0.515, 0.89])
def test_reflectance_between_tabulated_cosines_is_near_the_integral(model, cos_o):
    table = reflectance(model, torch.tensor([[cos_o]], dtype=DOUBLE))[0]
    torch.testing.assert_close(table, brute_force_reflectance(model, cos_o), rtol=1e-2, atol=0)


def test_reflectance_keeps_the_shape_of_its_cosines():
    cosines = torch.rand(4, 5, 1, generator=torch.Generator().manual_seed(1))
    assert reflectance(MODELS[0], cosines).shape == (4, 5, 3)
    assert reflectance(MODELS[1], cosines).shape == (4, 5, 1)
    assert reflectance(MODELS[1], cosines).dtype == torch.float32


@pytest.mark.parametrize("theta_i", [0.0, 0.8, math.pi / 2, 2.0])
@pytest.mark.parametrize("theta_o", [0.0, 0.8, math.pi / 2])
def test_gradients_are_finite_from_normal_to_below_the_horizon(theta_i, theta_o):
    sigma = torch.tensor(0.4, dtype=DOUBLE, requires_grad=True)
    slope = torch.tensor(0.2, dtype=DOUBLE, requires_grad=True)
    points = one_point(theta_i, theta_o)
    leaves = [value.clone().requires_grad_() for value in (points.wi, points.wo, points.irradiance)]
    sky = torch.full((1, 1), 0.3, dtype=DOUBLE, requires_grad=True)
    model = OrenNayar(albedo=0.5, sigma=sigma) + CookTorrance(diffuse=0.0, slope=slope)
    shade(model, Points(*leaves, sky)).sum().backward()
    for leaf in (sigma, slope, sky, *leaves):
        assert torch.isfinite(leaf.grad).all()


def test_some_pixels_are_shaded_as_in_the_whole_image() -> None:
    scene = Studio(size=24, lights=coloured()[:2], ambient=0.1).scene
    albedo = torch.linspace(0.2, 0.8, len(scene.surface))[:, None]
    index = torch.arange(3, len(scene.surface), 7)
    for material in (OrenNayar([0.7, 0.5, 0.3], 0.4), Lambert(albedo)):
        whole = render_image(scene, 1, material).reshape(-1, 3)[scene.surface.pixels[index]]
        torch.testing.assert_close(render_pixels(scene, 1, material, index), whole)
