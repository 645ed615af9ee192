"""Simulated photographs of a sphere, held in memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from matest.brdf import Brdf
from matest.capture import Capture
from matest.photographs.noise import Noise
from matest.photographs.photographs import Photographs
from matest.photographs.photometry import Encoding
from matest.scene import DirectionalLight, Scene
from matest.scene.lights import Light
from matest.shading import render
from tests.captures import directional, sphere_surface

# Lights on all sides of the viewer: highlights inside the outline, and grazing light.
DIRECTIONS = (
    (0.0, 0.35, 0.94),
    (0.7, 0.2, 0.68),
    (-0.7, 0.2, 0.68),
    (0.35, 0.8, 0.48),
    (-0.35, -0.6, 0.72),
    (0.95, 0.1, 0.30),
)

CAMERA = Noise(0.002, 0.0005)


@dataclass(frozen=True)
class Studio:
    """How the sphere is photographed.

    Attributes:
        size: of the images, pixels.
        lights: of every image.
        ambient: radiance of an even sky.
        noise: of the camera; full scale is radiance 1.
        relative: whether the strength of the light is withheld.
    """

    size: int = 48
    lights: tuple[tuple[Light, ...], ...] = tuple((directional(d, 3.0),) for d in DIRECTIONS)
    ambient: float = 0.0
    noise: Noise = CAMERA
    relative: bool = False

    @property
    def scene(self) -> Scene:
        channels = len(self.lights[0][0].power)
        ambient = torch.full((len(self.lights), channels), self.ambient, dtype=torch.float64)
        return Scene(sphere_surface(self.size), self.lights, ambient)

    def clean(self, material: Brdf) -> np.ndarray:
        """Radiance [K, N, C] of the sphere's pixels."""
        scene = self.scene
        images = render(scene, material, dtype=torch.float64).detach().numpy()
        return images.reshape(len(scene), -1, scene.channels)[:, scene.surface.pixels]

    def photograph(self, material: Brdf, seed: int | None = None, brightness: float = 1.0) -> Capture:
        """The capture, with noise unless `seed` is None; the lights are `brightness` times as strong as stated."""
        return self.expose(brightness * self.clean(material), seed)

    def expose(self, radiance: np.ndarray, seed: int | None) -> Capture:
        """A capture of known radiance [K, N, C]."""
        stored = radiance
        if seed is not None:
            spread = np.sqrt(self.noise.read**2 + self.noise.gain * radiance)
            stored = radiance + spread * np.random.default_rng(seed).standard_normal(radiance.shape)
        photographs = Photographs(
            scene=self.scene,
            stored=tuple(stored.astype(np.float32)),
            encoding=Encoding(),
            exposures=(1.0,) * len(self.lights),
            noise=self.noise,
            noise_stated=True,
            relative=self.relative,
            names=tuple(f"{k:02d}.exr" for k in range(len(self.lights))),
        )
        return Capture("sphere", photographs, timing={"read": 0.0, "geometry": 0.0, "noise": 0.0})


def coloured(directions: Sequence[tuple[float, float, float]] = DIRECTIONS) -> tuple[tuple[DirectionalLight, ...], ...]:
    """One light of three channels an image."""
    return tuple((directional(d, 3.0, 2.8, 2.5),) for d in directions)
