"""The distant light under which one more photograph would help most."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from matest.identifiability.forecast import Forecast, forecast, predicted_samples
from matest.photographs.lattice import on_lattice
from matest.photographs.photographs import Photographs
from matest.progress import Progress, silent
from matest.scene import DirectionalLight, Scene, Surface

# Candidate directions, evenly spaced: about 15° apart.
_CANDIDATES = 80
# Largest angle of a candidate to the camera's direction, degrees: beyond, little of the surface is lit and visible.
_LARGEST_ANGLE = 80.0
# Best candidates by the ranking, which are compared again on all pixels.
_FINALISTS = 4
# Pixels, evenly spread over the object, that suffice to rank candidates.
_RANKING_PIXELS = 6_000


def next_light(
    photographs: Photographs, before: Forecast, progress: Progress = silent
) -> tuple[DirectionalLight, Forecast] | None:
    """The distant light that lowers the largest relative error bar most, and the forecast with it added.

    Its irradiance and exposure are the means of those of the photographs, its noise is theirs. Shadows are traced. Two
    candidates compare first by the number of parameters left undetermined. None if no light lowers any error bar.

    Args:
        photographs: geometry, lights and camera; their pixels do not count.
        before: the forecast for them.
        progress: called with a word, the number of candidates tried and their total.
    """
    irradiance = mean_irradiance(photographs.scene)
    directions = hemisphere(camera_direction(photographs.scene.surface), _CANDIDATES, _LARGEST_ANGLE)
    lights = [DirectionalLight(direction, irradiance) for direction in directions]
    lattice, weight = _lattice(photographs)
    ranks = []
    for count, light in enumerate(lights, start=1):
        progress("trying lights", count, len(lights))
        ranks.append(with_light(lattice, before, light, weight).worst)
    finalists = sorted(range(len(lights)), key=ranks.__getitem__)[:_FINALISTS]
    forecasts = [(lights[number], with_light(photographs, before, lights[number])) for number in finalists]
    light, after = min(forecasts, key=lambda pair: pair[1].worst)
    return (light, after) if after.worst < before.worst else None


def with_light(photographs: Photographs, before: Forecast, light: DirectionalLight, weight: float = 1.0) -> Forecast:
    """The forecast for the photographs and one more under a light, each pixel of which counts `weight` times."""
    ambient = torch.zeros(1, photographs.channels, dtype=torch.float64)
    photograph = replace(
        photographs,
        scene=Scene(photographs.scene.surface, ((light,),), ambient).with_shadows(),
        exposures=(float(np.mean(photographs.exposures)),),
        stored=photographs.stored[:1],
    )
    samples = predicted_samples(photograph, before.problem, before.unknowns)
    more = forecast(samples, before.problem, before.unknowns)
    return before + replace(more, information=weight * more.information)


def camera_direction(surface: Surface) -> Tensor:
    """Unit vector to the camera from the middle of the surface, world frame."""
    mean = surface.view.double().mean(0)
    return mean / mean.norm()


def hemisphere(axis: Tensor, count: int, farthest: float) -> list[Tensor]:
    """`count` unit vectors spread evenly over those within `farthest` degrees of the unit vector `axis`."""
    seed = torch.tensor([1.0, 0.0, 0.0] if abs(float(axis[0])) < 0.9 else [0.0, 1.0, 0.0], dtype=torch.float64)
    tangent = torch.nn.functional.normalize(seed - (seed @ axis) * axis, dim=0)
    bitangent = torch.linalg.cross(axis, tangent)
    number = torch.arange(count, dtype=torch.float64)
    # A spiral by the golden angle: equal areas of the sphere, from the axis outward.
    z = 1 - (1 - math.cos(math.radians(farthest))) * number / max(count - 1, 1)
    radius, angle = (1 - z * z).clamp(min=0).sqrt(), number * math.pi * (3 - math.sqrt(5))
    x, y = radius * angle.cos(), radius * angle.sin()
    directions = x[:, None] * tangent + y[:, None] * bitangent + z[:, None] * axis
    return list(torch.nn.functional.normalize(directions, dim=1))


def mean_irradiance(scene: Scene) -> Tensor:
    """Irradiance of a surface facing a light, averaged over all lights and the surface [C]."""
    powers = [light.at(scene.surface.positions)[1].mean(0) for lights in scene.lights for light in lights]
    if not powers:
        return torch.full((scene.channels,), math.pi, dtype=torch.float64)
    return torch.stack(powers).mean(0)


def _lattice(photographs: Photographs) -> tuple[Photographs, float]:
    """The photographs on a lattice of their pixels, whose values do not count, and how many pixels each stands for."""
    lattice = on_lattice(photographs, _RANKING_PIXELS)
    count = len(lattice.scene.surface)
    # Only images of integers are searched for clipped neighbours, and here neighbours are missing: take floats.
    pixels = np.zeros((count, photographs.channels), np.float32)
    encoding = replace(lattice.encoding, black=float(np.mean(photographs.encoding.black)))
    scene = replace(lattice.scene, shadows=(), shadow_edge=(), unoccluded=None)
    blank = replace(lattice, scene=scene, encoding=encoding, stored=(pixels,) * len(photographs))
    return blank, len(photographs.scene.surface) / max(count, 1)
