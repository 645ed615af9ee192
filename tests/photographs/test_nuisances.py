"""Errors of the calibration act as they would if the scene, the light or the sensor had them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter
from torch import Tensor

from matest.brdf import OrenNayar
from matest.capture import Capture
from matest.estimators import Problem
from matest.estimators.calibrated import CalibratedModel
from matest.photographs.nuisances import NUISANCES
from matest.photographs.samples import PhotographSamples
from matest.photographs.world import TERMS, Grid
from matest.samples import Batch
from matest.samples.batch import join
from matest.scene import DirectionalLight, PointLight, Scene
from matest.scene.source import Source
from matest.scene.surface import from_sphere
from matest.shading import render
from tests.captures import point
from tests.problems import problem
from tests.simulated import Studio, coloured

MATERIAL = OrenNayar([0.7, 0.5, 0.3], 0.4)
STUDIO = Studio(size=64, lights=coloured())
# Pixels from the outline within which differences across pixels are not those of the surface.
RIM = 6


def samples_of(studio: Studio = STUDIO) -> PhotographSamples:
    return studio.photograph(MATERIAL, 0).photographs.samples(dtype=torch.float64)


def calibrated(samples: PhotographSamples, *names: str) -> Problem:
    calibration = samples.calibration(names)
    return problem(MATERIAL.expression, channels=3).calibrated(calibration, dict.fromkeys(names, 1.0), samples.groups)


def everything(samples: PhotographSamples) -> Batch:
    return join([samples.at(position, samples.indices(position)) for position in range(len(samples.images))])


def unknowns_with(chosen: Problem, **errors: list[float]) -> Tensor:
    out = chosen.unknowns_at(MATERIAL.parameters)
    for name, values in errors.items():
        out[chosen.where[name]] = torch.tensor(values, dtype=torch.float64)
    return out


def rendered(scene: Scene, samples: PhotographSamples, batch: Batch) -> Tensor:
    """The radiance of the samples of a batch in another scene, whose surface may have other pixels."""
    images = render(scene, MATERIAL, dtype=torch.float64).flatten(1, 2)
    flat = torch.from_numpy(samples.photographs.scene.surface.pixels)[batch.pixels]
    return images[samples.groups.image_of(batch), flat]


def lit_by(scene: Scene, change: Callable[[int, DirectionalLight], DirectionalLight]) -> Scene:
    lights = tuple((change(image, light),) for image, (light,) in enumerate(scene.lights))
    return replace(scene, lights=lights)


def turned(light: DirectionalLight, by: Tensor) -> DirectionalLight:
    toward = light.direction + torch.linalg.cross(by, light.direction)
    return replace(light, direction=toward / toward.norm())


def inside(samples: PhotographSamples, batch: Batch) -> Tensor:
    """Samples far from the outline and from the shadow's edge."""
    surface = samples.photographs.scene.surface
    mask = torch.from_numpy(surface.mask).double()[None, None]
    eroded = -torch.nn.functional.max_pool2d(-mask, 2 * RIM + 1, 1, RIM)[0, 0].flatten()
    return (eroded[torch.from_numpy(surface.pixels)][batch.pixels] > 0) & (batch.points.wi[:, 0, 2] > 0.2)


def relative_error(model: Tensor, truth: Tensor) -> float:
    return float((model - truth).abs().max() / truth.abs().max())


def test_light_that_is_brighter_and_an_image_that_is_longer_exposed_scale_its_radiance() -> None:
    samples = samples_of()
    batch = everything(samples)
    for name in ("intensity", "exposure"):
        chosen = calibrated(samples, name)
        model = CalibratedModel(chosen, unknowns_with(chosen, **{name: [0.1, 0, 0, 0, 0, -0.05]})).radiance(batch)
        factor = torch.tensor([1.1, 1, 1, 1, 1, 0.95], dtype=torch.float64)[samples.groups.image_of(batch)]
        exact = rendered(samples.photographs.scene, samples, batch) * factor[:, None]
        assert relative_error(model, exact) < 1e-12, name


def panel(position: tuple[float, float, float], order: int) -> PointLight:
    """A square of light that faces the sphere."""
    light = point(position, 30.0, 28.0, 25.0)
    axis = -light.position / light.position.norm()
    across = torch.linalg.cross(axis, torch.tensor([0.0, 1.0, 0.0]).double())
    sides = 0.4 * torch.stack([across / across.norm(), torch.linalg.cross(axis, across / across.norm())])
    return replace(light, axis=axis, source=Source(sides, order=order))


