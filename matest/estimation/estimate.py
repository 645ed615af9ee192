"""The facade: estimate a capture's material, predict a capture from a material."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from matest.brdf import Brdf
from matest.capture import Capture
from matest.errors import InputError
from matest.estimation.remarks import message, skipped, unread_samples
from matest.estimation.result import Candidate, Estimate, Fit
from matest.estimation.selection import select
from matest.estimation.specification import Constraints, Specification, Value, freed, optics, specify
from matest.estimation.warnings import Context, warnings
from matest.estimators import AllTiles, Problem, Solution, accumulate, fit
from matest.estimators.covariance import fisher
from matest.inference.posterior import judge, judge_to_first_order
from matest.photographs.redundant import idle, without_copies
from matest.photographs.samples import Samples
from matest.shading import render

# A parameter held by default is freed when its predicted relative error is below this.
_WORTH_FREEING = 0.25
Progress = Callable[[str], None]


def estimate(
    capture: Capture,
    model: str = "auto",
    *,
    fix: Mapping[str, Value] | None = None,
    free: Sequence[str] = (),
    tie: Mapping[str, str] | None = None,
    holdout: Sequence[int] = (),
    precision: float | None = None,
    seed: int = 0,
    device: str = "cpu",
    progress: Progress = lambda _: None,
) -> Estimate:
    """The material of a capture with its error bars.

    Args:
        capture: from `load_capture`.
        model: an expression such as "oren-nayar+torrance-sparrow", or "auto".
        fix: values of parameters that are not estimated, by name or path.
        free: parameters to estimate although they are held by default (`f0`).
        tie: dependent parameter -> the one whose value it takes.
        holdout: images to leave out of the fit; the error there is reported.
        precision: stop reading pixels once every parameter's relative standard error is below this, 0 to 1, where the
            model describes the images; None: read all.
        seed: of the subsample that the search starts from.
        device: where tiles are evaluated ("cpu", "cuda").
        progress: called with a word on what is being done.

    Raises:
        InputError: unknown names, impossible constraints, no usable pixel.
    """
    clock = time.perf_counter()
    if precision is not None and not 0 < precision < 1:
        raise InputError(f"precision is a relative standard error, such as 0.001, between 0 and 1; got {precision}.")
    given, told = capture, fix or {}
    capture, told = _one_channel(capture, told)
    images = _fitted_images(capture, holdout)
    passed = idle(capture, images)
    if len(passed) == len(images):
        raise InputError(f"{capture.name}: the lights of every image are stated to give no light; correct irradiance.")
    constraints = Constraints(told, tuple(free), tie or {})
    samples = capture.samples([image for image in images if image not in passed], device=device)
    if not len(samples):
        raise InputError(_no_samples(capture, samples))
    candidates: list[Candidate] = []
    if model == "auto":
        model, candidates = select(samples, constraints, seed, progress)
    specification = specify(
        model, constraints, channels=capture.channels, relative=capture.relative, scene=capture.scene
    )
    solution = fit(specification.problem, samples, seed, progress, precision=precision or 0.0)
    wider = freed(specification, _worth_freeing(specification, solution))
    if wider.problem.free != specification.problem.free:
        problem = replace(wider.problem, gauge_limit=solution.problem.gauge_limit)
        again = fit(problem, samples, seed, progress, _widened(problem, solution), precision or 0.0)
        # What looked determined by its Fisher error may not be by an honest one.
        if not judge_to_first_order(again, samples).not_determined:
            specification, solution = wider, again
    if not solution.statistics.total("values"):
        raise InputError(
            f"{capture.name}: no value lies inside the sensor's range and near the model: the object is saturated or "
            "black in every image. Photograph it with another exposure."
        )
    posterior = judge(solution, samples)
    material = solution.problem.material(solution.unknowns)
    statistics = solution.statistics
    measured = len(samples) - samples.skipped["saturated"]
    outcome = Fit(
        rmse=math.sqrt(statistics.total("squared_residual") / max(statistics.total("values"), 1)),
        relative_rmse=statistics.relative_rmse,
        reduced_chi2=posterior.bars.chi2,
        samples=measured,
        samples_used=min(int(statistics.total("samples")), measured),
        iterations=solution.iterations,
        status="converged" if solution.converged else "not converged",
        message=message(solution, posterior.bars, unread_samples(samples, solution)),
        errors=posterior.bars.kind,
        outliers=statistics.outliers,
    )
    left_out = None
    if holdout:
        left_out = {"images": sorted(set(holdout)), "relative_rmse": relative_error(given, material, set(holdout))}
    # Noise belongs to the fit: reading is decoding, geometry is normals, rays and directions.
    fit_s = time.perf_counter() - clock + capture.timing.get("noise", 0.0)
    return Estimate(
        capture=capture.name,
        model=material.expression,
        material=material,
        parameters=dict(posterior.estimates),
        labels=list(posterior.labels),
        correlation=[list(row) for row in posterior.correlation],
        fit=outcome,
        relative=capture.relative,
        candidates=candidates,
        skipped=skipped(samples, solution, passed, len(set(holdout)), candidates),
        timing_s={**{stage: capture.timing.get(stage, 0.0) for stage in ("read", "geometry")}, "fit": fit_s},
        holdout=left_out,
        warnings=warnings(Context(samples, specification, solution, posterior, passed, precision)),
    )


def predict(material: Brdf, capture: Capture) -> tuple[np.ndarray, list[float | None]]:
    """Radiance images [K, H, W, C] of a material under a capture's lights, and the relative error of each image.

    The error is the rms difference over the rms signal on the usable pixels of the photograph; None if it has none.

    Raises:
        InputError: the material has a value per channel for another number of channels.
    """
    material = material.replace(optics(material, capture.scene))
    errors = image_errors(capture, material)
    return render(capture.scene, material).detach().numpy(), errors


def image_errors(capture: Capture, material: Brdf) -> list[float | None]:
    """Relative rms error of the shaded material against each photograph; None where it has no usable pixel."""
    return [relative_error(capture, material, [image]) for image in range(len(capture))]


def relative_error(capture: Capture, material: Brdf, images: Iterable[int]) -> float | None:
    """Rms difference between photographs and the shaded material, over the rms signal of their usable pixels.

    Raises:
        InputError: see `predict`.
    """
    lengths = {len(value) for value in material.parameters.values() if value.ndim == 1} - {1, capture.channels}
    if lengths:
        raise InputError(
            f"{capture.name}: the images have {capture.channels} channel(s), but the material was estimated for "
            f"{max(lengths)}; estimate it from images with the same channels."
        )
    problem = Problem(material, capture.channels, (), material.parameters, {})
    nothing = torch.zeros(0, dtype=torch.float64)
    statistics = accumulate(problem, nothing, AllTiles(capture.samples(images)), None)
    return statistics.relative_rmse if statistics.total("samples") else None


def _worth_freeing(specification: Specification, solution: Solution) -> list[str]:
    """Parameters held by default that the images determine."""
    names = specification.default_held
    if not names:
        return []
    wider = freed(specification, names).problem
    unknowns = _widened(wider, solution)
    statistics = accumulate(wider, unknowns, solution.tiles, unknowns, solution.misfit)
    return worth_freeing(wider, names, unknowns, statistics.information / statistics.misfit)


def worth_freeing(wider: Problem, names: Sequence[str], unknowns: Tensor, information: Tensor) -> list[str]:
    """Those of `names` that get a small error bar when all of them are estimated.

    Args:
        wider: the problem in which all of them are free.
        names: parameters held by default.
        unknowns: of `wider` [P].
        information: JᵀWJ there [P, P].
    """
    covariance = fisher(information, torch.ones(wider.size, dtype=torch.bool))
    chosen = []
    for name in names:
        place = wider.where[name]
        std = covariance.std[place] / unknowns[place]
        if bool((std < _WORTH_FREEING).all()) and not bool(covariance.undetermined[place].any()):
            chosen.append(name)
    return chosen


def _widened(wider: Problem, solution: Solution) -> Tensor:
    """The unknowns of a problem with more free parameters at the values of a solution."""
    values = solution.problem.values(solution.unknowns)
    return torch.cat([torch.atleast_1d(values[name]).expand(wider.count(name)) for name in wider.free])


def _one_channel(capture: Capture, fix: Mapping[str, Value]) -> tuple[Capture, Mapping[str, Value]]:
    """The capture without channels that are copies of each other, and the values that are fixed for it.

    Values that differ between channels belong to channels that do.
    """
    if any(len({*value}) > 1 for value in fix.values() if not isinstance(value, int | float)):
        return capture, fix
    reduced = without_copies(capture)
    if reduced is capture:
        return capture, fix
    several = {name: value for name, value in fix.items() if not isinstance(value, int | float)}
    return reduced, {**fix, **{name: value[0] for name, value in several.items() if len(value) == capture.channels}}


def _fitted_images(capture: Capture, holdout: Sequence[int]) -> tuple[int, ...]:
    for image in holdout:
        if not 0 <= image < len(capture):
            raise InputError(
                f"holdout image {image}: the capture has images 0 to {len(capture) - 1}; correct --holdout."
            )
    images = tuple(image for image in range(len(capture)) if image not in holdout)
    if not images:
        raise InputError("every image is held out: leave at least one for the fit.")
    return images


def _no_samples(capture: Capture, samples: Samples) -> str:
    counts = ", ".join(f"{count} {reason}" for reason, count in samples.skipped.items() if count)
    return (
        f"{capture.name}: no lit pixel is left to fit: of all pixels, {counts}. Check that the lights face the object "
        "(directions point from the surface to the light), the mask and encoding.saturation."
    )
