"""The light direction that would help most, one more photograph under a distant light."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from matest.identifiability.forecast import Forecast, forecast, usable
from matest.photographs.photographs import Photographs
from matest.progress import Progress, silent
from matest.scene import DirectionalLight, Scene, Surface

# Directions tried, evenly spaced.
_TRIED = 80
# Degrees from the camera's direction to the farthest of them.
_FARTHEST = 80.0
# The best of them, which are worked out on all pixels.
_WORKED_OUT = 4
# Pixels, evenly over the object, that suffice to rank directions.
_RANKING = 6_000


@dataclass(frozen=True)
class NextLight:
    """One more photograph, and what it brings.

    Attributes:
        direction: unit vector to the light, world frame.
        from_camera: angle between it and the direction to the camera, radians.
        azimuth: angle about the direction to the camera, radians, from the image's right toward its top.
        irradiance: on a surface facing the light: the mean of the lights, [C].
        after: the forecast with this photograph added.
    """

    direction: tuple[float, float, float]
    from_camera: float
    azimuth: float
    irradiance: list[float]
    after: Forecast


def next_light(photographs: Photographs, before: Forecast, progress: Progress = silent) -> NextLight | None:
    """The distant light that lowers the largest relative error bar most; None if no light lowers any.

    Noise is that of the photographs, exposure and irradiance are their means. Shadows are traced. Two
    directions compare first by the number of parameters left undetermined.

    Args:
        photographs: geometry, lights and camera; their pixels do not count.
        before: the forecast for them.
        progress: called with a word, the number of directions tried and their total.
    """
    axis = photographs.scene.surface.view.mean(0)
    axis = axis / axis.norm()
    power = mean_irradiance(photographs.scene)
    thinned, share = _thinned(photographs)
    directions = hemisphere(axis, _TRIED, _FARTHEST)
    scored = []
    for count, direction in enumerate(directions, start=1):
        progress("trying lights", count, len(directions))
        more = _one_more(thinned, DirectionalLight(direction, power), before)
        together = before + replace(more, information=share * more.information)
        scored.append((together.worst, direction))
    scored.sort(key=lambda pair: pair[0])
    best: NextLight | None = None
    for _, direction in scored[:_WORKED_OUT]:
        after = before + _one_more(photographs, DirectionalLight(direction, power), before)
        if after.worst < (before.worst if best is None else best.after.worst):
            angle = math.acos(float((direction @ axis).clamp(-1, 1)))
            x, y, z = direction.tolist()
            azimuth = _azimuth(photographs.scene.surface, direction, axis)
            best = NextLight((x, y, z), angle, azimuth, power.tolist(), after)
    return best


def with_light(photographs: Photographs, before: Forecast, light: NextLight) -> Forecast:
    """A forecast for the photographs and that under one more light."""
    direction, power = (torch.tensor(x, dtype=torch.float64) for x in (light.direction, light.irradiance))
    return before + _one_more(photographs, DirectionalLight(direction, power), before)


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
    found = x[:, None] * tangent + y[:, None] * bitangent + z[:, None] * axis
    return list(torch.nn.functional.normalize(found, dim=1))


def mean_irradiance(scene: Scene) -> Tensor:
    """Irradiance of a surface facing a light, averaged over all lights and the surface [C]."""
    powers = [light.at(scene.surface.positions)[1].mean(0) for lights in scene.lights for light in lights]
    if not powers:
        return torch.full((scene.channels,), math.pi, dtype=torch.float64)
    return torch.stack(powers).mean(0)


def _azimuth(surface: Surface, direction: Tensor, axis: Tensor) -> float:
    """Angle of `direction` about `axis`, from the image's right toward its top."""
    right = torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64)
    if surface.positions is not None:
        # Where the positions go as the columns grow.
        rows, columns = np.divmod(surface.pixels, surface.shape[1])
        design = np.stack([columns, rows, np.ones_like(rows)], axis=1).astype(np.float64)
        right = torch.from_numpy(np.linalg.lstsq(design, surface.positions.numpy())[0][0])
    right = torch.nn.functional.normalize(right - (right @ axis) * axis, dim=0)
    top = torch.linalg.cross(axis, right)
    return math.atan2(float(direction @ top), float(direction @ right))


def _one_more(photographs: Photographs, light: DirectionalLight, before: Forecast) -> Forecast:
    """What a photograph under one light tells."""
    ambient = torch.zeros(1, photographs.channels, dtype=torch.float64)
    lit = replace(
        photographs,
        scene=Scene(photographs.scene.surface, ((light,),), ambient).with_shadows(),
        exposures=(float(np.mean(photographs.exposures)),),
        stored=photographs.stored[:1],
    )
    return forecast(usable(lit, before.problem, before.unknowns), before.problem, before.unknowns)


def _thinned(photographs: Photographs) -> tuple[Photographs, float]:
    """The photographs on a lattice of their pixels, and how many pixels each of them stands for."""
    scene, encoding = photographs.scene, photographs.encoding
    surface = scene.surface
    step = max(math.ceil(math.sqrt(len(surface) / _RANKING)), 1)
    rows, columns = np.divmod(surface.pixels, surface.shape[1])
    kept = (rows % step == 0) & (columns % step == 0)
    # Floats: the tests for clipping that look at neighbouring pixels belong to whole images of integers.
    pixels = np.zeros((int(kept.sum()), photographs.channels), np.float32)
    black, flat = float(np.mean(encoding.black)), encoding.flat
    thinned = replace(
        photographs,
        scene=replace(scene, surface=surface.take(kept), shadows=(), shadow_edge=(), unoccluded=None),
        encoding=replace(encoding, black=black, flat=None if flat is None else flat[kept]),
        stored=(pixels,) * len(photographs),
    )
    return thinned, len(surface) / max(int(kept.sum()), 1)
