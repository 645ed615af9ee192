"""Points built from tensors, and gradients of shading by light, normals and positions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.autograd import gradcheck
from torch.nn.functional import normalize

from matest.brdf import Brdf, CookTorrance, Lambert, OrenNayar
from matest.scene import Camera, DirectionalLight, PointLight, Scene, Surface, illuminate
from matest.scene.points import Points, lit_pairs
from matest.scene.surface import from_normals
from matest.shading import render, shade
from tests.captures import directional, point, refusal, scene_of

DOUBLE = torch.float64
MODELS = [
    Lambert([0.7, 0.5, 0.3]),
    OrenNayar([0.7, 0.5, 0.3], 0.5),
    CookTorrance(diffuse=[0.3, 0.2, 0.1], specular=0.8, slope=0.25, f0=0.05),
]
IDS = ["lambert", "oren-nayar", "cook-torrance"]
EYE = (0.3, -0.2, 4.0)
PERSPECTIVE = Camera(position=EYE, fov_y=0.6)


def vectors(*rows: tuple[float, float, float]) -> Tensor:
    return torch.tensor(rows, dtype=DOUBLE)


NORMALS = normalize(vectors((0.1, 0.2, 1.0), (-0.4, 0.1, 0.9), (0.3, -0.5, 0.8), (0.0, 0.05, 1.0)), dim=-1)
POSITIONS = vectors((-0.4, 0.5, 0.1), (0.5, 0.4, 0.0), (-0.3, -0.5, 0.2), (0.4, -0.4, -0.1))
DIRECTION, IRRADIANCE = torch.tensor([0.5, 0.3, 0.8], dtype=DOUBLE), torch.tensor([3.0, 2.5, 2.0], dtype=DOUBLE)
LAMP, INTENSITY = torch.tensor([0.8, 0.6, 2.0], dtype=DOUBLE), torch.tensor([6.0, 5.0, 4.0], dtype=DOUBLE)
SKY = torch.tensor([[0.2, 0.3, 0.4]], dtype=DOUBLE)


def surface() -> Surface:
    """Four points seen by a near camera, in an image of two by two."""
    maps = (value.numpy().reshape(2, 2, 3) for value in (NORMALS, POSITIONS))
    normals, positions = maps
    return from_normals(normals, PERSPECTIVE, None, positions)


def shaded(model: Brdf, **changed: Tensor) -> Tensor:
    """Radiance by `illuminate` and `shade` under a distant and a near light and a sky, with some tensors replaced."""
    given = {
        "normals": NORMALS, "positions": POSITIONS, "eye": torch.tensor(EYE, dtype=DOUBLE), "direction": DIRECTION,
        "irradiance": IRRADIANCE, "lamp": LAMP, "intensity": INTENSITY, "sky": SKY, **changed,
    }  # fmt: skip
    points = illuminate(
        normalize(given["normals"], dim=-1),
        normalize(given["eye"] - given["positions"], dim=-1),
        lights(given),
        positions=given["positions"],
        ambient=given["sky"],
    )
    return shade(model, points)


def lights(given: dict[str, Tensor]) -> tuple[DirectionalLight, PointLight]:
    distant = DirectionalLight(normalize(given["direction"], dim=0), given["irradiance"])
    return distant, PointLight(given["lamp"], given["intensity"])


def rendered(model: Brdf, **changed: Tensor) -> Tensor:
    """The same by `render`, from a scene whose tensors are replaced."""
    given = {
        "normals": NORMALS, "positions": POSITIONS, "eye": torch.tensor(EYE, dtype=DOUBLE), "direction": DIRECTION,
        "irradiance": IRRADIANCE, "lamp": LAMP, "intensity": INTENSITY, "sky": SKY, **changed,
    }  # fmt: skip
    seen = replace(
        surface(), normals=normalize(given["normals"], dim=-1), positions=given["positions"], eye=given["eye"]
    )
    return render(Scene(seen, (lights(given),), given["sky"]), model, dtype=DOUBLE)


LEAVES = {
    "direction": DIRECTION, "irradiance": IRRADIANCE, "lamp": LAMP, "intensity": INTENSITY, "normals": NORMALS,
    "positions": POSITIONS, "eye": torch.tensor(EYE, dtype=DOUBLE), "sky": SKY,
}  # fmt: skip


@pytest.mark.parametrize("way", [shaded, rendered], ids=["shade", "render"])
@pytest.mark.parametrize("model", MODELS, ids=IDS)
@pytest.mark.parametrize("name", LEAVES)
def test_gradients_are_those_of_finite_differences(name: str, model: Brdf, way: Callable[..., Tensor]) -> None:
    leaf = LEAVES[name].clone().requires_grad_()
    assert gradcheck(lambda value: way(model, **{name: value}), (leaf,), eps=1e-6, atol=1e-8, rtol=1e-6)
    (slope,) = torch.autograd.grad(way(model, **{name: leaf}).square().sum(), leaf)
    if (name, type(model)) != ("eye", Lambert):
        assert slope.abs().max() > 1e-3


@pytest.mark.parametrize("model", MODELS, ids=IDS)
def test_points_from_tensors_shade_like_the_scene(model: Brdf) -> None:
    torch.testing.assert_close(shaded(model), rendered(model).reshape(4, 3), rtol=1e-13, atol=0)


def test_a_second_step_on_the_same_scene_sees_moved_positions() -> None:
    positions = POSITIONS.clone().requires_grad_()
    seen = replace(surface(), positions=positions)
    scene = Scene(seen, ((directional((0.5, 0.3, 0.8), 3.0, 3.0, 3.0),),), torch.zeros(1, 3, dtype=DOUBLE))
    gradients = []
    for _ in range(2):
        (gradient,) = torch.autograd.grad(render(scene, MODELS[2], dtype=DOUBLE).sum(), positions)
        gradients.append(gradient)
        with torch.no_grad():
            positions.sub_(0.1 * gradient)
    assert gradients[0].abs().max() > 0
    fresh = replace(surface(), positions=(POSITIONS - 0.1 * gradients[0]).requires_grad_())
    image = render(replace(scene, surface=fresh), MODELS[2], dtype=DOUBLE)
    (expected,) = torch.autograd.grad(image.sum(), fresh.positions)
    torch.testing.assert_close(gradients[1], expected, rtol=1e-12, atol=0)


def test_viewing_directions_of_a_near_camera_follow_replaced_positions() -> None:
    moved = POSITIONS + 0.3
    seen = replace(surface(), positions=moved)
    expected = normalize(torch.tensor(EYE, dtype=DOUBLE) - moved, dim=-1)
    torch.testing.assert_close(seen.view, expected, rtol=1e-14, atol=1e-15)
    torch.testing.assert_close(seen.toward_viewer(torch.tensor([2, 0])), expected[[2, 0]], rtol=1e-14, atol=1e-15)


def test_a_distant_viewer_stays_where_it_is_when_positions_move() -> None:
    normals = NORMALS.numpy().reshape(2, 2, 3)
    seen = from_normals(normals, None, None, POSITIONS.numpy().reshape(2, 2, 3))
    assert seen.eye is None
    moved = replace(seen, positions=(POSITIONS + 0.3).requires_grad_())
    assert moved.toward_viewer().tolist() == [[0.0, 0.0, 1.0]]


def test_an_even_sky_that_is_still_dark_has_a_gradient() -> None:
    sky = torch.zeros(1, 3, dtype=DOUBLE, requires_grad=True)
    rendered(Lambert(0.5), sky=sky).sum().backward()
    np.testing.assert_allclose(sky.grad, [[2.0, 2.0, 2.0]], rtol=1e-12)


def test_blocked_lights_give_nothing() -> None:
    lamps = [directional((0.5, 0.3, 0.8), 3.0), directional((-0.2, 0.3, 0.8), 2.0)]
    view = vectors((0.0, 0.0, 1.0))
    blocked = torch.tensor([[True, True, True, True], [False, True, False, False]])
    both = shade(Lambert(0.5), illuminate(NORMALS, view, lamps, blocked=blocked))
    alone = shade(Lambert(0.5), illuminate(NORMALS, view, lamps[1:]))
    torch.testing.assert_close(both, alone * torch.tensor([[1.0], [0.0], [1.0], [1.0]], dtype=DOUBLE))


@pytest.mark.parametrize("sky", [None, SKY])
def test_without_lights_there_is_only_the_sky(sky: Tensor | None) -> None:
    points = illuminate(NORMALS, vectors((0.0, 0.0, 1.0)), [], ambient=sky)
    expected = torch.zeros(4, 1, dtype=DOUBLE) if sky is None else (0.5 * sky).expand(4, 3)
    torch.testing.assert_close(shade(Lambert(0.5), points).expand_as(expected), expected, rtol=1e-12, atol=0)


def test_a_near_light_without_positions_is_refused() -> None:
    message = refusal(lambda: illuminate(NORMALS, vectors((0.0, 0.0, 1.0)), [point((0.0, 0.0, 3.0))]))
    assert "needs the surface's positions" in message


def test_a_light_direction_is_refined_by_gradient() -> None:
    truth = directional((0.5, 0.3, 0.8), 3.0)
    measured = shade(MODELS[2], illuminate(NORMALS, vectors((0.0, 0.0, 1.0)), [truth]))
    guess = torch.tensor([0.3, 0.5, 0.8], dtype=DOUBLE, requires_grad=True)
    optimiser = torch.optim.LBFGS([guess], max_iter=50, line_search_fn="strong_wolfe")

    def misfit() -> Tensor:
        optimiser.zero_grad()
        lamp = DirectionalLight(normalize(guess, dim=0), truth.irradiance)
        loss = (shade(MODELS[2], illuminate(NORMALS, vectors((0.0, 0.0, 1.0)), [lamp])) - measured).square().mean()
        loss.backward()
        return loss

    optimiser.step(misfit)
    assert torch.rad2deg(torch.acos(normalize(guess, dim=0) @ truth.direction)) < 0.01


def test_a_scene_without_lights_renders_black() -> None:
    assert not render(scene_of(surface()), Lambert(0.5)).any()


def test_pairs_are_the_lights_above_the_horizon_and_their_sums_those_of_all_lights() -> None:
    generator = torch.Generator().manual_seed(3)
    wi = torch.nn.functional.normalize(torch.randn(1, 40, 3, generator=generator), dim=-1)
    wo = torch.nn.functional.normalize(torch.rand(5, 3, generator=generator), dim=-1)
    irradiance = torch.rand(5, 40, 3, generator=generator)
    irradiance[:, 7] = 0
    points = Points(wi, wo, irradiance)
    pairs = lit_pairs(points)
    assert pairs is not None
    lit = (wi[0, :, 2] > 0) & (torch.arange(40) != 7)
    assert len(pairs.rows) == 5 * int(lit.sum())
    assert bool((pairs.points.wi[..., 2] > 0).all())
    given = pairs.sums((pairs.points.irradiance * pairs.points.wi[..., 2:])[:, 0])
    torch.testing.assert_close(given, (irradiance * wi[..., 2:].clamp(min=0)).sum(1))
    torch.testing.assert_close(pairs.points.wo, wo[pairs.rows])


def test_few_lights_are_not_picked() -> None:
    up = torch.tensor([[[0.0, 0.0, 1.0]]])
    assert lit_pairs(Points(up.expand(2, 3, 3), up[0].expand(2, 3), torch.ones(2, 3, 1))) is None


def test_only_a_sky_without_light_is_left_out() -> None:
    wi, wo, irradiance = NORMALS[:, None], NORMALS, torch.ones(4, 1, 3, dtype=DOUBLE)
    black, dim = torch.zeros(4, 3, dtype=DOUBLE), torch.tensor([[0, 0, 0.1]], dtype=DOUBLE)
    assert Points(wi, wo, irradiance, black).without_black_sky().ambient is None
    assert Points(wi, wo, irradiance, dim).without_black_sky().ambient is dim
