"""Light from all around."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from matest.brdf import Brdf, CookTorrance, Lambert, LiTorrance, OrenNayar
from matest.brdf.curvature import curvature
from matest.directions import to_local
from matest.scene import EnvironmentLight, illuminate
from matest.scene.environment import LARGEST_COUNT, MIRROR_SOLID_ANGLE, environment_for, environment_of
from matest.shading import shade
from tests import environments

ROWS = 64
STUDIO = environments.studio_map(ROWS)
NORMALS = environments.normals(200)
VIEW = torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64)
SEEN = NORMALS[NORMALS[:, 2] > 0.1]
GLOSSY = CookTorrance(diffuse=0.0, specular=1.0, slope=0.15, f0=0.5)


def brute_force(material: Brdf, normals: Tensor) -> Tensor:
    """Radiance under the studio, a light from each texel [N]."""
    toward = torch.from_numpy(environments.grid(ROWS).reshape(-1, 3))
    power = STUDIO.flatten() * torch.from_numpy(environments.solid_angles(ROWS)).repeat_interleave(2 * ROWS)
    wi, wo = to_local(normals[:, None], toward[None], VIEW[:, None])
    return ((material(wi, wo)[..., 0] * wi[..., 2].clamp(min=0)) @ power).detach()


def shaded(material: Brdf, light: EnvironmentLight, normals: Tensor) -> Tensor:
    return shade(material, illuminate(normals, VIEW, [light]))[:, 0]


def light_of(count: int, turn: float = 0.0) -> EnvironmentLight:
    return EnvironmentLight(environment_of(STUDIO, count), turn)


@pytest.mark.parametrize("count", [16, 256])
def test_a_white_surface_in_an_even_environment_has_its_radiance(count: int) -> None:
    even = environment_of(torch.full((ROWS, 2 * ROWS, 3), 2.0, dtype=torch.float64), count)
    radiance = shade(Lambert(albedo=1.0), illuminate(SEEN, VIEW, [EnvironmentLight(even)]))
    assert float((radiance / 2.0 - 1).abs().max()) < 1e-3


def test_a_matte_surface_reflects_the_irradiance_of_the_map() -> None:
    exact = brute_force(Lambert(albedo=0.8), SEEN)
    errors = [
        float((shaded(Lambert(albedo=0.8), light_of(count), SEEN) - exact).abs().max() / exact.mean())
        for count in (128, 512)
    ]
    assert errors[0] < 5e-3
    assert errors[1] < 1.5e-3


@pytest.mark.parametrize("material", [OrenNayar(albedo=0.8, sigma=0.5), GLOSSY])
def test_lobes_are_resolved_by_as_many_directions_as_they_need(material: Brdf) -> None:
    exact = brute_force(material, SEEN)
    environment = environment_for(STUDIO, curvature(material))
    assert len(environment.nodes) < LARGEST_COUNT
    residual = shaded(material, EnvironmentLight(environment), SEEN) - exact
    assert float(residual.square().mean().sqrt() / exact.square().mean().sqrt()) < 0.01


def test_sharper_lobes_get_more_directions() -> None:
    counts = [len(environment_for(STUDIO, 1 / slope**2).nodes) for slope in (1.0, 0.3, 0.1)]
    assert counts[0] < counts[1] < counts[2]


@pytest.mark.parametrize(
    ("column", "direction"), [(0.0, [0, 0, -1]), (0.25, [1, 0, 0]), (0.5, [0, 0, 1]), (0.75, [-1, 0, 0])]
)
def test_columns_run_from_minus_z_over_x(column: float, direction: list[float]) -> None:
    radiance = torch.full((8, 16, 1), 1e-6, dtype=torch.float64)
    place = round(16 * column)
    radiance[3:5, [place - 1, place]] = 1.0
    environment = environment_of(radiance, 16)
    toward = torch.tensor([direction], dtype=torch.float64)
    # The joints of four texels of one radiance.
    torch.testing.assert_close(environment.at(toward), torch.ones(1, 1, dtype=torch.float64), rtol=1e-6, atol=0)
    bright = environment.nodes[environment.powers[:, 0].argmax()]
    assert float(bright @ toward[0]) > math.cos(0.4)


def test_the_first_row_is_up() -> None:
    radiance = torch.linspace(1, 0, 8, dtype=torch.float64)[:, None, None].expand(8, 16, 1)
    up, down = environment_of(radiance, 16).at(torch.tensor([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]], dtype=torch.float64))
    assert float(up) == 1.0
    assert float(down) == 0.0


def test_a_turn_takes_the_map_from_z_toward_x() -> None:
    turned, still = light_of(64, math.pi / 2), light_of(64)
    # What was at +z is at +x then.
    frame = torch.tensor([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]], dtype=torch.float64)
    before, after = still.spread(None, SEEN, VIEW @ frame), turned.spread(None, SEEN @ frame.T, VIEW @ frame @ frame.T)
    torch.testing.assert_close(after[0], before[0] @ frame.T)
    torch.testing.assert_close(after[1], before[1])
    assert turned.key != still.key


def test_the_mirror_term_shows_the_map() -> None:
    smooth = LiTorrance(
        k_dd=1.0, f0=1.0, height_rms=torch.tensor(1e-4), correlation_length=1.0, wavelength=0.5,
        solid_angle=torch.tensor(MIRROR_SOLID_ANGLE), coherent="on", energy="he", subsurface="off",
    )  # fmt: skip
    normals = SEEN[SEEN[:, 2] > 0.5]
    for dtype in (torch.float64, torch.float32):
        light, surface = light_of(256, 0.3).to(dtype, "cpu"), normals.to(dtype)
        radiance = shade(smooth, illuminate(surface, VIEW.to(dtype), [light]))[:, 0]
        x, y, z = (2 * normals[:, 2:] * normals - VIEW).numpy().T
        cos, sin = math.cos(0.3), math.sin(0.3)
        in_map = np.stack([cos * x - sin * z, y, sin * x + cos * z], axis=1)
        # The map is linear between texels of 0.05 rad.
        expected = torch.from_numpy(environments.studio(in_map))
        assert float(((radiance - expected) / expected.mean()).abs().max()) < 0.03


def test_radiance_is_differentiable_in_normals_and_material() -> None:
    light = light_of(128)
    normals = SEEN[20:24].clone()
    slope = torch.tensor(0.3, dtype=torch.float64)

    def radiance(normals: Tensor, slope: Tensor) -> Tensor:
        unit = torch.nn.functional.normalize(normals, dim=-1)
        return shaded(GLOSSY.replace({"slope": slope}) + Lambert(albedo=0.5), light, unit)

    assert torch.autograd.gradcheck(radiance, (normals.requires_grad_(), slope.requires_grad_()), eps=1e-6, atol=1e-5)


def test_single_precision_and_single_channels_agree() -> None:
    light = EnvironmentLight(environment_of(environments.studio_map(ROWS, 3) * torch.tensor([1.0, 0.5, 0.2]), 128))
    exact = shade(GLOSSY, illuminate(SEEN, VIEW, [light]))
    single = illuminate(SEEN.float(), VIEW.float(), [light.to(torch.float32, "cpu")])
    torch.testing.assert_close(shade(GLOSSY, single).double(), exact, rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(shade(GLOSSY, illuminate(SEEN, VIEW, [light.channel(1)])), exact[:, 1:2])


def test_half_of_a_map_as_one_light_gives_a_facing_surface_its_irradiance() -> None:
    light, viewer = light_of(256, turn=0.4), torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    toward, irradiance = light.before(viewer)
    assert float(toward @ viewer) > 0.3
    normal = toward[None]
    directions, powers = light.spread(None, normal, normal)
    given = ((directions[:, :-1] @ toward).clamp(min=0)[..., None] * powers[:, :-1]).sum(1)
    torch.testing.assert_close(irradiance[None], given, rtol=1e-3, atol=0)
