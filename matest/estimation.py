"""The facade: estimate a capture's material, predict a capture from a material."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from matest.brdf import Brdf, Sum
from matest.capture import Capture, Samples
from matest.capture.samples import BLOCKS
from matest.errors import InputError
from matest.estimators import Problem, Solution, accumulate, all_tiles, at_bound, bounded_step, fit
from matest.result import Candidate, Estimate, Fit, ParameterEstimate
from matest.selection import select
from matest.shader import render
from matest.specification import Constraints, Specification, Value, freed, specify
from matest.uncertainty import Covariance, correlation_of_residuals, fisher, jackknife, quantile95

# χ² per value above this says that the model does not hold: stated noise is exact, noise estimated from the pictures
# is known to some per cent.
_HOLDS_STATED, _HOLDS_ESTIMATED = 1.03, 1.10
# Scores of blocks of pixels that scatter this many times as much as independent residuals' do: not independent.
_CORRELATED = 2.0
# With fewer images, blocks of pixels serve as clusters.
_MIN_IMAGES = 4
# A parameter held by default is freed when its predicted relative error is below this.
_WORTH_FREEING = 0.25
# No better known than a value drawn evenly from the domain (its std is width/√12): not determined.
_KNOWS_NOTHING = 1 / math.sqrt(12)

Progress = Callable[[str], None]


def estimate(
    capture: Capture,
    model: str = "auto",
    *,
    fix: Mapping[str, Value] | None = None,
    free: Sequence[str] = (),
    tie: Mapping[str, str] | None = None,
    holdout: Sequence[int] = (),
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
        seed: of the subsample that the search starts from.
        device: where tiles are evaluated ("cpu", "cuda").
        progress: called with a word on what is being done.

    Raises:
        InputError: unknown names, impossible constraints, no usable pixel.
    """
    clock = time.perf_counter()
    constraints = Constraints(fix or {}, tuple(free), tie or {})
    images = _fitted_images(capture, holdout)
    samples = capture.samples(images, device=device)
    if not len(samples):
        raise InputError(_no_samples(capture, samples))
    candidates: list[Candidate] = []
    if model == "auto":
        model, candidates = select(samples, constraints, seed, progress)
    specification = specify(model, constraints, channels=capture.channels, relative=capture.relative)
    solution = fit(specification.problem, samples, seed, progress)
    determined = _worth_freeing(specification, solution, samples)
    if determined:
        specification = freed(specification, determined)
        problem = replace(specification.problem, gauge_limit=solution.problem.gauge_limit)
        solution = fit(problem, samples, seed, progress, _widened(problem, solution))

    uncertainty = _uncertainty(solution, capture, len(images))
    material = solution.problem.material(solution.unknowns)
    statistics = solution.statistics
    parameters = _parameters(solution, uncertainty)
    outcome = Fit(
        rmse=math.sqrt(statistics.total("squared_residual") / max(statistics.total("values"), 1)),
        relative_rmse=_relative(statistics.total("squared_residual"), statistics.total("squared_signal")),
        reduced_chi2=uncertainty.chi2,
        samples=len(samples),
        samples_used=int(statistics.total("samples")),
        iterations=solution.iterations,
        status="converged" if solution.converged else "not converged",
        message=_message(solution, uncertainty),
        errors=uncertainty.kind,
    )
    left_out = None
    if holdout:
        errors = image_errors(capture, material, holdout)
        left_out = {"images": list(holdout), "relative_rmse": math.sqrt(float(np.mean(np.square(errors))))}
    fit_s = time.perf_counter() - clock
    return Estimate(
        capture=capture.name,
        model=material.expression,
        material=material,
        parameters=parameters,
        labels=solution.problem.labels,
        correlation=uncertainty.covariance.correlation.tolist(),
        fit=outcome,
        relative=capture.relative,
        candidates=candidates,
        skipped=_skipped(samples, specification, material),
        timing_s={**capture.timing, "fit": fit_s},
        holdout=left_out,
        warnings=_warnings(capture, specification, solution, parameters, uncertainty),
    )


def predict(material: Brdf, capture: Capture) -> tuple[np.ndarray, list[float]]:
    """Radiance images [K, H, W, C] of a material under a capture's lights, and the relative error of each image.

    The error is the rms difference over the rms signal on the usable pixels of the photograph.
    """
    images = render(capture.scene, material).detach().numpy()
    return images, image_errors(capture, material, range(len(capture)))


