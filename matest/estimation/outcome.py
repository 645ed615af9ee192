"""What a fit comes to: with errors of the calibration, or with a map of the albedo."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from matest.brdf import Brdf
from matest.estimation.calibration import NuisanceEstimate
from matest.estimation.mapping import fit_with_maps
from matest.estimation.misreading import Misreading
from matest.estimation.options import Options
from matest.estimation.parameter_map import ParameterMap
from matest.estimation.photographs import PhotographFit, mapped_photograph_fits, photograph_fits
from matest.estimation.prediction import PredictionErrors, mapped_radiance, prediction_errors
from matest.estimation.refining import refined
from matest.estimation.remedies import Diagnosis, diagnoses, of_pixel_area
from matest.estimation.residual_angles import AngularResiduals, residuals_by_angle
from matest.estimation.smoothing import smoothed, smoothing_note
from matest.estimators import Solution
from matest.estimators.passes import radiance_model
from matest.inference.image_errors import few_samples
from matest.inference.posterior import Posterior, judge, judge_to_first_order
from matest.inference.quantities import ParameterEstimate
from matest.progress import Progress
from matest.samples.account import CalibratedSamples

if TYPE_CHECKING:
    from matest.capture import Capture


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a fit comes to.

    Attributes:
        solution: of the fit.
        posterior: of its unknowns.
        material: the model at the solution, with a value at every pixel of what is mapped.
        parameters: by name.
        errors_of: the errors on photographs of these numbers, which were left out.
        refined: families of errors of the calibration that were estimated.
        is_random: whether nothing is known that would explain residuals.
        nuisance, diagnosis, images, residuals, maps, smooth_maps: as in `Estimate`.
        notes: sentences on what error bars do not hold.
    """

    solution: Solution
    posterior: Posterior
    material: Brdf
    parameters: Mapping[str, ParameterEstimate]
    errors_of: Callable[[Sequence[int]], PredictionErrors]
    refined: Sequence[str] = ()
    is_random: bool = True
    nuisance: dict[str, NuisanceEstimate] = field(default_factory=dict)
    diagnosis: list[Diagnosis] = field(default_factory=list)
    images: list[PhotographFit] = field(default_factory=list)
    residuals: Mapping[str, AngularResiduals] = field(default_factory=dict)
    maps: dict[str, ParameterMap] = field(default_factory=dict)
    smooth_maps: dict[str, ParameterMap] = field(default_factory=dict)
    notes: Sequence[str] = ()


def outcome_of(
    solution: Solution,
    samples: CalibratedSamples,
    capture: Capture,
    options: Options,
    mistake: Misreading | None,
    progress: Progress,
) -> Outcome:
    """The fit with errors of the calibration, as options and residuals ask for them.

    Args:
        solution: with the calibration as it is stated.
        samples: that were fitted.
        capture: that they are of.
        options: what to estimate.
        mistake: in the description of the capture; None: there is none.
        progress: called with a word on what is being done.
    """
    solution, calibration, found, notes = refined(
        solution, samples, options, capture.stated_uncertainty, progress, misread=mistake is not None
    )
    faults = [cause for cause in found if not cause.is_pixel_area]
    notes = [*notes, *(of_pixel_area(cause) for cause in found if cause.is_pixel_area)]
    budget = calibration.budget(solution.problem, solution.unknowns, samples, options.seed, solution.residual_scale)
    # Of a model under the wrong light no profile is worth its time.
    posterior = (judge_to_first_order if mistake else judge)(solution, samples, budget=budget)
    drawn = few_samples(samples, options.seed)
    material = solution.problem.material(solution.unknowns)
    radiance = radiance_model(solution.problem, solution.unknowns)
    return Outcome(
        solution=solution,
        posterior=posterior,
        material=material,
        parameters=posterior.estimates,
        errors_of=lambda images: prediction_errors(capture, material, images, solution),
        refined=[*calibration.refined],
        is_random=all(cause.refined for cause in faults),
        nuisance=calibration.estimates(solution, posterior, samples),
        diagnosis=[mistake.diagnosis] if mistake else diagnoses(faults),
        images=photograph_fits(solution, samples, capture.scene, drawn),
        residuals=residuals_by_angle(radiance, solution.residual_scale, drawn[0]),
        notes=notes,
    )


def mapped_outcome(
    solution: Solution,
    samples: CalibratedSamples,
    capture: Capture,
    options: Options,
    mistake: Misreading | None,
    progress: Progress,
) -> Outcome:
    """The fit in which every pixel has its own albedo; arguments are those of `outcome_of`."""
    mapped = fit_with_maps(solution, samples, capture.scene.surface, options, capture.stated_uncertainty, progress)
    posterior = judge_to_first_order(mapped.solution, samples, budget=mapped.budget)
    beside = [
        name for name in capture.stated_uncertainty.merged(options.uncertainty).stated if name in ("albedo", "blur")
    ]
    material, residual_scale = mapped.material, mapped.solution.residual_scale
    drawn, _ = few_samples(samples, options.seed)
    parameters = mapped.parameters(posterior.estimates)
    names = [capture.names[image] for image in samples.account.images]
    radius, surface = options.smooth_maps, capture.scene.surface
    notes = mapped.notes if mistake is None else []
    if beside:
        notes.append(f"Error bars of a map do not hold the stated {' and '.join(beside)}.")
    smooth = {}
    if radius:
        chi2 = posterior.bars.chi2
        shapes = mapped.fit.texels.shapes
        smooth = {
            name: smoothed(each, surface, radius, parameters[name], chi2, is_shape=name in shapes)
            for name, each in mapped.maps.items()
        }
        notes.append(smoothing_note(radius))
    return Outcome(
        solution=mapped.solution,
        posterior=posterior,
        material=material,
        parameters=parameters,
        errors_of=lambda images: prediction_errors(capture, material, images),
        diagnosis=[mistake.diagnosis] if mistake else [],
        images=mapped_photograph_fits(mapped.fit.totals, names, mapped.residuals.taken),
        residuals=residuals_by_angle(mapped_radiance(material, samples.texels), residual_scale, drawn),
        maps=dict(mapped.maps),
        smooth_maps=smooth,
        notes=notes,
    )
