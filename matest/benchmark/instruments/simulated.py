"""Small captures with known truth, drawn at random and held in memory as a camera would have stored them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from zlib import crc32

import numpy as np
import torch
import trimesh

from matest.brdf import Brdf, model
from matest.capture import Capture
from matest.photographs.noise import Noise
from matest.photographs.photographs import Photographs
from matest.photographs.photometry import Encoding
from matest.scene import DirectionalLight, Scene, Surface
from matest.scene.camera import Camera
from matest.scene.mesh import Mesh
from matest.scene.surface import from_mesh, from_sphere
from matest.shading import render_image
from matest.simulate import stored_pixels

SIZE = 64
IRRADIANCE = 3.0
# The farthest that a light stands off the camera, degrees.
_OBLIQUE = 75.0
# Fraction of full scale from which on a pixel counts as saturated.
SATURATION = 0.98
# Radius of the vase at evenly spaced heights from foot to lip.
_OUTLINE = (0.38, 0.46, 0.56, 0.62, 0.61, 0.52, 0.39, 0.31, 0.33, 0.42)

# Ranges that the truth is drawn from: (lowest, highest, logarithmic).
_RANGES = {
    "albedo": (0.1, 0.9, False),
    "sigma": (math.radians(5), math.radians(50), False),
    "diffuse": (0.05, 0.8, False),
    "specular": (0.1, 0.9, False),
    "slope": (0.05, 0.5, True),
    "k_dd": (0.1, 0.9, False),
    "k_uds": (0.05, 0.8, False),
    # rms slope 2σ/τ of 0.05 to 0.5 at the default height σ = 1 µm.
    "correlation_length": (4.0, 40.0, True),
}


@dataclass(frozen=True)
class Conditions:
    """How a camera spoils what it photographs.

    Attributes:
        bits: of the images, 8 or 16, linear.
        outliers: share of the pixels that hold a value drawn evenly from the range of the sensor.
        saturated: share of the lit pixels that are brighter than the sensor can tell; 0 exposes for the brightest.
    """

    bits: int = 16
    outliers: float = 0.0
    saturated: float = 0.0


CLEAN = Conditions()


@dataclass(frozen=True)
class Draw:
    """A material, an object, lights and a camera.

    Attributes:
        seed: that it was drawn with.
        material: the truth.
        scene: a sphere or a vase under 1, 3 or 12 lights, one a photograph.
        radiance: noise-free, per image [N, C].
        noise: of the camera, before the pixels are rounded.
        black: pedestal, fraction of full scale.
        exposed: where the brightest pixel lies if none is to be saturated, fraction of full scale.
    """

    seed: int
    material: Brdf
    scene: Scene
    radiance: tuple[np.ndarray, ...]
    noise: Noise
    black: float
    exposed: float

    def scale(self, conditions: Conditions) -> float:
        """Radiance of full scale."""
        if not conditions.saturated:
            return max(float(image.max()) for image in self.radiance) / (self.exposed - self.black)
        brightest = np.concatenate([image.max(axis=1) for image in self.radiance])
        level = np.quantile(brightest[brightest > 0], 1 - conditions.saturated)
        return float(level) / (SATURATION - self.black)

    def ideal(self, conditions: Conditions) -> Capture:
        """Without noise, rounding, outliers and clipping; but pixels that would be saturated count as such."""
        encoding = Encoding(scale=self.scale(conditions), black=self.black, saturation=SATURATION)
        pixels = [(image / encoding.scale + self.black).astype(np.float32) for image in self.radiance]
        return self._capture(tuple(pixels), encoding, conditions)

    def photograph(self, conditions: Conditions) -> Capture:
        """As the camera stores it. The same draw gives the same pixels every time."""
        generator = np.random.default_rng([crc32(self.material.expression.encode()), self.seed, conditions.bits])
        encoding = Encoding(scale=self.scale(conditions), black=self.black, saturation=SATURATION)
        stored = []
        for image in self.radiance:
            signal = image / encoding.scale
            spread = np.sqrt(self.noise.read**2 + self.noise.gain * signal)
            pixels = signal + self.black + spread * generator.standard_normal(signal.shape)
            stray = generator.random(len(pixels)) < conditions.outliers
            pixels[stray] = generator.random((int(stray.sum()), pixels.shape[1]))
            stored.append(stored_pixels(pixels, encoding, conditions.bits))
        return self._capture(tuple(stored), encoding, conditions)

    def _capture(self, stored: tuple[np.ndarray, ...], encoding: Encoding, conditions: Conditions) -> Capture:
        dtype = np.dtype(np.uint8 if conditions.bits == 8 else np.uint16)
        photographs = Photographs(
            scene=self.scene,
            stored=stored,
            encoding=encoding,
            exposures=(1.0,) * len(stored),
            noise=self.noise.with_rounding(encoding, dtype),
            noise_stated=True,
            relative=False,
            names=tuple(f"{number:02d}.png" for number in range(len(stored))),
        )
        return Capture(f"{self.material.expression} {self.seed}", photographs)


def draw(expression: str, seed: int) -> Draw:
    """Draw at random: sphere or vase; 1, 3 or 12 lights; one channel or three; material, noise and exposure.

    Args:
        expression: of the model. Albedos and scales of lobes 0.05 to 0.9, σ 5° to 50°, slopes 0.05 to 0.5; other
            parameters keep their defaults.
        seed: the same seed draws the same.
    """
    generator = np.random.default_rng([crc32(expression.encode()), seed])
    brdf = model(expression)[0]
    channels = int(generator.choice((1, 3)))
    values = {}
    for name, declared in brdf.declared.items():
        if name in _RANGES:
            low, high, log = _RANGES[name]
            size = channels if declared.per_channel else 1
            share = generator.random(size)
            value = low * (high / low) ** share if log else low + (high - low) * share
            values[name] = torch.as_tensor(value if declared.per_channel else value[0])
    material = brdf.replace(values)
    surface = (sphere, vase)[generator.integers(2)](SIZE)
    count = int(generator.choice((1, 3, 12)))
    irradiance = torch.full((channels,), IRRADIANCE, dtype=torch.float64)
    lights = tuple((DirectionalLight(_direction(generator), irradiance),) for _ in range(count))
    scene = Scene(surface, lights, torch.zeros(count, channels, dtype=torch.float64)).with_shadows()
    images = [render_image(scene, number, material, dtype=torch.float64).detach().numpy() for number in range(count)]
    return Draw(
        seed=seed,
        material=material,
        scene=scene,
        radiance=tuple(image.reshape(-1, channels)[surface.pixels] for image in images),
        noise=Noise(5e-4 * 10 ** generator.random(), 1e-5 * 100 ** generator.random()),
        black=float(generator.choice((0.0, 0.03))),
        exposed=0.5 + 0.4 * generator.random(),
    )


def _direction(generator: np.random.Generator) -> torch.Tensor:
    """A unit vector, evenly drawn within `_OBLIQUE` of the camera."""
    z = 1 - generator.random() * (1 - math.cos(math.radians(_OBLIQUE)))
    turn = 2 * math.pi * generator.random()
    across = math.sqrt(1 - z * z)
    return torch.tensor([across * math.cos(turn), across * math.sin(turn), z], dtype=torch.float64)


@lru_cache(maxsize=1)
def sphere(size: int) -> Surface:
    """A sphere in the middle of square images of `size` pixels."""
    return from_sphere((size, size), (size / 2, size / 2), 0.46 * size, None)


@lru_cache(maxsize=1)
def vase(size: int) -> Surface:
    """A vase that casts shadows on itself, its axis upright, in square images of `size` pixels."""
    heights = np.linspace(-1, 1, 40)
    radii = np.interp(heights, np.linspace(-1, 1, len(_OUTLINE)), _OUTLINE)
    outline = np.concatenate([[[0, -1]], np.stack([radii, heights], axis=1), [[0, 1]]])
    solid = trimesh.creation.revolve(outline, sections=64)
    # trimesh revolves about z; the camera's up is y.
    solid.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    mesh = Mesh(np.asarray(solid.vertices), np.asarray(solid.faces))
    return from_mesh(mesh, Camera(position=(0.0, 0.0, 5.0), height=2.2), (size, size))
