"""The facade: estimate a capture's material, predict a capture from a material."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from matest.brdf import Brdf
from matest.errors import InputError
from matest.estimation.options import AUTO, Options, Value
from matest.estimation.remarks import message, skipped, unread_samples
from matest.estimation.result import Candidate, Estimate, Fit
from matest.estimation.selection import select
from matest.estimation.specification import Specification, freed, optics, specify
from matest.estimation.warnings import Context, warnings
from matest.estimators import Problem, Solution, Statistics, accumulate, fit
from matest.estimators.covariance import fisher
from matest.inference.posterior import judge, judge_to_first_order
from matest.progress import Progress, silent
from matest.samples.account import Account
from matest.shading import render

if TYPE_CHECKING:
    from matest.capture import Capture

# A parameter held by default is freed when its predicted relative error is below this.
_WORTH_FREEING = 0.25


def estimate(
    capture: Capture,
    model: str = AUTO,
    *,
    fix: Mapping[str, Value] | None = None,
    free: Sequence[str] = (),
    tie: Mapping[str, str] | None = None,
    holdout: Sequence[int] = (),
    precision: float | None = None,
    seed: int = 0,
    device: str = "cpu",
    progress: Progress = silent,
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
    options = Options(
        model=model, fix=fix or {}, free=free, tie=tie or {}, holdout=holdout, precision=precision, seed=seed,
        device=device,
    )  # fmt: skip
    return estimate_with(capture, options, progress)


def estimate_with(capture: Capture, options: Options, progress: Progress = silent) -> Estimate:
    """The material of a capture with its error bars, as options ask for it.

    Raises:
        InputError: see `estimate`.
    """
    clock = time.perf_counter()
    images = options.fitted_images(len(capture))
    # Values that differ between channels belong to channels that do.
    differ = any(len({*value}) > 1 for value in options.fix.values() if not isinstance(value, int | float))
    samples = capture.photographs.samples(images, distinct=True, every_channel=differ, device=options.device)
    if not samples.account.images:
        raise InputError(f"{capture.name}: the lights of every image are stated to give no light; correct irradiance.")
    if samples.account.redundancy.channels:
        fix = {name: _of_one_channel(value, capture.channels) for name, value in options.fix.items()}
        options = replace(options, fix=fix)
    if not len(samples):
        raise InputError(_no_samples(capture.name, samples.account))
    expression, candidates = options.model, list[Candidate]()
    if expression is None or options.automatic:
        expression, candidates = select(samples, options, progress)
    specification = specify(expression, options, channels=samples.channels, relative=samples.relative, scene=samples)
    precision = options.precision or 0.0
    solution = fit(specification.problem, samples, options.seed, progress, precision=precision)
    wider = freed(specification, _worth_freeing(specification, solution))
    if wider.problem.free != specification.problem.free:
        problem = wider.problem.limited(solution.problem.light_scale_limit)
        again = fit(problem, samples, options.seed, progress, _widened(problem, solution), precision)
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
    measured = len(samples) - samples.account.skipped["saturated"]
    outcome = Fit(
        rmse=math.sqrt(statistics.total("squared_residual") / max(statistics.total("usable"), 1)),
        relative_rmse=statistics.relative_rmse,
        relative_rmse_trimmed=statistics.relative_rmse_trimmed,
        reduced_chi2=posterior.bars.chi2,
        samples=measured,
        samples_used=min(int(statistics.total("samples")), measured),
        iterations=solution.iterations,
        status="converged" if solution.converged else "not converged",
        message=message(solution, posterior.bars, unread_samples(samples, solution)),
        errors=posterior.bars.kind,
        outliers=statistics.outliers,
        values_left_out=int(statistics.total("outliers")),
    )
    left_out, holdout = None, sorted({*options.holdout})
    if holdout:
        left_out = {"images": holdout, "relative_rmse": relative_error(capture, material, holdout)}
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
        skipped=skipped(samples, solution, len(holdout), candidates),
        timing_s={**{stage: capture.timing.get(stage, 0.0) for stage in ("read", "geometry")}, "fit": fit_s},
        holdout=left_out,
        warnings=warnings(Context(samples, specification, solution, posterior, options.precision)),
    )


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


def relative_error(capture: Capture, material: Brdf, images: Iterable[int]) -> float | None:
    """Rms difference between photographs and the shaded material over the rms signal, of all their usable values.

    Saturated values count where the material is shaded darker than the clip. None where there is no usable pixel.

    Raises:
        InputError: see `predict`.
    """
    statistics = _statistics(capture, material, images)
    return statistics.relative_rmse if statistics.total("samples") else None


def _statistics(capture: Capture, material: Brdf, images: Iterable[int]) -> Statistics:
    """Of some photographs about the shaded material."""
    lengths = {len(value) for value in material.parameters.values() if value.ndim == 1} - {1, capture.channels}
    if lengths:
        raise InputError(
            f"{capture.name}: the images have {capture.channels} channel(s), but the material was estimated for "
            f"{max(lengths)}; estimate it from images with the same channels."
        )
    problem = Problem.of(material, capture.channels, (), material.parameters, {})
    nothing = torch.zeros(0, dtype=torch.float64)
    return accumulate(problem, nothing, capture.samples(images).tiles(merge=False), nothing)


def _worth_freeing(specification: Specification, solution: Solution) -> list[str]:
    """Parameters held by default that the images determine."""
    names = specification.default_held
    if not names:
        return []
    wider = freed(specification, names).problem
    unknowns = _widened(wider, solution)
    statistics = accumulate(wider, unknowns, solution.tiles, unknowns, solution.residual_scale)
    return worth_freeing(wider, names, unknowns, statistics.information / statistics.inflation)


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


def _of_one_channel(value: Value, channels: int) -> Value:
    """A fixed value for the one channel that stands for so many copies."""
    return value if isinstance(value, int | float) or len(value) != channels else value[0]


def _no_samples(name: str, account: Account) -> str:
    counts = ", ".join(f"{count} {reason}" for reason, count in account.skipped.items() if count)
    return (
        f"{name}: no lit pixel is left to fit: of all pixels, {counts}. Check that the lights face the object "
        "(directions point from the surface to the light), the mask and encoding.saturation."
    )