def test_lights_with_a_size_have_one_strength_for_all_points_that_stand_for_them() -> None:
    """Images with different numbers of lights and points, together and each by itself."""
    lights = ((panel((2.0, 0.5, 3.0), 3),), (panel((-2.0, 0.5, 3.0), 2), coloured()[0][0]), coloured()[1])
    samples = samples_of(Studio(size=64, lights=lights))
    chosen = calibrated(samples, "intensity", "direction")
    values = [0.1, -0.05, 0.2, 0.02]
    model = CalibratedModel(chosen, unknowns_with(chosen, intensity=values))
    strengths = iter([1 + value for value in values])
    changed = tuple(
        tuple(
            replace(light, intensity=light.intensity * next(strengths))
            if isinstance(light, PointLight)
            else replace(light, irradiance=light.irradiance * next(strengths))
            for light in some
        )
        for some in lights
    )
    scene = replace(samples.photographs.scene, lights=changed)
    alone = [samples.at(position, samples.indices(position)) for position in range(len(samples.images))]
    for batch in (*alone, join(alone)):
        assert relative_error(model.radiance(batch), rendered(scene, samples, batch)) < 1e-12


def test_all_lights_turned_together_are_a_scene_of_turned_lights() -> None:
    samples = samples_of()
    batch, by = everything(samples), torch.tensor([0.02, -0.01, 0.03], dtype=torch.float64)
    chosen = calibrated(samples, "rotation")
    model = CalibratedModel(chosen, unknowns_with(chosen, rotation=by.tolist())).radiance(batch)
    exact = rendered(lit_by(samples.photographs.scene, lambda _, light: turned(light, by)), samples, batch)
    assert relative_error(model, exact) < 1e-12


@pytest.mark.parametrize("axis", [0, 1])
def test_errors_of_a_direction_tilt_one_light_by_that_angle(axis: int) -> None:
    samples = samples_of()
    batch, chosen = everything(samples), calibrated(samples, "direction")
    errors = [0.0] * 12
    errors[2 + axis] = 0.02
    model = CalibratedModel(chosen, unknowns_with(chosen, direction=errors)).radiance(batch)
    toward = samples.photographs.scene.lights[1][0].direction
    first = torch.linalg.cross(torch.tensor([0.0, 1.0, 0.0]).double(), toward)
    across = first / first.norm()
    tilted = toward + 0.02 * (torch.linalg.cross(toward, across) if axis else across)
    assert math.degrees(math.acos(float(tilted @ toward / tilted.norm()))) == pytest.approx(
        math.degrees(0.02), rel=1e-3
    )
    scene = lit_by(
        samples.photographs.scene,
        lambda image, light: replace(light, direction=tilted / tilted.norm()) if image == 1 else light,
    )
    assert relative_error(model, rendered(scene, samples, batch)) < 1e-12


def test_ambient_light_is_an_even_sky_relative_to_the_key_light() -> None:
    samples = samples_of()
    batch, chosen = everything(samples), calibrated(samples, "ambient")
    model = CalibratedModel(chosen, unknowns_with(chosen, ambient=[0.02])).radiance(batch)
    scene = samples.photographs.scene
    sky = 0.02 * scene.lights[0][0].irradiance / math.pi
    assert relative_error(model, rendered(replace(scene, ambient=sky.expand(6, 3)), samples, batch)) < 1e-12


def test_errors_of_the_sensor_change_what_is_decoded() -> None:
    samples = samples_of()
    batch = everything(samples)
    true = rendered(samples.photographs.scene, samples, batch)
    size = STUDIO.size
    rows, columns = np.divmod(samples.photographs.scene.surface.pixels[batch.pixels.numpy()], size)
    distance = torch.from_numpy(((rows + 0.5 - size / 2) ** 2 + (columns + 0.5 - size / 2) ** 2) / (size**2 / 2))
    expected = {
        "black": ([0.01, 0.0, -0.02], true + torch.tensor([0.01, 0.0, -0.02])),
        "transfer": ([0.1], true.clamp(min=1e-4) ** 0.1 * true),
        "vignetting": ([0.1], true * (1 - 0.1 * distance[:, None])),
        "scale": ([0.1], true * 1.1),
    }
    for name, (errors, decoded) in expected.items():
        chosen = calibrated(samples, name)
        model = CalibratedModel(chosen, unknowns_with(chosen, **{name: errors})).radiance(batch)
        assert relative_error(model, decoded) < 1e-7, name


@pytest.mark.parametrize(("name", "errors", "dx", "dy", "growth"), [
    ("shift", [0.3, -0.2], 0.3, -0.2, 0.0), ("radius", [0.3], 0.0, 0.0, 0.3),
])  # fmt: skip
def test_a_sphere_that_is_elsewhere_or_larger_has_other_normals(
    name: str, errors: list[float], dx: float, dy: float, growth: float
) -> None:
    studio = replace(STUDIO, size=128)
    samples = samples_of(studio)
    batch, chosen = everything(samples), calibrated(samples, name)
    surface, scene = samples.photographs.scene.surface, samples.photographs.scene
    low, high = (edge.tolist() for edge in samples.calibration(["shift"])._worlds.grid.box)
    centre, radius = ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2), (high[0] - low[0]) / 2
    # The mask's box is not quite the circle: compare a displacement, not a position.
    before, after = (
        rendered(replace(scene, surface=from_sphere(surface.shape, place, size, None)), samples, batch)
        for place, size in ((centre, radius), ((centre[0] + dx, centre[1] + dy), radius + growth))
    )
    model = CalibratedModel(chosen, unknowns_with(chosen, **{name: errors})).radiance(batch)
    exact = rendered(scene, samples, batch)
    safe = inside(samples, batch)
    change, expected = (model - exact)[safe], (after - before)[safe]
    assert float((change - expected).square().mean().sqrt()) < 0.05 * float(expected.square().mean().sqrt())


