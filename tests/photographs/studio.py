"""Photographs of a sphere and of two plates, in memory."""

from __future__ import annotations

import dataclasses

import numpy as np
import torch
import trimesh

from matest.brdf import Lambert
from matest.photographs.noise import Noise
from matest.photographs.photographs import Photographs
from matest.photographs.photometry import Encoding
from matest.scene import Camera, Mesh, Scene
from matest.scene.surface import from_mesh
from matest.shading import render
from tests.captures import directional, point, sphere_surface

MATERIAL = Lambert(albedo=[0.7, 0.5, 0.3])
LEFT, RIGHT = directional((-0.5, 0.1, 0.8), 1.0, 2.0, 1.5), directional((0.6, -0.3, 0.5), 2.0, 1.0, 1.0)
NEAR = point((0.5, 1.0, 3.0), 6.0, 7.0, 8.0)
# Images with one, two and no lights, the last one under an even sky.
MIXED = ((LEFT,), (RIGHT, NEAR), ())
MIXED_AMBIENT = (0.0, 0.0, 0.2)


def photograph(scene: Scene, full: int | None = None, **changes: object) -> Photographs:
    """Photographs of the scene made of `MATERIAL`: floats, or integers up to `full` = radiance 1."""
    images = render(scene, MATERIAL, dtype=torch.float64).numpy()
    stored = images.reshape(len(scene), -1, scene.channels)[:, scene.surface.pixels]
    if full is None:
        stored = stored.astype(np.float32)
    else:
        stored = np.round(full * stored).clip(0, full).astype(np.uint8 if full == 255 else np.uint16)
    photographs = Photographs(
        scene=scene,
        stored=tuple(stored),
        encoding=Encoding(),
        exposures=(1.0,) * len(scene),
        noise=Noise(0.001, 0.0001),
        noise_stated=True,
        relative=False,
        names=tuple(f"image {number}" for number in range(len(scene))),
    )
    return dataclasses.replace(photographs, **changes)


def sphere_scene(lights=MIXED, ambient=MIXED_AMBIENT, size: int = 32) -> Scene:
    sky = torch.tensor(ambient, dtype=torch.float64)[:, None].expand(-1, 3)
    return Scene(sphere_surface(size), tuple(lights), sky)


def plate_scene() -> Scene:
    """A small square plate above a large one: cast shadows."""

    def square(half: float, height: float) -> trimesh.Trimesh:
        corners = [(-half, -half, height), (half, -half, height), (half, half, height), (-half, half, height)]
        return trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)])

    joined = trimesh.util.concatenate([square(1.2, 0.0), square(0.4, 0.7)])
    surface = from_mesh(Mesh(joined.vertices, joined.faces), Camera(position=(0, 0, 5), height=3.0), (40, 50))
    return Scene(surface, ((LEFT,), (RIGHT, LEFT)), torch.zeros(2, 3, dtype=torch.float64)).with_shadows()
