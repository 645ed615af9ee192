"""Photographs of a setting that is not quite what their capture states, and the errors that a setting can have."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import torch
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation
from torch import Tensor
from torch.nn.functional import normalize

from matest.benchmark.instruments.photographs import IRRADIANCE, SATURATION, turned_vase, vase
from matest.benchmark.instruments.waves import Waves, places
from matest.brdf import Brdf
from matest.capture import Capture
from matest.photographs.noise import Noise
from matest.photographs.photographs import Photographs
from matest.photographs.photometry import Encoding
from matest.scene import DirectionalLight, Scene, Surface
from matest.scene.surface import from_sphere
from matest.shading import render_image
from matest.simulate import expose, stored_pixels

# Pixels on a side of the images.
SIZE = 96
# Radius of the sphere, pixels.
RADIUS = 42.0
# Channels of the images.
_CHANNELS = 3
# Where the brightest pixel lies, fraction of full scale.
_EXPOSED = 0.9
# Read noise of 0.3 %, and the shot noise of 10,000 electrons at full scale: a signal-to-noise ratio of 100 there.
_NOISE = Noise(read=0.003, gain=1e-4)

# A change of a setting, drawn at random.
Error = Callable[["Setting", np.random.Generator], "Setting"]


@dataclass(frozen=True, eq=False)
class Setting:
    """An object, its lights and a camera.

    Attributes:
        surface: the object, seen by `rays` × `rays` rays a pixel.
        lights: unit vectors toward the light of each image [K, 3].
        strength: of each light, relative [K].
        ambient: π times the radiance of an even sky over the irradiance of a light of strength 1.
        black: pedestal, fraction of full scale.
        vignetting: loss of radiance at the corner of the image, relative; it grows as the distance squared.
        transfer: how the camera encodes light.
        read_as: how its capture says that it does.
        albedo: factor of the albedo at each pixel [N]; None: 1.
        blur: standard deviation of a Gaussian, pixels.
        rays: per pixel and axis.
    """

    surface: Surface
    lights: np.ndarray
    strength: np.ndarray
    ambient: float = 0.0
    black: float = 0.0
    vignetting: float = 0.0
    transfer: str | float = "linear"
    read_as: str | float = "linear"
    albedo: np.ndarray | None = None
    blur: float = 0.0
    rays: int = 1

    @property
    def scene(self) -> Scene:
        """Its geometry and light."""
        power = torch.full((_CHANNELS,), IRRADIANCE, dtype=torch.float64)
        lamps = tuple(
            (DirectionalLight(torch.from_numpy(toward), power * strength),)
            for toward, strength in zip(self.lights, self.strength.tolist(), strict=True)
        )
        sky = torch.full((len(lamps), _CHANNELS), self.ambient * IRRADIANCE / math.pi, dtype=torch.float64)
        return Scene(self.surface, lamps, sky).with_shadows()

    def radiance(self, material: Brdf, body: str) -> list[np.ndarray]:
        """What reaches the sensor, per image [H, W, C]; `body` is the parameter that `albedo` multiplies."""
        if self.albedo is not None:
            value = material.parameters[body].expand(_CHANNELS) * torch.from_numpy(self.albedo)[:, None]
            material = material.replace({body: value})
        height, width = (side // self.rays for side in self.surface.shape)
        y, x = np.indices((height, width)) + 0.5
        squared = ((x - width / 2) ** 2 + (y - height / 2) ** 2) / ((width / 2) ** 2 + (height / 2) ** 2)
        loss = 1 - self.vignetting * squared[..., None]
        scene, images = self.scene, []
        for number in range(len(scene)):
            image = render_image(scene, number, material, dtype=torch.float64).detach().numpy()
            image = image.reshape(height, self.rays, width, self.rays, -1).mean(axis=(1, 3))
            images.append(loss * gaussian_filter(image, (self.blur, self.blur, 0)))
        return images


def photograph(stated: Setting, true: Setting, material: Brdf, body: str, generator: np.random.Generator) -> Capture:
    """The photographs that a camera takes of a true setting, in a capture that states another one."""
    images = true.radiance(material, body)
    scale = max(float(image.max()) for image in images) / (_EXPOSED - true.black)
    encoding = Encoding(transfer=true.transfer, scale=scale, black=true.black)
    pixels = stated.surface.pixels
    stored = []
    for image in images:
        light = expose(image.reshape(-1, _CHANNELS)[pixels], 1.0, encoding, _NOISE, generator)
        stored.append(stored_pixels(light, encoding, 16))
    read = Encoding(transfer=true.read_as, scale=scale, saturation=SATURATION)
    photographs = Photographs(
        scene=stated.scene,
        stored=tuple(stored),
        encoding=read,
        exposures=(1.0,) * len(stored),
        noise=_NOISE.with_rounding(read, np.dtype(np.uint16)),
        noise_stated=True,
        relative=False,
        names=tuple(f"{number:02d}.png" for number in range(len(stored))),
    )
    return Capture(material.expression, photographs)


@lru_cache(maxsize=2)
def ball(rays: int = 1) -> Surface:
    """A sphere in the middle of the images."""
    return circle((SIZE / 2, SIZE / 2), RADIUS, rays)


def circle(centre: tuple[float, float], radius: float, rays: int = 1) -> Surface:
    """A sphere of this centre and radius in pixels."""
    side = rays * SIZE
    return from_sphere((side, side), (rays * centre[0], rays * centre[1]), rays * radius, None)


def together(*errors: Error) -> Error:
    """One error after the other."""

    def apply(setting: Setting, generator: np.random.Generator) -> Setting:
        for error in errors:
            setting = error(setting, generator)
        return setting

    return apply


def constant(**values: float | str) -> Error:
    """Other values of a setting's attributes."""
    return lambda setting, _: replace(setting, **values)  # type: ignore[arg-type]


