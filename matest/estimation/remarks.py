"""What is said of an estimate: how the fit went, what was not computed, and what deserves a word of warning."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import torch

from matest.brdf import MODELS
from matest.estimation.result import Candidate
from matest.estimation.specification import Specification, beside_body
from matest.estimators import Solution
from matest.estimators.covariance import fisher
from matest.inference.derived import known_by_derived
from matest.inference.error_bars import ErrorBars
from matest.inference.posterior import Posterior
from matest.inference.quantities import ParameterEstimate
from matest.parameters import OPTICS, Role
from matest.photographs.samples import PhotographSamples

# Worth a word of warning: less than this share of the mask is geometry, a fit worse than this (not by noise alone, of
# which there are no so many outliers), or more outliers.
_COVERED, _POOR, _SOME_OUTLIERS, _MANY_OUTLIERS = 0.5, 0.15, 0.001, 0.005
# An image is odd where χ² per value, above the first, falls without it below the second, or to less than this share: a
# model that fits none of them does not fit the others. Of fewer images none is odd.
_MISFIT, _MET, _SHARE, _FEW = 1.5, 1.1, 0.1, 3


def message(solution: Solution, bars: ErrorBars, unread: int) -> str:
    """How the fit went, as a sentence; `unread` samples were not needed for the precision asked for."""
    if not solution.converged:
        return (
            f"Not converged: after {solution.iterations} passes the next step would still move the estimate by "
            f"{solution.last_step:.2g} standard errors"
            + ("." if bars.holds else f", and the model does not hold to the noise ({bars.reason}).")
        )
    told = "Converged to the precision asked for on a subsample" if unread else "Converged"
    if bars.holds:
        return f"{told}; the model describes the images to their noise (reduced χ² {bars.chi2:.2f})."
    if bars.kind == "fisher":
        return f"{told}; residuals are {math.sqrt(bars.chi2):.3g} times the noise, error bars scaled by that."
    return f"{told}; the model does not hold to the noise ({bars.reason}), so error bars come from the {bars.kind}."


def unread_samples(samples: PhotographSamples, solution: Solution) -> int:
    """How many samples were not needed for the precision asked for."""
    return max(len(samples) - int(solution.statistics.total("samples")), 0)


def skipped(samples: PhotographSamples, solution: Solution, held_out: int, candidates: Sequence[Candidate]) -> dict:
    """What was not computed, and why; counts of pixels are over all images.

    Args:
        samples: those of the images that were worked on.
        solution: what they gave.
        held_out: number of images left out of the fit.
        candidates: models that were tried before one was chosen; their lobes that it lacks are not supported.
    """
    work, problem, redundancy = [], solution.problem, samples.redundancy
    names = samples.photographs.names
    work += [f"image {image} ({names[image]}): {reason}" for image, reason in redundancy.images.items()]
    if redundancy.channels:
        work.append(f"{redundancy.channels} channels: they are copies of the first in every image")
    statistics = solution.statistics
    unread = unread_samples(samples, solution)
    merged = max(int(statistics.total("samples") - statistics.total("evaluated")), 0)
    if merged:
        work.append(
            f"shading of {merged:,} pixels: over smooth squares of 7×7 or 21×21 it is bilinear or biquadratic, four or "
            "nine samples carry what all say"
        )
    if unread:
        work.append(f"reading {unread:,} samples: the others give the precision asked for")
    scene = samples.photographs.scene
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
        if beside_body(problem.brdf, name) and float(problem.held[name]) == 0:
            work.append(f"{name}: another component is the diffuse one")
    every = scene.surface.shape[0] * scene.surface.shape[1]
    counts = {
        "redundant": merged,
        "unread": unread,
        "idle": len(redundancy.images) * every,
        "held_out": held_out * every,
    }
    tried = {part: None for candidate in candidates for part in candidate.model.split("+")}
    lobes = [part for part in tried if not MODELS[part].body]
    taken = {*solution.problem.brdf.expression.split("+")}
    # Where one lobe is there the others are its rivals.
    components = [] if taken & {*lobes} else lobes
    return {"components": components, "samples": {**samples.skipped, **counts}, "work": work}


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


def warnings(
    samples: PhotographSamples,
    specification: Specification,
    solution: Solution,
    posterior: Posterior,
    precision: float | None,
) -> list[str]:
    """What a user should know of an estimate, in sentences.

    Args:
        samples: that it was made from.
        specification: what was asked for.
        solution, posterior: what came out.
        precision: that was asked for.
    """
    out = []
    photographs, redundancy = samples.photographs, samples.redundancy
    names, bars, parameters = photographs.names, posterior.bars, posterior.estimates
    # Outliers are counted by themselves.
    relative_rmse = solution.statistics.relative_rmse_trimmed
    if photographs.relative:
        out.append(
            "The common scale of the lights is unknown (relative radiometry): albedo is reported up to that scale."
        )
    for name in specification.default_held:
        fresnel = solution.problem.declared(name).role is Role.FRESNEL
        beside = " beside the strength of the highlight" if fresnel else ""
        out.append(
            f"{name} is held at {float(solution.problem.held[name]):g}: these images do not determine it{beside}; "
            f"--free {name} estimates it all the same, --fix {name}=VALUE sets it."
        )
    held_f0 = {
        name.rpartition(".")[0]: name
        for name in specification.default_held
        if solution.problem.declared(name).role is Role.FRESNEL
    }
    for name, parameter in parameters.items():
        f0 = held_f0.get(name.rpartition(".")[0])
        declared = solution.problem.brdf.declared.get(name)
        if declared is None or f0 is None or parameter.status != "at bound" or bars.holds:
            continue
        values = solution.problem.values(solution.unknowns)[name]
        if bool((values >= declared.domain.upper).any()) and name in solution.problem.factors:
            out.append(
                f"{name} is at its upper end: with {f0} held at {float(solution.problem.held[f0]):g} no lobe is bright "
                f"enough; give the surface's own, --fix {f0}=VALUE (a metal's is near 1)."
            )
    for name in specification.assumed:
        value = float(solution.problem.held[name])
        declared = solution.problem.declared(name)
        where = OPTICS[declared.role]
        out.append(f"{name} is taken as {value:g} {declared.unit}: {where} of the capture should say it.")
    surface = photographs.scene.surface
    if surface.coverage < _COVERED:
        out.append(
            f"The geometry covers only {surface.coverage:.0%} of the mask: check the camera and the mesh's units."
        )
    if redundancy.channels:
        out.append("The channels of every image are copies of each other: one is worked on, and reported.")
    out += [f"Image {image} ({names[image]}) is left out: {reason}." for image, reason in redundancy.images.items()]
    out += [
        f"Images {twin} ({names[twin]}) and {image} ({names[image]}) are the same pixels, stated to be "
        "under different lights or exposures: one of the files is not what it should be."
        for image, twin in redundancy.contradictions.items()
    ]
    odd = None if bars.holds or bars.chi2 < _MISFIT else _odd_image(solution, samples)
    if odd is not None:
        image = samples.images[odd[0]]
        out.append(
            f"Without image {image} ({names[image]}) χ² per value would fall from {bars.chi2:.3g} to "
            f"{odd[1]:.2g}: check its light, its exposure and whether it shows the same object."
        )
    empty = [names[k] for k, count in zip(samples.images, samples.counts, strict=True) if not count]
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
    lost = [name for name in lost if not known_by_derived(solution.problem, name)]
    locked = [name for name in lost if name in posterior.seen_together]
    if len(locked) > 1:
        out.append(f"{' and '.join(locked)} are not determined: these images see only a combination of them; fix one.")
    alone = [name for name in lost if len(locked) < 2 or name not in locked]
    if alone:
        told = [name + _channels(parameters[name]) for name in alone]
        out.append(f"{' and '.join(told)} {'are' if len(alone) > 1 else 'is'} not determined by these images.")
    absent = posterior.lobes.amplitudes
    if absent:
        out.append(f"No lobe of {' and '.join(sorted(absent))} is seen: intervals are of one as wide as fits best.")
    if not bars.holds and bars.kind == "fisher":
        out.append("There are too few pixels for error bars that allow for the misfit of the model.")
    if not photographs.noise_stated:
        noise = photographs.noise
        out.append(f"Noise was estimated from the images: read {noise.read:.2g}, gain {noise.gain:.2g} of full scale.")
    return out + _imprecise(parameters, precision)


def _channels(parameter: ParameterEstimate) -> str:
    """Which channels of a parameter are not determined, where others are."""
    values = parameter.value if isinstance(parameter.value, list) else []
    lost = [str(channel) for channel, value in enumerate(values) if value is None]
    return f" of channel {', '.join(lost)}" if 0 < len(lost) < len(values) else ""


def _odd_image(solution: Solution, samples: PhotographSamples) -> tuple[int, float] | None:
    """The position of the one image without which the others are met far better, and χ² per value then; or None.

    Without it every other unknown moves by a Gauss-Newton step.
    """
    images = solution.statistics.regrouped(samples.groups.image)
    if len(images) < _FEW:
        return None
    total, slope = images.information, images.gradient
    costs, values = images.column("cost"), images.column("values")
    left = []
    for image in range(len(images)):
        information, gradient = total - images.informations[image], slope - images.gradients[image]
        everything = torch.ones(len(total), dtype=torch.bool)
        gain = float(gradient @ fisher(information, everything).matrix @ gradient)
        left.append(float(costs.sum() - costs[image] - gain) / max(float(values.sum() - values[image]), 1.0))
    best = min(range(len(left)), key=lambda image: left[image])
    chi2 = float(costs.sum()) / max(float(values.sum()), 1.0)
    return (int(images.labels[best]), left[best]) if left[best] < max(_MET, _SHARE * chi2) else None
