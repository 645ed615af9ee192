"""Settings that are not what their captures state."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from matest.benchmark.instruments import miscalibration as off
from matest.benchmark.instruments.miscalibration import RADIUS, SIZE, Setting, photograph
from matest.benchmark.instruments.photographs import vase
from matest.brdf import Lambert

ALBEDO = 0.5
LIGHTS = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]])


@pytest.fixture
def generator() -> np.random.Generator:
    return np.random.default_rng(3)


@pytest.fixture
def setting() -> Setting:
    return Setting(off.ball(), LIGHTS, np.ones(2))


def middle(setting: Setting) -> float:
    """The mean radiance of the four pixels in the middle of the first image."""
    half = SIZE // 2
    return float(setting.radiance(Lambert(ALBEDO), "albedo")[0][half - 1 : half + 1, half - 1 : half + 1].mean())


def angles(first: torch.Tensor, second: torch.Tensor) -> np.ndarray:
    return torch.rad2deg(torch.arccos((first * second).sum(1).clamp(-1, 1))).numpy()


def test_the_capture_of_a_true_setting_holds_its_radiance(setting: Setting, generator: np.random.Generator) -> None:
    capture = photograph(setting, setting, Lambert(ALBEDO), "albedo", generator)
    expected = setting.radiance(Lambert(ALBEDO), "albedo")[1].reshape(-1, 3)[setting.surface.pixels]
    # Codes below 0 are cut off: only lit pixels hold the mean.
    lit = expected > 0.1 * expected.max()
    noise = capture.photographs.encoding.scale * capture.photographs.noise.read
    assert np.mean((capture.radiance(1) - expected)[lit]) == pytest.approx(0, abs=0.05 * noise)
    assert capture.photographs.noise_stated
    assert not capture.relative


def test_what_is_wrong_with_the_truth_is_not_in_what_the_capture_states(
    setting: Setting, generator: np.random.Generator
) -> None:
    wrong = off.together(off.directions(0.1), off.intensities(0.1), off.radius(2), off.constant(black=0.02))
    capture = photograph(setting, wrong(setting, generator), Lambert(ALBEDO), "albedo", generator)
    np.testing.assert_array_equal(capture.scene.lights[1][0].direction, LIGHTS[1])
    assert capture.scene.surface is setting.surface
    assert capture.photographs.encoding.black == 0


def test_an_even_sky_and_a_pedestal_are_as_large_as_they_are_said_to_be(
    setting: Setting, generator: np.random.Generator
) -> None:
    # A Lambertian pixel that faces a lone light reflects as much of a sky that gives 3 % of its irradiance.
    sky = off.constant(ambient=0.03)(setting, generator)
    assert middle(sky) == pytest.approx(1.03 * middle(setting), rel=1e-3)
    black = off.constant(black=0.02)(setting, generator)
    capture = photograph(setting, black, Lambert(ALBEDO), "albedo", generator)
    dark = capture.photographs.stored[1].min(axis=1)
    assert np.median(dark[dark < 3000]) / 65535 == pytest.approx(0.02, abs=0.003)


def test_vignetting_is_the_loss_at_the_corner(setting: Setting, generator: np.random.Generator) -> None:
    images = [
        one.radiance(Lambert(ALBEDO), "albedo")[0]
        for one in (setting, off.constant(vignetting=0.1)(setting, generator))
    ]
    row = SIZE // 2
    column = int(SIZE / 2 + RADIUS) - 3
    share = (column + 0.5 - SIZE / 2) ** 2 / (2 * (SIZE / 2) ** 2)
    assert images[1][row, column, 0] / images[0][row, column, 0] == pytest.approx(1 - 0.1 * share, rel=1e-4)


def test_lights_are_off_by_the_angle_that_is_said(setting: Setting, generator: np.random.Generator) -> None:
    many = Setting(off.ball(), LIGHTS.repeat(500, axis=0), np.ones(1000))
    each = off.directions(0.02)(many, generator)
    off_by = angles(torch.from_numpy(each.lights), torch.from_numpy(many.lights))
    assert math.radians(np.sqrt(np.mean(off_by**2))) == pytest.approx(0.02 * math.sqrt(2), rel=0.05)
    turned = off.rotation(0.02)(setting, generator)
    assert turned.lights[0] @ turned.lights[1] == pytest.approx(LIGHTS[0] @ LIGHTS[1])
    assert 0 < np.arccos((turned.lights * LIGHTS).sum(1)).max() < 0.02 + 1e-9
    strength = off.intensities(0.03)(many, generator).strength
    assert strength.std() == pytest.approx(0.03, rel=0.1)


def test_a_sphere_is_larger_or_elsewhere_by_what_is_said(setting: Setting, generator: np.random.Generator) -> None:
    larger = off.radius(1.0)(setting, generator).surface
    assert abs(math.sqrt(len(larger) / math.pi) - RADIUS) == pytest.approx(1, abs=0.05)
    moved = off.centre(1.0)(setting, generator).surface
    shift = np.diff([np.divmod(one.pixels, SIZE)[0].mean() for one in (setting.surface, moved)])
    across = np.diff([np.divmod(one.pixels, SIZE)[1].mean() for one in (setting.surface, moved)])
    assert math.hypot(shift[0], across[0]) == pytest.approx(1, abs=0.05)


def test_a_turned_vase_has_other_normals(generator: np.random.Generator) -> None:
    straight = Setting(vase(SIZE), LIGHTS, np.ones(2))
    turned = off.turned(math.radians(1))(straight, generator).surface
    common = np.intersect1d(straight.surface.pixels, turned.pixels, return_indices=True)[1:]
    off_by = angles(straight.surface.normals[common[0]], turned.normals[common[1]])
    assert 0.1 < np.median(off_by) < 2


@pytest.mark.parametrize("error", [off.smooth_normals, off.noisy_normals])
def test_each_tangential_angle_of_the_normals_is_off_by_what_is_said(
    error: object, setting: Setting, generator: np.random.Generator
) -> None:
    bent = error(math.radians(1))(setting, generator)  # type: ignore[operator]
    off_by = angles(setting.surface.normals, bent.surface.normals)
    assert np.sqrt(np.mean(off_by**2)) == pytest.approx(math.sqrt(2), rel=0.03)
    image = setting.surface.image(off_by)[:, SIZE // 2][10:-10]
    rough = np.abs(np.diff(image)).mean()
    assert rough > 0.4 if error is off.noisy_normals else rough < 0.15


@pytest.mark.parametrize(("error", "rms", "most"), [(off.smooth_albedo, 0.1, 0.4), (off.two_regions, 0.2, 0.2)])
def test_the_albedo_varies_by_what_is_said_about_its_mean(
    error: object, rms: float, most: float, setting: Setting, generator: np.random.Generator
) -> None:
    albedo = error(rms)(setting, generator).albedo  # type: ignore[operator]
    assert albedo.mean() == pytest.approx(1, abs=0.01)
    assert albedo.std() == pytest.approx(rms, rel=0.01)
    assert np.abs(albedo - 1).max() <= most + 1e-9


def test_sharpness_keeps_the_mean_and_smooths_the_shadow_line(setting: Setting, generator: np.random.Generator) -> None:
    sharp, blurred, averaged = (
        one.radiance(Lambert(ALBEDO), "albedo")[1]
        for one in (setting, off.constant(blur=1.5)(setting, generator), off.averaged(3)(setting, generator))
    )
    assert blurred.mean() == pytest.approx(sharp.mean(), rel=1e-6)
    assert averaged.mean() == pytest.approx(sharp.mean(), rel=1e-3)
    edges = [np.abs(np.diff(image[SIZE // 2, :, 0], 2)).max() for image in (sharp, averaged, blurred)]
    assert edges[0] > edges[1] > edges[2]