def directions(angle: float) -> Error:
    """Both tangential angles of each light are off by a normal deviate times `angle` (rad)."""

    def apply(setting: Setting, generator: np.random.Generator) -> Setting:
        lights = torch.from_numpy(setting.lights)
        angles = angle * generator.standard_normal((len(lights), 2))
        return replace(setting, lights=tilted(lights, angles).numpy())

    return apply


def rotation(angle: float) -> Error:
    """All lights are turned by `angle` (rad) about one random axis."""
    return lambda setting, generator: replace(setting, lights=setting.lights @ _turn(angle, generator).T)


def intensities(relative: float) -> Error:
    """The strength of each light is off by a normal deviate times `relative`."""

    def apply(setting: Setting, generator: np.random.Generator) -> Setting:
        return replace(
            setting, strength=setting.strength * (1 + relative * generator.standard_normal(len(setting.lights)))
        )

    return apply


def radius(pixels: float) -> Error:
    """The sphere is larger or smaller by so much."""

    def apply(setting: Setting, generator: np.random.Generator) -> Setting:
        return replace(setting, surface=circle((SIZE / 2, SIZE / 2), RADIUS + pixels * generator.choice([-1.0, 1.0])))

    return apply


def centre(pixels: float) -> Error:
    """The sphere lies so far off, in a random direction."""

    def apply(setting: Setting, generator: np.random.Generator) -> Setting:
        angle = 2 * math.pi * generator.random()
        x, y = SIZE / 2 + pixels * math.cos(angle), SIZE / 2 + pixels * math.sin(angle)
        return replace(setting, surface=circle((x, y), RADIUS))

    return apply


def turned(angle: float) -> Error:
    """The vase is turned by `angle` (rad) about a random axis."""
    return lambda setting, generator: replace(setting, surface=turned_vase(SIZE, _turn(angle, generator)))


def smooth_normals(angle: float) -> Error:
    """Both tangential angles of the normals are off by a smooth field, a gradient, of rms `angle` (rad) each."""

    def apply(setting: Setting, generator: np.random.Generator) -> Setting:
        gradient = Waves(generator).gradient(places(setting.surface))
        gradient *= angle / np.sqrt(np.mean(gradient**2))
        return _with_normals(setting, gradient)

    return apply


def noisy_normals(angle: float) -> Error:
    """Both tangential angles of each normal are off by a normal deviate times `angle` (rad)."""

    def apply(setting: Setting, generator: np.random.Generator) -> Setting:
        return _with_normals(setting, angle * generator.standard_normal((len(setting.surface), 2)))

    return apply


def smooth_albedo(rms: float) -> Error:
    """The albedo varies smoothly about its mean, by so much."""

    def apply(setting: Setting, generator: np.random.Generator) -> Setting:
        field = Waves(generator).values(places(setting.surface))
        field -= field.mean()
        return replace(setting, albedo=1 + rms * field / field.std())

    return apply


def two_regions(relative: float) -> Error:
    """The albedo is higher by so much on one side of a line through the middle, and lower on the other."""

    def apply(setting: Setting, generator: np.random.Generator) -> Setting:
        angle = 2 * math.pi * generator.random()
        side = np.sign(places(setting.surface) @ [math.cos(angle), math.sin(angle)])
        return replace(setting, albedo=1 + relative * side)

    return apply


def averaged(rays: int) -> Error:
    """A pixel is the mean over `rays` × `rays` rays."""

    def apply(setting: Setting, _: np.random.Generator) -> Setting:
        return replace(setting, surface=ball(rays) if setting.surface.mesh is None else vase(rays * SIZE), rays=rays)

    return apply


def tilted(vectors: Tensor, angles: np.ndarray) -> Tensor:
    """Unit vectors [n, 3] turned by two tangential angles (rad) each [n, 2], the first along x as far as it can."""
    x = torch.tensor([1.0, 0.0, 0.0], dtype=vectors.dtype)
    first = normalize(x - vectors * vectors[:, :1], dim=1)
    second = torch.linalg.cross(vectors, first)
    across, along = torch.from_numpy(np.tan(angles)).to(vectors.dtype).T[..., None]
    return normalize(vectors + across * first + along * second, dim=1)


def _with_normals(setting: Setting, angles: np.ndarray) -> Setting:
    return replace(setting, surface=replace(setting.surface, normals=tilted(setting.surface.normals, angles)))


def _turn(angle: float, generator: np.random.Generator) -> np.ndarray:
    """The matrix [3, 3] of a turn by `angle` (rad) about a random axis."""
    axis = generator.standard_normal(3)
    matrix: np.ndarray = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
    return matrix