@pytest.mark.parametrize("width", [0.7, 1.0, 1.5, 2.0])
def test_blur_is_that_of_a_gaussian(width: float) -> None:
    studio = replace(STUDIO, size=128)
    samples = samples_of(studio)
    batch, chosen = everything(samples), calibrated(samples, "blur")
    model = CalibratedModel(chosen, unknowns_with(chosen, blur=[width**2])).radiance(batch)
    scene = samples.photographs.scene
    images = render(scene, MATERIAL, dtype=torch.float64).numpy()
    blurred = torch.from_numpy(
        np.stack([gaussian_filter(image, (width, width, 0.0)) for image in images]).reshape(6, -1, 3)
    )
    flat = torch.from_numpy(scene.surface.pixels)[batch.pixels]
    image, safe = samples.groups.image_of(batch), inside(samples, batch) & (batch.points.wo[:, 2] > 0.5)
    sharp = torch.from_numpy(images.reshape(6, -1, 3))[image, flat]
    change, expected = (model - sharp)[safe], (blurred[image, flat] - sharp)[safe]
    assert float((change - expected).square().mean().sqrt()) < 0.05 * float(expected.square().mean().sqrt())


def test_polynomials_are_uncorrelated_over_the_object() -> None:
    surface = samples_of().photographs.scene.surface
    values = Grid(surface).polynomials(torch.arange(len(surface)))
    assert float((values[:, 0] - 1).abs().max()) < 1e-5
    assert float((values.T @ values / len(values) - torch.eye(TERMS)).abs().max()) < 0.01


def test_an_albedo_that_varies_keeps_its_mean() -> None:
    samples = samples_of()
    batch, chosen = everything(samples), calibrated(samples, "albedo_field")
    model = CalibratedModel(chosen, unknowns_with(chosen, albedo_field=[0.1, *[0.0] * (TERMS - 2)])).radiance(batch)
    ratio = (model / rendered(samples.photographs.scene, samples, batch)).log()[inside(samples, batch)]
    assert 0.05 < float(ratio.std()) < 0.2
    assert abs(float(ratio.mean())) < 0.05


@pytest.mark.parametrize("name", [*NUISANCES])
def test_derivatives_are_those_of_finite_differences(name: str) -> None:
    samples = samples_of(replace(STUDIO, size=32, ambient=0.05))
    batch, chosen = everything(samples), calibrated(samples, name)
    generator = torch.Generator().manual_seed(0)
    place = chosen.where[name]
    unknowns = chosen.unknowns_at(MATERIAL.parameters)
    unknowns[place] = 0.01 * torch.randn(place.stop - place.start, generator=generator, dtype=torch.float64)
    if name == "blur":
        # Derivatives by everything else are those without blur.
        unknowns[place] = 0.0
    tangent = CalibratedModel(chosen, unknowns).tangent(batch)
    change = torch.randn(len(unknowns), generator=generator, dtype=torch.float64)
    step, ends = 1e-6, []
    for sign in (1, -1):
        ends.append(CalibratedModel(chosen, unknowns + sign * step * change).radiance(batch))
    expected = (ends[0] - ends[1]) / (2 * step)
    touched = change[chosen.places[samples.groups.group_of(batch)]].T
    found = (tangent.jacobian * touched).sum(1).T
    assert float((found - expected).abs().max()) < 1e-5 * float(expected.abs().max())


def test_light_that_is_stated_twice_has_one_error() -> None:
    studio = replace(STUDIO, lights=(*STUDIO.lights, STUDIO.lights[0]))
    calibration = samples_of(studio).calibration(["direction", "exposure"])
    direction, exposure = calibration.families
    assert direction.count == 12
    assert exposure.count == 7


def test_a_capture_is_not_changed_by_errors_that_are_zero() -> None:
    capture: Capture = STUDIO.photograph(MATERIAL, 0)
    samples = capture.photographs.samples(dtype=torch.float64)
    batch, chosen = everything(samples), calibrated(samples, *NUISANCES)
    model = CalibratedModel(chosen, unknowns_with(chosen)).radiance(batch)
    assert relative_error(model, rendered(samples.photographs.scene, samples, batch)) < 1e-12
