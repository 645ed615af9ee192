"""The facade: estimate a capture's material."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from matest.direction_error import direction_note
from matest.errors import InputError
from matest.estimation.brightness import unlike_surfaces
from matest.estimation.calibration import without_effect
from matest.estimation.freeing import determined_by_images, widened
from matest.estimation.map_selection import FEWEST_IMAGES, select_mapped
from matest.estimation.misreading import misdescribed, misreading
from matest.estimation.options import AUTO, Options, Value, as_uncertainty
from matest.estimation.outcome import mapped_outcome, outcome_of
from matest.estimation.photographs import standing_out
from matest.estimation.prediction import PredictionErrors
from matest.estimation.remarks import message, skipped, unread_samples
from matest.estimation.result import Estimate, Fit
from matest.estimation.selection import select
from matest.estimation.specification import Specification, expression_of, freed, specify_unknowns
from matest.estimation.verdict import sentences
from matest.estimation.warnings import Context, warnings
from matest.estimators import Solution, fit, fit_some
from matest.inference.error_bars import ErrorBars
from matest.inference.posterior import judge_to_first_order
from matest.progress import Progress, silent
from matest.samples import Samples
from matest.samples.account import Account, AccountedSamples, CalibratedSamples
from matest.samples.uncertainty import Uncertainty

if TYPE_CHECKING:
    from matest.capture import Capture


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
    uncertainty: Uncertainty | Mapping[str, float | Sequence[float]] | None = None,
    refine: str | Sequence[str] = (),
    maps: str | Sequence[str] = (),
    regions: int | None = None,
    smooth_maps: int = 0,
    progress: Progress = silent,
) -> Estimate:
    """The material of a capture with its error bars.

    Args:
        capture: from `load_capture`; of several objects one of its `objects`.
        model: an expression such as "oren-nayar+torrance-sparrow", or "auto".
        fix: values of parameters that are not estimated, by name or path.
        free: parameters to estimate although they are held by default (`f0`).
        tie: dependent parameter -> the one whose value it takes.
        holdout: images to leave out of the fit; the error there is reported.
        precision: stop reading pixels once every parameter's relative standard error is below this, 0 to 1, where the
            model describes the images; None: read all.
        seed: of the subsample that the search starts from.
        device: where tiles are evaluated ("cpu", "cuda").
        uncertainty: one standard deviation of what the calibration states, by family (`matest.samples.uncertainty`),
            such as {"direction": 0.01, "pose": (0.5, 0.01)}; it comes before the capture's own.
        refine: families of errors of the calibration to estimate with the material, as ["direction", "pose"] or
            "direction,pose"; "all": every family; "auto": those that explain what the fit without them leaves.
        maps: parameters with a value at every pixel, as ["albedo", "sigma"] or "albedo,sigma"; "albedo" is the body's.
        regions: number of regions, found from the maps, whose values pixels take that do not tell their own; None: as
            many as their albedos stand apart in.
        smooth_maps: radius in pixels by which `Estimate.smooth_maps` are smoothed between edges; 0: there are none.
        progress: called with a word on what is being done.

    Raises:
        InputError: unknown names, impossible constraints, no usable pixel, several objects.
        TypeError: samples instead of a capture.
    """
    if isinstance(capture, Samples):
        raise TypeError(
            f"estimate takes a capture, not {type(capture).__name__}; fit (matest.estimators) and judge "
            "(matest.inference.posterior) take samples of any kind."
        )
    options = Options(
        model=model, fix=fix or {}, free=free, tie=tie or {}, holdout=holdout, precision=precision, seed=seed,
        device=device, uncertainty=as_uncertainty(uncertainty), refine=refine,
        maps=maps, regions=regions, smooth_maps=smooth_maps,
    )  # fmt: skip
    return estimate_with(capture, options, progress)


def estimate_with(capture: Capture, options: Options, progress: Progress = silent) -> Estimate:
    """The material of a capture with its error bars, as options ask for it.

    Raises:
        InputError: see `estimate`.
    """
    clock = time.perf_counter()
    capture = capture.object()
    samples = _samples(capture, options)
    if samples.account.redundancy.channels:
        fix = {name: _of_one_channel(value, capture.channels) for name, value in options.fix.items()}
        options = replace(options, fix=fix)
    expression, selection, candidates = options.model, None, []
    by_maps = options.automatic and options.maps and len(samples.account.images) >= FEWEST_IMAGES
    if by_maps:
        of_maps = select_mapped(samples, options, progress)
        expression, candidates = of_maps.expression, list(of_maps.candidates)
    elif expression is None or options.automatic:
        selection = select(samples, options, progress)
        expression, candidates = selection.best.recipe.expression, selection.candidates
    specification, solution = solve(expression, samples, options, progress)
    if not solution.statistics.total("values"):
        if sentence := unlike_surfaces(samples):
            raise InputError(f"{capture.name}: {sentence}")
        why = misdescribed(samples) or "Photograph it with another exposure."
        raise InputError(
            f"{capture.name}: no value lies inside the sensor's range and near the model: the object is saturated or "
            f"black in every image. {why}"
        )
    mistake = misreading(specification.problem, solution, samples, options.seed)
    outcome = (mapped_outcome if options.maps else outcome_of)(solution, samples, capture, options, mistake, progress)
    solution, posterior = outcome.solution, outcome.posterior
    said = [one.message for one in outcome.diagnosis]
    if mistake is None:
        said = [*standing_out(outcome.images), *said]
    if selection and mistake is None:
        said += sentences(selection, outcome.refined, explained=bool(outcome.diagnosis), mapped=bool(options.maps))
    said += outcome.notes
    if options.automatic and options.maps and not by_maps:
        said.append(
            f"The model was chosen with one value of {' and '.join(options.maps)} for all pixels: that takes what "
            f"differs between them for its own. Maps choose it from {FEWEST_IMAGES} photographs on; --model names "
            "another."
        )
    stated = capture.stated_uncertainty.merged(options.uncertainty).stated
    said += without_effect(stated, surrounded=capture.scene.surrounded)
    if directions := direction_note(capture.scene, outcome.material):
        said.append(directions)
    explained = bool(outcome.diagnosis or candidates)
    context = Context(
        samples, specification, solution, posterior, options.precision, said, explained, mistake is not None,
        images=outcome.images, mapped=bool(outcome.maps),
    )  # fmt: skip
    sentence = message(solution, posterior.bars, unread_samples(samples, solution), random=outcome.is_random)
    held_out = sorted({*options.holdout})
    # Noise belongs to the fit: reading is decoding, geometry is normals, rays and directions.
    fit_s = time.perf_counter() - clock + capture.timing.get("noise", 0.0)
    return Estimate(
        capture=capture.name,
        model=expression_of(outcome.material, expression),
        material=outcome.material,
        parameters=dict(outcome.parameters),
        labels=list(posterior.labels),
        correlation=[list(row) for row in posterior.correlation],
        fit=summary(samples, solution, posterior.bars, sentence),
        relative=capture.relative,
        candidates=candidates,
        skipped=skipped(samples, solution, len(held_out), selection.unsupported if selection else []),
        timing_s={**{stage: capture.timing.get(stage, 0.0) for stage in ("read", "geometry")}, "fit": fit_s},
        holdout=_holdout(held_out, outcome.errors_of(held_out)) if held_out else None,
        nuisance=outcome.nuisance,
        diagnosis=outcome.diagnosis,
        misreading=mistake,
        images=outcome.images,
        residual_scale=solution.residual_scale,
        residuals=outcome.residuals,
        maps=outcome.maps,
        smooth_maps=outcome.smooth_maps,
        warnings=warnings(context),
    )


def _holdout(images: Sequence[int], errors: PredictionErrors) -> dict[str, Any]:
    """The images that were left out, and the errors there."""
    return {"images": [*images], "relative_rmse": errors.pooled, "median_error": errors.pooled_median}


def _samples(capture: Capture, options: Options) -> CalibratedSamples:
    """The samples that are fitted.

    Raises:
        InputError: there is none.
    """
    images = options.fitted_images(len(capture))
    # Values that differ between channels belong to channels that do.
    differ = any(len({*value}) > 1 for value in options.fix.values() if not isinstance(value, int | float))
    samples = capture.photographs.samples(images, distinct=True, every_channel=differ, device=options.device)
    if not samples.account.images:
        raise InputError(f"{capture.name}: the lights of every image are stated to give no light; correct irradiance.")
    if not len(samples):
        raise InputError(_no_samples(capture.name, samples.account, misdescribed(samples)))
    return samples


def solve(
    expression: str, samples: AccountedSamples, options: Options, progress: Progress
) -> tuple[Specification, Solution]:
    """The optimum, with those parameters freed that are held by default and that the images determine."""
    specification = specify_unknowns(
        expression, options, channels=samples.channels, relative=samples.relative, scene=samples
    )
    # Maps only start from one value for all pixels.
    search = fit_some if options.maps else partial(fit, precision=options.precision or 0.0)
    solution = search(specification.problem, samples, options.seed, progress)
    wider = freed(specification, determined_by_images(specification, solution, len(samples)))
    if wider.problem.free == specification.problem.free:
        return specification, solution
    problem = wider.problem.limited(solution.problem.light_scale_limit)
    again = search(problem, samples, options.seed, progress, widened(problem, solution))
    # What looked determined by its Fisher error may not be by an honest one.
    if judge_to_first_order(again, samples).not_determined:
        return specification, solution
    return wider, again


def summary(samples: AccountedSamples, solution: Solution, bars: ErrorBars, sentence: str) -> Fit:
    """How the fit went, in numbers and a sentence, and how close the model comes."""
    statistics = solution.statistics
    measured = len(samples) - samples.account.skipped["saturated"]
    return Fit(
        rmse=math.sqrt(statistics.total("squared_residual") / max(statistics.total("usable"), 1)),
        relative_rmse=statistics.relative_rmse,
        relative_rmse_trimmed=statistics.relative_rmse_trimmed,
        reduced_chi2=bars.chi2,
        samples=measured,
        samples_used=min(int(statistics.total("samples")), measured),
        iterations=solution.iterations,
        status="converged" if solution.converged else "not converged",
        message=sentence,
        errors=bars.kind,
        outliers=statistics.outliers,
        values_left_out=int(statistics.total("outliers")),
    )


def _of_one_channel(value: Value, channels: int) -> Value:
    """A fixed value for the one channel that stands for so many copies."""
    return value if isinstance(value, int | float) or len(value) != channels else value[0]


def _no_samples(name: str, account: Account, why: str) -> str:
    counts = ", ".join(f"{count} {reason}" for reason, count in account.skipped.items() if count)
    mend = why or (
        "Check that the lights face the object (directions point from the surface to the light), the mask and "
        "encoding.saturation."
    )
    return f"{name}: no lit pixel is left to fit: of all pixels, {counts}. {mend}"
