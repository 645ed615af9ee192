"""The facade: estimate a capture's material, predict a capture from a material."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from matest.brdf import Brdf, Sum
from matest.capture import Capture, Samples
from matest.error_bars import (
    ErrorBars,
    error_bars,
    known_by_ratio,
    parameter_estimate,
    parameter_estimates,
    reported_correlation,
    reported_labels,
    seen_together,
    with_profiles,
)
from matest.errors import InputError
from matest.estimators import AllTiles, Problem, Solution, accumulate, fit
from matest.result import Candidate, Estimate, Fit, ParameterEstimate
from matest.selection import select
from matest.shader import render
from matest.specification import Constraints, Specification, Value, freed, optics, specify
from matest.uncertainty import fisher

# Worth a word of warning: less than this share of the mask is geometry, a fit worse than this (not by noise alone, of
# which there are no so many outliers), or more outliers.
_COVERED, _POOR, _SOME_OUTLIERS, _MANY_OUTLIERS = 0.5, 0.15, 0.001, 0.005
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
    constraints = Constraints(fix or {}, tuple(free), tie or {})
    images = _fitted_images(capture, holdout)
    samples = capture.samples(images, device=device)
    if not len(samples):
        raise InputError(_no_samples(capture, samples))
    candidates: list[Candidate] = []
    if model == "auto":
        model, candidates = select(samples, constraints, seed, progress)
    specification = specify(
        model, constraints, channels=capture.channels, relative=capture.relative, scene=capture.scene
    )
    solution = fit(specification.problem, samples, seed, progress, precision=precision or 0.0)
    bars = error_bars(solution, capture)
    wider = freed(specification, _worth_freeing(specification, solution))
    if wider.problem.free != specification.problem.free:
        problem = replace(wider.problem, gauge_limit=solution.problem.gauge_limit)
        again = fit(problem, samples, seed, progress, _widened(problem, solution), precision or 0.0)
        judged = error_bars(again, capture)
        # What looked determined by its Fisher error may not be by an honest one.
        if all(parameter_estimate(again, judged, name).status != "not determined" for name in problem.free):
            specification, solution, bars = wider, again, judged
    if not solution.statistics.total("values"):
        raise InputError(
            f"{capture.name}: no value lies inside the sensor's range and near the model: the object is saturated or "
            "black in every image. Photograph it with another exposure."
        )
    bars = with_profiles(solution, bars)
    material = solution.problem.material(solution.unknowns)
    statistics = solution.statistics
    parameters = parameter_estimates(solution, bars)
    measured = len(samples) - samples.skipped["saturated"]
    outcome = Fit(
        rmse=math.sqrt(statistics.total("squared_residual") / max(statistics.total("values"), 1)),
        relative_rmse=statistics.relative_rmse,
        reduced_chi2=bars.chi2,
        samples=measured,
        samples_used=min(int(statistics.total("samples")), measured),
        iterations=solution.iterations,
        status="converged" if solution.converged else "not converged",
        message=_message(solution, bars),
        errors=bars.kind,
        outliers=statistics.outliers,
    )
    left_out = None
    if holdout:
        left_out = {"images": sorted(set(holdout)), "relative_rmse": relative_error(capture, material, set(holdout))}
    # Noise belongs to the fit: reading is decoding, geometry is normals, rays and directions.
    fit_s = time.perf_counter() - clock + capture.timing.get("noise", 0.0)
    return Estimate(
        capture=capture.name,
        model=material.expression,
        material=material,
        parameters=parameters,
        labels=reported_labels(solution.problem),
        correlation=reported_correlation(solution, bars),
        fit=outcome,
        relative=capture.relative,
        candidates=candidates,
        skipped=_skipped(samples, solution),
        timing_s={**{stage: capture.timing.get(stage, 0.0) for stage in ("read", "geometry")}, "fit": fit_s},
        holdout=left_out,
        warnings=[
            *_warnings(samples, specification, solution, parameters, bars),
            *_imprecise(parameters, precision),
        ],
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


def _message(solution: Solution, bars: ErrorBars) -> str:
    if not solution.converged:
        return (
            f"Not converged: after {solution.iterations} passes the next step would still move the estimate by "
            f"{solution.last_step:.2g} standard errors."
        )
    if bars.holds:
        return f"Converged; the model describes the images to their noise (χ² per value {bars.chi2:.2f})."
    if bars.kind == "fisher":
        return f"Converged; residuals are {math.sqrt(bars.chi2):.3g} times the noise, error bars scaled by that."
    return f"Converged; the model does not hold to the noise ({bars.reason}), so error bars come from the {bars.kind}."


def _skipped(samples: Samples, solution: Solution) -> dict:
    work, problem = [], solution.problem
    statistics = solution.statistics
    merged = max(int(statistics.total("samples") - statistics.total("evaluated")), 0)
    if merged:
        work.append(
            f"shading of {merged:,} pixels: over smooth squares of 7×7 or 21×21 it is bilinear or biquadratic, four or "
            "nine samples carry what all say"
        )
    unread = len(samples) - int(statistics.total("samples"))
    if unread > 0:
        work.append(f"reading {unread:,} samples: the others give the precision asked for")
    scene = samples.capture.scene
    if scene.surface.mesh is not None and scene.surface.mesh.convex:
        work.append("shadow rays: the mesh is convex and cannot shadow itself")
    elif scene.surface.convex:
        work.append("shadow rays: a sphere cannot shadow itself")
    elif scene.surface.mesh is None:
        work.append("shadow rays: no mesh, cast shadows are unknown")
    if not bool((scene.ambient > 0).any()):
        work.append("ambient light: there is none")
        values = problem.values(solution.unknowns)
        alike = all(values[name].numel() == 1 for name in problem.shaping)
        if alike and all(len(lights) == 1 for lights in scene.lights) and scene.channels > 1:
            work.append("colour: each image has one light, shapes are evaluated once for all channels")
    for name in problem.held:
        if name.endswith("diffuse") and isinstance(problem.brdf, Sum) and float(problem.held[name]) == 0:
            work.append(f"{name}: another component is the diffuse one")
    return {"components": [], "samples": {**samples.skipped, "redundant": merged}, "work": work}


def _imprecise(parameters: Mapping[str, ParameterEstimate], precision: float | None) -> list[str]:
    """What could not be estimated to the precision asked for."""
    errors = {
        name: max(abs(std / value) for value, std in _numbers(parameter) if value and std is not None)
        for name, parameter in parameters.items()
        if parameter.status == "determined" and any(value and std is not None for value, std in _numbers(parameter))
    }
    missed = [f"{name} ({error:.2g})" for name, error in errors.items() if precision is not None and error > precision]
    if not missed:
        return []
    missed += [f"{name} (not at all)" for name, found in parameters.items() if found.status == "not determined"]
    return [f"All pixels together do not give the precision of {precision:g} that was asked for: {', '.join(missed)}."]


def _numbers(parameter: ParameterEstimate) -> list[tuple[float | None, float | None]]:
    """Value and standard error of every channel."""
    value, std = parameter.value, parameter.std
    if isinstance(value, list) and isinstance(std, list):
        return list(zip(value, std, strict=True))
    return [(value, std)] if not isinstance(value, list) and not isinstance(std, list) else []


def _warnings(
    samples: Samples,
    specification: Specification,
    solution: Solution,
    parameters: dict[str, ParameterEstimate],
    bars: ErrorBars,
) -> list[str]:
    out = []
    capture = samples.capture
    relative_rmse = solution.statistics.relative_rmse
    if capture.relative:
        out.append(
            "The common scale of the lights is unknown (relative radiometry): albedo is reported up to that scale."
        )
    for name in specification.default_held:
        beside = " beside the strength of the highlight" if name.endswith("f0") else ""
        out.append(
            f"{name} is held at {float(solution.problem.held[name]):g}: these images do not determine it{beside}; "
            f"--free {name} estimates it all the same, --fix {name}=VALUE sets it."
        )
    for name, parameter in parameters.items():
        f0 = name.removesuffix(name.rpartition(".")[2]) + "f0"
        declared = solution.problem.brdf.declared.get(name)
        if declared is None or f0 not in specification.default_held or parameter.status != "at bound":
            continue
        values = solution.problem.values(solution.unknowns)[name]
        if bool((values >= declared.domain.upper).any()) and name in solution.problem.factors:
            out.append(
                f"{name} is at its upper end: with {f0} held at {float(solution.problem.held[f0]):g} no lobe is bright "
                f"enough; give the surface's own, --fix {f0}=VALUE (a metal's is near 1)."
            )
    for name in specification.assumed:
        value = float(solution.problem.held[name])
        unit = solution.problem.declared(name).unit
        where = "the lights" if name.endswith("solid_angle") else "[camera]"
        out.append(f"{name} is taken as {value:g} {unit}: {where} of the capture should say it.")
    surface = capture.scene.surface
    if surface.coverage < _COVERED:
        out.append(
            f"The geometry covers only {surface.coverage:.0%} of the mask: check the camera and the mesh's units."
        )
    empty = [capture.names[k] for k, count in zip(samples.images, samples.counts, strict=True) if not count]
    if empty:
        out.append(f"{', '.join(empty)} gives no usable pixel: is its light behind the object, or the image clipped?")
    if solution.statistics.outliers > _MANY_OUTLIERS:
        out.append(
            f"{solution.statistics.outliers:.1%} of the values lie too far from the model to be noise and were left "
            "out: dust, highlights or shadows that model and geometry do not have?"
        )
    if relative_rmse > _POOR and (not bars.holds or solution.statistics.outliers > _SOME_OUTLIERS):
        out.append(
            f"The model misses the images by {relative_rmse:.0%}: check encoding.transfer, the directions of the "
            "lights, and that normals have y up and z toward the viewer, or try another model."
        )
    lost = [name for name, parameter in parameters.items() if parameter.status == "not determined"]
    lost = [name for name in lost if not known_by_ratio(solution.problem, name)]
    locked = [name for name in lost if name in seen_together(solution, bars)]
    if len(locked) > 1:
        out.append(f"{' and '.join(locked)} are not determined: these images see only a combination of them; fix one.")
    alone = [name for name in lost if len(locked) < 2 or name not in locked]
    if alone:
        out.append(f"{' and '.join(alone)} {'are' if len(alone) > 1 else 'is'} not determined by these images.")
    if not bars.holds and bars.kind == "fisher":
        out.append("There are too few pixels for error bars that allow for the misfit of the model.")
    if not capture.noise_given:
        noise = capture.noise
        out.append(f"Noise was estimated from the images: read {noise.read:.2g}, gain {noise.gain:.2g} of full scale.")
    return out
