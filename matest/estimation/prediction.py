"""Predict a capture from a material, and how far the prediction is from the photographs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from matest.brdf import Brdf
from matest.errors import InputError
from matest.estimation.specification import optics
from matest.estimators import Problem, Solution
from matest.estimators.misfit import Misfit, misfit
from matest.estimators.passes import radiance_model
from matest.samples import Tile
from matest.samples.account import CalibratedSamples
from matest.shading import at_pixels, render, shade

if TYPE_CHECKING:
    from matest.capture import Capture


def predict(material: Brdf, capture: Capture) -> tuple[np.ndarray, list[float | None]]:
    """Radiance images [K, H, W, C] of a material under a capture's lights, and the relative error of each image.

    The error is that of `PredictionErrors`; None where a photograph has no usable pixel.

    Args:
        material: with values for the whole object, or at every pixel of it (`with_maps`).
        capture: that gives geometry and lights, and photographs.

    Raises:
        InputError: the material has a value per channel for another number of channels, or per pixel for another
            number of pixels.
        TypeError: something else than a material.
    """
    if not isinstance(material, Brdf):
        raise TypeError(f"predict takes a material, then a capture; got {type(material).__name__} as the material.")
    material = material.replace(optics(material, capture.scene))
    errors = prediction_errors(capture, material).images
    return render(capture.scene, material).detach().numpy(), errors


@dataclass(frozen=True)
class PredictionErrors:
    """How far a shaded material is from photographs.

    The error is the rms difference over the rms signal, of all usable values: saturated ones count where the material
    is shaded darker than the clip. That of a pixel is the length of the difference over that of the photograph, over
    the channels.

    Attributes:
        images: error of each; None where a photograph has no usable pixel.
        pooled: of all together; None likewise.
        medians: of each, the median error of a pixel; None likewise.
        pooled_median: over the pixels of all together; None likewise.
    """

    images: list[float | None]
    pooled: float | None
    medians: list[float | None]
    pooled_median: float | None


def prediction_errors(
    capture: Capture, material: Brdf, images: Iterable[int] | None = None, refined: Solution | None = None
) -> PredictionErrors:
    """The error of a shaded material against photographs, each and together.

    Args:
        capture: with the photographs.
        material: that is shaded.
        images: numbers of the photographs; None: all.
        refined: of a fit to others, with errors of the calibration: those that all photographs have in common hold
            here too.

    Raises:
        InputError: see `predict`.
    """
    numbers = range(len(capture)) if images is None else images
    every = [_misfit(capture, material, image, refined) for image in numbers]
    residual, signal = (
        sum(one.statistics.total(f"squared_{kind}") for one in every) for kind in ("residual", "signal")
    )
    return PredictionErrors(
        images=[one.statistics.relative_rmse if one.statistics.total("samples") else None for one in every],
        pooled=math.sqrt(residual / signal) if signal > 0 else None,
        medians=[_median([one]) for one in every],
        pooled_median=_median(every),
    )


def _median(parts: Sequence[Misfit]) -> float | None:
    """The median error of a pixel; None where there is none."""
    errors = np.concatenate([part.errors.numpy() for part in parts])
    return float(np.median(errors)) if len(errors) else None


def _misfit(capture: Capture, material: Brdf, image: int, refined: Solution | None) -> Misfit:
    """How far a photograph is from the shaded material.

    Raises:
        InputError: see `predict`.
    """
    _check_sizes(capture, material)
    samples = capture.photographs.samples([image])
    radiance = _radiance(capture, material, samples, refined)
    return misfit(radiance, samples.tiles(merge=False))


def _check_sizes(capture: Capture, material: Brdf) -> None:
    """Refuse values of other channels, or of the pixels of another object.

    Raises:
        InputError: see `predict`.
    """
    pixels = len(capture.scene.surface)
    for name, value in material.parameters.items():
        if value.ndim and value.shape[-1] not in (1, capture.channels):
            raise InputError(
                f"{capture.name}: the images have {capture.channels} channel(s), but the material was estimated for "
                f"{value.shape[-1]}; estimate it from images with the same channels."
            )
        if value.ndim > 1 and len(value) not in (1, pixels):
            raise InputError(
                f"{capture.name}: shows {pixels:,} pixels of the object, but {name} has values of {len(value):,}: a "
                "map belongs to the view it was estimated in; predict with its mean."
            )


def _radiance(
    capture: Capture, material: Brdf, samples: CalibratedSamples, refined: Solution | None
) -> Callable[[Tile], Tensor]:
    """The function that gives the radiance [n, C] of the material at the samples of a tile."""
    if any(value.ndim > 1 for value in material.parameters.values()):
        return mapped_radiance(material, samples.texels)
    problem = Problem.of(material, capture.channels, (), material.parameters, {})
    unknowns = torch.zeros(0, dtype=torch.float64)
    if refined is not None and (shared := _shared_errors(refined)):
        calibration = samples.calibration([*shared])
        problem = problem.calibrated(calibration, dict.fromkeys(shared, 1.0), samples.groups)
        unknowns = torch.cat([*shared.values()])
    return radiance_model(problem, unknowns)


def mapped_radiance(material: Brdf, texels: int) -> Callable[[Tile], Tensor]:
    """The function that gives the radiance [n, C] at the samples of a tile of a material with a value at every pixel.

    Args:
        material: with values [N, 1 or C].
        texels: N.
    """

    def radiance(tile: Tile) -> Tensor:
        batch = tile.batch
        assert batch.pixels is not None
        return shade(at_pixels(material, batch.pixels, texels), batch.points).expand_as(batch.radiance)

    return radiance


def _shared_errors(refined: Solution) -> dict[str, Tensor]:
    """Errors of the calibration that all samples of a fit have in common, by family."""
    problem, shared = refined.problem, {}
    for block in problem.nuisances:
        places = problem.family(block.name).places
        if bool((places == places[:1]).all()):
            shared[block.name] = refined.unknowns[problem.where[block.name]]
    return shared