def image_errors(capture: Capture, material: Brdf, images: Sequence[int]) -> list[float]:
    """Relative rms error of the shaded material against each of some photographs, over their usable pixels."""
    specification = specify(material.expression, Constraints(), channels=capture.channels, relative=True)
    problem = replace(specification.problem, free=(), held=material.parameters, ties={})
    errors = []
    for image in images:
        nothing = torch.zeros(0, dtype=torch.float64)
        statistics = accumulate(problem, nothing, all_tiles(capture.samples([image])), nothing)
        errors.append(_relative(statistics.total("squared_residual"), statistics.total("squared_signal")))
    return errors


@dataclass(frozen=True)
class _Uncertainty:
    """Error bars of a solution.

    Attributes:
        covariance: with parameters at a bound left out.
        open: the same with them let free: how far inside the domain the truth may lie.
        bound: unknowns at a bound [P].
        chi2: per value.
        correlation: of residuals over blocks of pixels: 1 if they are independent.
        holds: whether the model describes the images to their noise.
        kind: what the error bars rest on.
    """

    covariance: Covariance
    open: Covariance
    bound: Tensor
    chi2: float
    correlation: float
    holds: bool
    kind: str


def _uncertainty(solution: Solution, capture: Capture, images: int) -> _Uncertainty:
    problem, statistics = solution.problem, solution.statistics
    values = max(statistics.total("values"), 1)
    chi2 = statistics.total("chi2") / values
    bound = at_bound(problem, solution.unknowns, statistics.gradient)
    everything = torch.ones_like(bound)
    scale = max(chi2, 1.0)
    closed, opened = (fisher(statistics.information / scale, free) for free in (~bound, everything))
    blocks = [sums.gradient / scale for sums in statistics.clusters.values()]
    correlation = correlation_of_residuals(blocks, closed)
    allowed = (_HOLDS_STATED if capture.noise_given else _HOLDS_ESTIMATED) + 5 * math.sqrt(2 / values)
    holds = chi2 <= allowed and correlation <= _CORRELATED
    clusters = statistics.grouped(BLOCKS) if images >= _MIN_IMAGES else statistics
    if holds or len(clusters.clusters) < _MIN_IMAGES:
        return _Uncertainty(closed, opened, bound, chi2, correlation, holds, "fisher")
    informations = [sums.information for sums in clusters.clusters.values()]
    gradients = [sums.gradient for sums in clusters.clusters.values()]

    def inside(information: Tensor, gradient: Tensor) -> Tensor:
        return bounded_step(problem, solution.unknowns, information, gradient)

    def anywhere(information: Tensor, gradient: Tensor) -> Tensor:
        return fisher(information, everything).matrix @ gradient

    return _Uncertainty(
        jackknife(informations, gradients, ~bound, inside),
        jackknife(informations, gradients, everything, anywhere),
        bound,
        chi2,
        correlation,
        holds,
        "jackknife over images" if images >= _MIN_IMAGES else "jackknife over blocks",
    )


def _worth_freeing(specification: Specification, solution: Solution, samples: Samples) -> list[str]:
    """Parameters held by default that the images determine: judged by the error bar they would get."""
    names = specification.default_held
    if not names:
        return []
    wider = freed(specification, names).problem
    unknowns = _widened(wider, solution)
    statistics = accumulate(wider, unknowns, all_tiles(samples), unknowns)
    covariance = fisher(statistics.information / statistics.misfit, torch.ones(wider.size, dtype=torch.bool))
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


def _parameters(solution: Solution, uncertainty: _Uncertainty) -> dict[str, ParameterEstimate]:
    problem = solution.problem
    values = problem.values(solution.unknowns)
    out = {}
    for name, declared in problem.brdf.declared.items():
        source = problem.ties.get(name, name)
        value = values[name]
        if source in problem.where:
            found = _estimated(solution, uncertainty, source)
            status = "tied" if source != name else found.status
            out[name] = replace(found, status=status, unit=declared.unit, doc=declared.doc)
        elif not declared.gauge:
            out[name] = ParameterEstimate(value.tolist(), None, None, declared.unit, "fixed", declared.doc)
    return out


