"""Advice for one more photograph: where its light should stand, and what it brings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from torch import Tensor

from matest.identifiability.forecast import Forecast, as_estimated
from matest.identifiability.next_light import camera_direction, next_light, with_light
from matest.identifiability.nominal import Nominal
from matest.inference.derived import reported_name
from matest.inference.quantities import Number
from matest.photographs.samples import PhotographSamples
from matest.progress import Progress, silent
from matest.scene import Surface


@dataclass(frozen=True)
class LightAdvice:
    """One more photograph that would lower the largest relative error bar most.

    Attributes:
        direction: unit vector to the light, world frame.
        from_camera: angle between it and the direction to the camera, radians.
        azimuth: angle about the direction to the camera, radians, from the image's right toward its top.
        irradiance: on a surface facing the light, [C].
        std: standard errors with it that are predicted of the noise, by parameter; None where still not determined.
        worst: largest relative standard error of a determined parameter before and after.
        gain: by how much the standard error of each parameter shrinks (2: half as large); None where it was or stays
            undetermined.
        resolves: parameters that become determined.
        frees: parameters that are held by default now, and that `estimate` frees with the light.
        freed: standard errors of all parameters then; empty where there are none such.
    """

    direction: tuple[float, float, float]
    from_camera: float
    azimuth: float
    irradiance: list[float]
    std: dict[str, Number]
    worst: tuple[float, float]
    gain: dict[str, float | None]
    resolves: list[str]
    frees: list[str]
    freed: dict[str, Number]


def advise(
    samples: PhotographSamples, nominal: Nominal, before: Forecast, progress: Progress = silent
) -> LightAdvice | None:
    """The light that would help most; None if no further light lowers any error bar.

    Args:
        samples: predicted for the photographs.
        nominal: the model and its values.
        before: the forecast for the samples, with those parameters free that `estimate` frees.
        progress: called with a word, the number of lights tried and their total.
    """
    photographs = samples.photographs
    best = next_light(photographs, before, progress)
    if best is None:
        return None
    light, after = best
    open_before, open_after = before.posterior.not_determined, after.posterior.not_determined
    resolves = [name for name in open_before if name not in open_after]
    worst = before.worst[1], after.worst[1]
    if not resolves and worst[1] >= worst[0]:
        return None
    estimated = after
    if {*nominal.specification.default_held} - {*before.problem.free}:
        estimated, _ = as_estimated(samples, nominal, partial(with_light, photographs, light=light))
    frees = [name for name in estimated.problem.free if name not in before.problem.free]
    surface, (x, y, z) = photographs.scene.surface, light.direction.tolist()
    axis = camera_direction(surface)
    return LightAdvice(
        direction=(x, y, z),
        from_camera=math.acos(float((light.direction @ axis).clamp(-1, 1))),
        azimuth=_azimuth(surface, light.direction, axis),
        irradiance=light.irradiance.tolist(),
        std=_errors(after),
        worst=worst,
        gain=_gain(before, after),
        resolves=resolves,
        frees=frees,
        freed=_errors(estimated) if frees else {},
    )


def _gain(before: Forecast, after: Forecast) -> dict[str, float | None]:
    """How many times smaller errors become, by reported name; None where not determined before or after."""
    problem, gain = before.problem, {}
    not_determined = {*before.posterior.not_determined, *after.posterior.not_determined}
    for name, place in problem.where.items():
        label, ratio = reported_name(problem, name), float((before.std[place] / after.std[place]).max())
        gain[label] = ratio if math.isfinite(ratio) and label not in not_determined else None
    return gain


def _errors(forecast: Forecast) -> dict[str, Number]:
    """Standard errors of the free parameters, by reported name."""
    names = (reported_name(forecast.problem, name) for name in forecast.problem.free)
    return {name: forecast.posterior.estimates[name].std for name in names}


def _azimuth(surface: Surface, direction: Tensor, axis: Tensor) -> float:
    """Angle of a direction about an axis, radians, from the image's right toward its top."""
    right = torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64)
    if surface.positions is not None:
        # The gradient of the positions along the columns.
        rows, columns = np.divmod(surface.pixels, surface.shape[1])
        design = np.stack([columns, rows, np.ones_like(rows)], axis=1).astype(np.float64)
        right = torch.from_numpy(np.linalg.lstsq(design, surface.positions.numpy())[0][0])
    right = torch.nn.functional.normalize(right - (right @ axis) * axis, dim=0)
    top = torch.linalg.cross(axis, right)
    return math.atan2(float(direction @ top), float(direction @ right))
