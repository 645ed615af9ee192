"""Simulated photographs: in memory, as a camera would have stored them, and in files, as large as a camera's."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from zlib import crc32

import numpy as np
import tomli_w
import torch
import trimesh

from matest.brdf import Brdf, model
from matest.capture import Capture
from matest.estimation.options import Options
from matest.estimation.specification import specify
from matest.estimators import Problem, accumulate
from matest.estimators.covariance import Covariance, fisher
from matest.photographs.noise import Noise
from matest.photographs.photographs import Photographs
from matest.photographs.photometry import Encoding
from matest.scene import DirectionalLight, Scene, Surface
from matest.scene.camera import Camera
from matest.scene.mesh import Mesh
from matest.scene.surface import from_mesh, from_sphere
from matest.shading import render_image
from matest.simulate import expose, simulate, stored_pixels

# Irradiance of a surface facing a light.
IRRADIANCE = 3.0
# Fraction of full scale from which on a pixel counts as saturated.
SATURATION = 0.98
# Radius of the sphere as a share of the image.
RADIUS = 0.46
# The same of photographs in files: 0.8 million pixels of 1024×1024.
_RADIUS_IN_FILES = math.sqrt(0.8e6 / 1024**2 / math.pi)
# Radius of the vase at evenly spaced heights from foot to lip.
_OUTLINE = (0.38, 0.46, 0.56, 0.62, 0.61, 0.52, 0.39, 0.31, 0.33, 0.42)

# World units across the height of images of the vase, which is 2 high.
_VASE_HEIGHT = 2.2

_GLOSSY: dict[str, Any] = {"diffuse": [0.4, 0.2, 0.1], "specular": [0.8, 0.8, 0.8], "slope": 0.2, "f0": 0.04}
MATERIALS: dict[str, dict[str, Any]] = {
    "oren-nayar": {"albedo": [0.7, 0.5, 0.3], "sigma": 0.6},
    "cook-torrance": _GLOSSY,
    "cook-torrance(masking=smith)": _GLOSSY,
}
# Parameters that whoever estimates these materials fixes.
FIX = {name: {"f0": material["f0"]} if "f0" in material else {} for name, material in MATERIALS.items()}


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
NOISE = Noise(read=0.002, gain=2e-4)


@dataclass(frozen=True)
class Sensor:
    """The part of a camera that stores light as numbers.

    Attributes:
        noise: before the pixels are rounded.
        black: pedestal, fraction of full scale.
        exposed: where the brightest pixel lies if none is to be saturated, fraction of full scale.
        conditions: what else befalls the pixels.
    """

    noise: Noise = NOISE
    black: float = 0.0
    exposed: float = 0.9
    conditions: Conditions = CLEAN


@dataclass(frozen=True, eq=False)
class Subject:
    """An object of one material under its lights, before a sensor.

    Attributes:
        scene: the object, and one light a photograph.
        material: the truth.
        sensor: that it is photographed with.
        seed: of the noise.
        radiance: noise-free, per image [N, C].
    """

    scene: Scene
    material: Brdf
    sensor: Sensor
    seed: int
    radiance: tuple[np.ndarray, ...]

    @property
    def encoding(self) -> Encoding:
        """From pixels to radiance, exposed as the sensor is to be."""
        sensor, share = self.sensor, self.sensor.conditions.saturated
        if share:
            brightest = np.concatenate([image.max(axis=1) for image in self.radiance])
            level, place = np.quantile(brightest[brightest > 0], 1 - share), SATURATION
        else:
            level, place = max(image.max() for image in self.radiance), sensor.exposed
        return Encoding(scale=float(level) / (place - sensor.black), black=sensor.black, saturation=SATURATION)

    def ideal(self) -> Capture:
        """Without noise, rounding, outliers and clipping; but pixels that would be saturated count as such."""
        encoding = self.encoding
        pixels = [(image / encoding.scale + encoding.black).astype(np.float32) for image in self.radiance]
        return self._capture(pixels, encoding)

    def photograph(self) -> Capture:
        """As the sensor stores it. The same subject gives the same pixels every time."""
        sensor, conditions = self.sensor, self.sensor.conditions
        generator = np.random.default_rng([crc32(self.material.expression.encode()), self.seed, conditions.bits])
        encoding, stored = self.encoding, []
        for image in self.radiance:
            pixels = expose(image, 1.0, encoding, sensor.noise, generator)
            stray = generator.random(len(pixels)) < conditions.outliers
            pixels[stray] = generator.random((int(stray.sum()), pixels.shape[1]))
            stored.append(stored_pixels(pixels, encoding, conditions.bits))
        return self._capture(stored, encoding)

    def problem(self, fix: Mapping[str, Any]) -> Problem:
        """What is estimated of it, some parameters fixed."""
        options, channels = Options(fix=dict(fix)), self.scene.channels
        return specify(self.material.expression, options, channels=channels, relative=False, scene=self.scene).problem

    def cramer_rao(self, problem: Problem) -> Covariance:
        """The least covariance of the unknowns [P], for an observer who knows which pixels are outliers or saturated.

        Every other lit pixel off the rim counts, weighed by the noise at its true radiance.
        """
        truth = problem.unknowns_at(self.material.parameters)
        tiles = self.ideal().samples(dtype=torch.float64).tiles(merge=False)
        clean = 1 - self.sensor.conditions.outliers
        information = accumulate(problem, truth, tiles, truth).information * clean
        return fisher(information, torch.ones(problem.size, dtype=torch.bool))

    def _capture(self, stored: Sequence[np.ndarray], encoding: Encoding) -> Capture:
        dtype = np.dtype(np.uint8 if self.sensor.conditions.bits == 8 else np.uint16)
        photographs = Photographs(
            scene=self.scene,
            stored=tuple(stored),
            encoding=encoding,
            exposures=(1.0,) * len(stored),
            noise=self.sensor.noise.with_rounding(encoding, dtype),
            noise_stated=True,
            relative=False,
            names=tuple(f"{number:02d}.png" for number in range(len(stored))),
        )
        return Capture(f"{self.material.expression} {self.seed}", photographs)


def subject(
    surface: Surface,
    lights: np.ndarray,
    material: Brdf,
    sensor: Sensor,
    *,
    channels: int = 3,
    seed: int = 1,
) -> Subject:
    """Put an object before a sensor, under one light a photograph: unit vectors toward them [K, 3]."""
    irradiance = torch.full((channels,), IRRADIANCE, dtype=torch.float64)
    lamps = tuple((DirectionalLight(torch.from_numpy(toward), irradiance),) for toward in lights)
    scene = Scene(surface, lamps, torch.zeros(len(lamps), channels, dtype=torch.float64)).with_shadows()
    images = (render_image(scene, k, material, dtype=torch.float64).detach().numpy() for k in range(len(lamps)))
    radiance = tuple(image.reshape(-1, channels)[surface.pixels] for image in images)
    return Subject(scene, material, sensor, seed, radiance)


def material_of(expression: str) -> Brdf:
    """The material of `MATERIALS[expression]`."""
    values = MATERIALS[expression].items()
    return model(expression)[0].replace({name: torch.tensor(value, dtype=torch.float64) for name, value in values})


@contextmanager
def in_files(expression: str, *, images: int, size: int, mesh: bool = False) -> Iterator[Path]:
    """A folder, while it is needed, with so many photographs, of `size`×`size` pixels, of a sphere of a material.

    They are 16-bit RGB PNG with camera noise, each under one light. With `mesh` the object is the mesh of a vase, whose
    neck lies in its own shadow here and there.
    """
    geometry = {"shape": "sphere", "centre": [size / 2, size / 2], "radius": _RADIUS_IN_FILES * size}
    scene = {
        "material": {"model": expression, **MATERIALS[expression]},
        "geometry": {"mesh": "vase.ply"} if mesh else geometry,
        "camera": {"resolution": [size, size], **({"height": _VASE_HEIGHT} if mesh else {})},
        "encoding": {"transfer": "linear", "saturation": SATURATION},
        "noise": {"read": NOISE.read, "gain": NOISE.gain, "bits": 16, "seed": 1},
        "image": [
            {"lights": [{"direction": toward.tolist(), "irradiance": [IRRADIANCE] * 3}]} for toward in ring(images)
        ],
    }
    with TemporaryDirectory() as folder:
        if mesh:
            _revolved().export(Path(folder, "vase.ply"))
        file = Path(folder, "scene.toml")
        file.write_text(tomli_w.dumps(scene), "utf-8")
        yield simulate(file)


def ring(count: int) -> np.ndarray:
    """Unit vectors [count, 3] to lights that stand 10° to 60° off the camera, all around it."""
    number = np.arange(count)
    polar = np.deg2rad(10 + 50 * (number + 0.5) / count)
    # The golden angle: no two lights on one side.
    azimuth = number * math.pi * (3 - math.sqrt(5))
    return np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=1)


@lru_cache(maxsize=1)
def sphere(size: int) -> Surface:
    """A sphere in the middle of square images of `size` pixels."""
    return from_sphere((size, size), (size / 2, size / 2), RADIUS * size, None)


@lru_cache(maxsize=1)
def vase(size: int) -> Surface:
    """A vase that casts shadows on itself, its axis upright, in square images of `size` pixels."""
    return turned_vase(size, np.eye(3))


def turned_vase(size: int, rotation: np.ndarray) -> Surface:
    """The same vase turned about its middle by a matrix [3, 3]."""
    solid = _revolved()
    mesh = Mesh(np.asarray(solid.vertices) @ rotation.T, np.asarray(solid.faces))
    return from_mesh(mesh, Camera(position=(0.0, 0.0, 5.0), height=_VASE_HEIGHT), (size, size))


def _revolved() -> trimesh.Trimesh:
    """The solid of the vase."""
    heights = np.linspace(-1, 1, 40)
    radii = np.interp(heights, np.linspace(-1, 1, len(_OUTLINE)), _OUTLINE)
    outline = np.concatenate([[[0, -1]], np.stack([radii, heights], axis=1), [[0, 1]]])
    solid = trimesh.creation.revolve(outline, sections=64)
    # trimesh revolves about z; the camera's up is y.
    solid.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    return solid