def _estimated(solution: Solution, uncertainty: _Uncertainty, name: str) -> ParameterEstimate:
    """Value, error bar and interval of a free parameter, channel by channel."""
    problem, place = solution.problem, solution.problem.where[name]
    domain, declared = problem.domain(name), problem.declared(name)
    reach = quantile95(uncertainty.covariance.degrees)
    values: list[float | None] = []
    stds: list[float | None] = []
    intervals: list[list[float] | None] = []
    states = []
    for position in range(place.start, place.stop):
        value = float(solution.unknowns[position])
        at_end = bool(uncertainty.bound[position])
        covariance = uncertainty.open if at_end else uncertainty.covariance
        std = float(covariance.std[position])
        largest = _KNOWS_NOTHING * declared.domain.width if math.isfinite(declared.domain.width) else math.inf
        if declared.log:
            largest = min(largest, 0.5 * value)
        if bool(covariance.undetermined[position]) or (std > largest and not at_end):
            values.append(None)
            stds.append(None)
            intervals.append(None)
            states.append("not determined")
            continue
        values.append(value)
        stds.append(None if at_end else std)
        intervals.append([max(domain.lower, value - reach * std), min(domain.upper, value + reach * std)])
        states.append("at bound" if at_end else "determined")
    status = next(state for state in ("not determined", "at bound", "determined") if state in states)
    single = len(values) == 1
    return ParameterEstimate(
        values[0] if single else values,
        stds[0] if single else stds,
        intervals[0] if single else intervals,
        declared.unit,
        status,
        declared.doc,
    )


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


def _relative(squared_residual: float, squared_signal: float) -> float:
    return math.sqrt(squared_residual / squared_signal) if squared_signal > 0 else 0.0


def _message(solution: Solution, uncertainty: _Uncertainty) -> str:
    if not solution.converged:
        return (
            f"Not converged: after {solution.iterations} passes the next step would still move the estimate by "
            f"{solution.last_step:.2g} standard errors."
        )
    if uncertainty.holds:
        return f"Converged; the model describes the images to their noise (χ² per value {uncertainty.chi2:.2f})."
    if uncertainty.kind == "fisher":
        return f"Converged; residuals are {math.sqrt(uncertainty.chi2):.3g} times the noise, error bars scaled by that."
    reason = f"residuals are {math.sqrt(uncertainty.chi2):.3g} times as large"
    if uncertainty.correlation > _CORRELATED and uncertainty.chi2 < _HOLDS_ESTIMATED:
        reason = (
            f"residuals lean the same way over whole regions, {math.sqrt(uncertainty.correlation):.3g} times chance"
        )
    return (
        f"Converged; the model does not hold to the noise ({reason}), so error bars come from the {uncertainty.kind}."
    )


def _skipped(samples: Samples, specification: Specification, material: Brdf) -> dict:
    work = []
    scene = samples.capture.scene
    if scene.surface.mesh is not None and scene.surface.mesh.convex:
        work.append("shadow rays: the mesh is convex and cannot shadow itself")
    elif scene.surface.mesh is None:
        work.append("shadow rays: no mesh, cast shadows are unknown")
    if not bool((scene.ambient > 0).any()):
        work.append("ambient light: there is none")
    for name in specification.problem.held:
        if name.endswith("diffuse") and isinstance(material, Sum) and float(specification.problem.held[name]) == 0:
            work.append(f"{name}: another component is the diffuse one")
    return {"components": [], "samples": samples.skipped, "work": work}


def _warnings(
    capture: Capture,
    specification: Specification,
    solution: Solution,
    parameters: dict[str, ParameterEstimate],
    uncertainty: _Uncertainty,
) -> list[str]:
    out = []
    if capture.relative:
        out.append(
            "The common scale of the lights is unknown (relative radiometry): albedo is reported up to that scale."
        )
    for name in specification.default_held:
        out.append(
            f"{name} is held at {float(solution.problem.held[name]):g}: these images do not determine it beside the "
            f"strength of the highlight; --free {name} estimates it all the same, --fix {name}=VALUE sets it."
        )
    lost = [name for name, parameter in parameters.items() if parameter.status == "not determined"]
    if len(lost) > 1:
        out.append(f"{' and '.join(lost)} are not determined: these images see only a combination of them; fix one.")
    elif lost:
        out.append(f"{lost[0]} is not determined by these images.")
    if not uncertainty.holds and uncertainty.kind == "fisher":
        out.append("There are too few pixels for error bars that allow for the misfit of the model.")
    if not capture.noise_given:
        noise = capture.noise
        out.append(f"Noise was estimated from the images: read {noise.read:.2g}, gain {noise.gain:.2g} of full scale.")
    if not solution.converged:
        out.append(_message(solution, uncertainty))
    return out
