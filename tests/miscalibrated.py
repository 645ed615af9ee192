"""Captures whose calibration is wrong: the scene that made the images is not the one that is stated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from matest.brdf import Brdf
from matest.capture import Capture
from matest.photographs.noise import Noise
from matest.scene import DirectionalLight, Scene
from matest.shading import render
from tests.simulated import CAMERA, Studio, coloured

DIRECTIONS = (
    (0.0, 0.35, 0.94), (0.7, 0.2, 0.68), (-0.7, 0.2, 0.68), (0.35, 0.8, 0.48), (-0.35, -0.6, 0.72),
    (0.45, -0.4, 0.8), (-0.3, 0.5, 0.81), (0.1, -0.15, 0.98),
)  # fmt: skip
# A quarter of the usual noise variance on a small sphere: as narrow error bars as a larger one has.
STUDIO = Studio(size=32, lights=coloured(DIRECTIONS), noise=Noise(CAMERA.read / 2, CAMERA.gain / 4))

# What makes the true scene of the one that is stated.
Error = Callable[[Scene], Scene]


def photographed(material: Brdf, error: Error, seed: int, studio: Studio = STUDIO) -> Capture:
    """A capture with noise that states the studio's scene and shows another one."""
    scene = error(studio.scene)
    images = render(scene, material, dtype=torch.float64).detach().numpy()
    return studio.expose(images.reshape(len(scene), -1, scene.channels)[:, scene.surface.pixels], seed)


def of_lights(change: Callable[[int, DirectionalLight], DirectionalLight]) -> Error:
    def error(scene: Scene) -> Scene:
        return replace(scene, lights=tuple((change(image, light),) for image, (light,) in enumerate(scene.lights)))

    return error


def brighter(errors: Tensor) -> Error:
    """Lights that are stronger by these relative errors [K]."""
    return of_lights(lambda image, light: replace(light, irradiance=light.irradiance * (1 + errors[image])))


def tilted(errors: Tensor) -> Error:
    """Lights that are elsewhere by these vectors [K, 3], of which what lies across them counts."""

    def change(image: int, light: DirectionalLight) -> DirectionalLight:
        toward = light.direction + errors[image] - (errors[image] @ light.direction) * light.direction
        return replace(light, direction=toward / toward.norm())

    return of_lights(change)


def under_sky(share: float) -> Error:
    """An even sky whose irradiance is this share of the first light's."""

    def error(scene: Scene) -> Scene:
        sky = share * scene.lights[0][0].irradiance / torch.pi
        return replace(scene, ambient=sky.expand(len(scene), -1))

    return error


def normal_deviates(*shape: int, seed: int) -> Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
