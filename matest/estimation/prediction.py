"""Predict a capture from a material, and how far the prediction is from the photographs."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from matest.brdf import Brdf
from matest.errors import InputError
from matest.estimation.specification import optics
from matest.estimators import Problem, Solution, Statistics, accumulate
from matest.shading import render

if TYPE_CHECKING:
    from matest.capture import Capture


def predict(material: Brdf, capture: Capture) -> tuple[np.ndarray, list[float | None]]:
    """Radiance images [K, H, W, C] of a material under a capture's lights, and the relative error of each image.

    The error is that of `relative_error`; None where a photograph has no usable pixel.

    Raises:
        InputError: the material has a value per channel for another number of channels.
    """
    material = material.replace(optics(material, capture.scene))
    errors = prediction_errors(capture, material).images
    return render(capture.scene, material).detach().numpy(), errors


@dataclass(frozen=True)
class PredictionErrors:
    """How far a shaded material is from photographs, by the definition of `relative_error`.

    Attributes:
        images: of each; None where a photograph has no usable pixel.
        pooled: of all together.
    """

    images: list[float | None]
    pooled: float | None


def prediction_errors(capture: Capture, material: Brdf) -> PredictionErrors:
    """The error of a shaded material against each photograph and all of them.

    Raises:
        InputError: see `predict`.
    """
    every = [_statistics(capture, material, [image]) for image in range(len(capture))]
    residual, signal = (sum(one.total(f"squared_{kind}") for one in every) for kind in ("residual", "signal"))
    return PredictionErrors(
        images=[one.relative_rmse if one.total("samples") else None for one in every],
        pooled=math.sqrt(residual / signal) if signal > 0 else None,
    )


def relative_error(
    capture: Capture, material: Brdf, images: Iterable[int], refined: Solution | None = None
) -> float | None:
    """Rms difference between photographs and the shaded material over the rms signal, of all their usable values.

    Saturated values count where the material is shaded darker than the clip. None where there is no usable pixel.

    Args:
        capture: with the photographs.
        material: that is shaded.
        images: numbers of the photographs.
        refined: of a fit to others, with errors of the calibration: those that all photographs have in common hold
            here too.

    Raises:
        InputError: see `predict`.
    """
    statistics = _statistics(capture, material, images, refined)
    return statistics.relative_rmse if statistics.total("samples") else None


def _statistics(capture: Capture, material: Brdf, images: Iterable[int], refined: Solution | None = None) -> Statistics:
    """Statistics of some photographs about the shaded material."""
    lengths = {len(value) for value in material.parameters.values() if value.ndim == 1} - {1, capture.channels}
    if lengths:
        raise InputError(
            f"{capture.name}: the images have {capture.channels} channel(s), but the material was estimated for "
            f"{max(lengths)}; estimate it from images with the same channels."
        )
    problem = Problem.of(material, capture.channels, (), material.parameters, {})
    samples, unknowns = capture.photographs.samples(images), torch.zeros(0, dtype=torch.float64)
    if refined is not None and (shared := _shared_errors(refined)):
        calibration = samples.calibration([*shared])
        problem = problem.calibrated(calibration, dict.fromkeys(shared, 1.0), samples.groups)
        unknowns = torch.cat([*shared.values()])
    return accumulate(problem, unknowns, samples.tiles(merge=False), unknowns)


def _shared_errors(refined: Solution) -> dict[str, Tensor]:
    """Errors of the calibration that all samples of a fit have in common, by family."""
    problem, shared = refined.problem, {}
    for block in problem.nuisances:
        places = problem.family(block.name).places
        if bool((places == places[:1]).all()):
            shared[block.name] = refined.unknowns[problem.where[block.name]]
    return shared
