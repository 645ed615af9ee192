"""The facade: what photographs will tell of a model."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from torch import Tensor

from matest.capture import Capture
from matest.errors import InputError
from matest.estimation.misreading import misdescribed
from matest.estimation.options import Options, Value, as_uncertainty
from matest.estimation.specification import by_path, specify
from matest.identifiability.advice import LightAdvice, advise
from matest.identifiability.calibration import CalibrationError, CalibrationLimit, Stated
from matest.identifiability.forecast import as_estimated, at_levels, bent_names, predicted_samples
from matest.identifiability.highlight import Nearness
from matest.identifiability.maps import MapsForecast, forecast_maps
from matest.identifiability.nominal import Nominal
from matest.identifiability.plan import Plan, with_full_scale_for
from matest.identifiability.predictions import Prediction, predictions
from matest.identifiability.reasons import Reasons
from matest.photographs.samples import PhotographSamples
from matest.progress import Progress, silent
from matest.samples.uncertainty import Uncertainty

SCHEMA = "matest.check/1"
# What is checked of a capture when no model is named: the largest that `auto` tries.
DEFAULT_MODEL = "oren-nayar+cook-torrance"


@dataclass(frozen=True)
class Check:
    """What some photographs will tell of a model.

    Attributes:
        capture: name of the capture.
        model: expression of the model.
        parameters: by name (in a sum: by path).
        light: the advice; None if no further light lowers any error bar.
        images: number of photographs.
        samples: usable pixels of all images together.
        skipped: pixels left out, by reason.
        noise: read, gain (fractions of full scale) and where they come from.
        highlight: smallest angle between half vector and normal of a usable sample, radians; None without samples.
        levels: for which values of the shape parameters `range` holds, by parameter.
        warnings: sentences.
        calibration: what errors of the calibration do, by family, the largest effect first; those that nobody states
            would do it if there were any.
        limits: what limits the parameters whose error bars are mostly due to stated errors, at most three.
        understood: how the files were read, a clause for each convention: axes, transfer, units, lights, scale.
        maps: what each number of the photographs allows where parameters have a value at every pixel; None where none
            was asked for.
    """

    capture: str
    model: str
    parameters: dict[str, Prediction]
    light: LightAdvice | None
    images: int
    samples: int
    skipped: dict[str, int]
    noise: dict[str, Any]
    highlight: float | None
    levels: dict[str, list[float]]
    warnings: list[str]
    calibration: dict[str, CalibrationError]
    limits: list[CalibrationLimit]
    understood: dict[str, str]
    maps: MapsForecast | None = None

    def to_dict(self) -> dict[str, Any]:
        """The content of `matest check --json`."""
        return {"schema": SCHEMA, **asdict(self)}


def check(
    plan: Plan | Capture,
    model: str | None = None,
    *,
    fix: Mapping[str, Value] | None = None,
    free: Sequence[str] = (),
    tie: Mapping[str, str] | None = None,
    at: Mapping[str, Value] | None = None,
    noise: tuple[float, float] | None = None,
    uncertainty: Uncertainty | Mapping[str, float | Sequence[float]] | None = None,
    maps: str | Sequence[str] = (),
    progress: Progress = silent,
) -> Check:
    """Standard errors that `estimate` will report, predicted from geometry, lights, noise and values of the material.

    They hold what stated errors of the calibration add. What errors that nobody states would add is said beside them.

    The Fisher information of noise-free photographs predicted for the values; their pixels are selected as those of
    real ones are: lit, off the rim, not clipped. Values not given are those of the scene's material or the model's
    defaults; shape parameters among the defaults are also halved and doubled together, for the `range`.

    Of photographs that exist a warning says if they look as if their description had a mistake.

    Args:
        plan: of `load_plan`, or a capture; the pixels of its photographs serve for their noise and that warning alone.
        model: an expression; default: the scene's material, else "oren-nayar+cook-torrance".
        fix, free, tie: parameters, as for `estimate`.
        at: values that are assumed, by name or path; these are estimated all the same.
        noise: read and gain instead of the plan's: variance = read² + gain·signal, in fractions of full scale.
        uncertainty: one standard deviation of what the calibration states, as for `estimate`; it comes before the
            plan's own.
        maps: parameters that are to have a value at every pixel, as for `estimate`; see `Check.maps`.
        progress: called with a word, and how much of it is done.

    Raises:
        InputError: unknown names, values or uncertainties outside their domains, impossible constraints, nothing left
            to estimate, a parameter that cannot have a map, a model that cannot be estimated under lights of unknown
            strength.
    """
    plan = Plan.of(plan.object()) if isinstance(plan, Capture) else plan
    plan = plan if noise is None else plan.with_noise(*noise)
    stated = as_uncertainty(uncertainty)
    options = Options(model=model, fix=fix or {}, free=free, tie=tie or {}, uncertainty=stated, maps=maps)
    return check_with(plan, options, at or {}, progress)


def check_with(plan: Plan, options: Options, at: Mapping[str, Value], progress: Progress = silent) -> Check:
    """What `check` says of a plan, as options ask for it; values `at` are assumed.

    Raises:
        InputError: see `check`.
    """
    nominal, relative = _nominal(plan, options, at), plan.photographs.relative
    progress("predicting photographs")
    photographs = plan.photographs if plan.exposed else with_full_scale_for(nominal.material, plan.photographs)
    samples = predicted_samples(photographs, nominal.problem, nominal.unknowns)
    forecast, all_free = as_estimated(samples, nominal)
    held, maps = nominal.specification.default_held, None
    if options.maps:
        maps = forecast_maps(samples, forecast, options.maps, nominal.levels, held, progress)
    stated = Stated(options, plan.uncertainty)
    bent = bent_names(forecast, samples)
    errors = stated.errors(forecast, samples, bent)
    levels = at_levels(photographs, forecast.problem, nominal.levels, progress, stated.budget)
    advice = advise(samples, nominal, forecast, progress)
    nearness = Nearness.of(samples)
    reasons = Reasons(forecast, nearness, relative, bent)
    return Check(
        capture=plan.name,
        model=nominal.material.expression,
        parameters=predictions([errors.allowed_for, *levels], reasons, Reasons(all_free, nearness, relative)),
        light=advice,
        images=len(photographs),
        samples=len(samples),
        skipped=samples.skipped,
        noise={"read": photographs.noise.read, "gain": photographs.noise.gain, "source": plan.noise_source},
        highlight=nearness.usable if math.isfinite(nearness.usable) else None,
        levels=nominal.tried,
        warnings=[*_misreading(plan, progress), *_warnings(plan, options, samples)],
        calibration=errors.by_family,
        limits=errors.limits,
        understood=plan.understood,
        maps=maps,
    )


def _nominal(plan: Plan, options: Options, at: Mapping[str, Value]) -> Nominal:
    """The model to check and its values: the scene's where it is of the model asked for, or no model is."""
    expression = options.model or (plan.material.expression if plan.material is not None else DEFAULT_MODEL)
    photographs = plan.photographs
    specification = specify(
        expression, options, channels=photographs.channels, relative=photographs.relative, scene=photographs.scene
    )
    brdf = specification.problem.brdf
    if not specification.problem.free:
        raise InputError(f"every parameter of {expression} is fixed or tied: there is no error to predict; free one.")
    values: dict[str, Tensor] = {}
    if plan.material is not None and plan.material.expression == expression:
        fix = by_path(brdf, options.fix)
        values = {name: value for name, value in plan.material.parameters.items() if name not in fix}
    return Nominal.of(specification, values, at)


def _misreading(plan: Plan, progress: Progress) -> list[str]:
    """The mistake in the description of photographs that exist, if any explains them much better undone."""
    if not plan.taken:
        return []
    progress("comparing with the photographs")
    found = misdescribed(plan.photographs.samples())
    return [found] if found else []


def _warnings(plan: Plan, options: Options, samples: PhotographSamples) -> list[str]:
    """What a person should know of a prediction."""
    material = "" if plan.material is None else plan.material.expression
    dark = ", ".join(str(image) for image, count in zip(samples.images, samples.counts, strict=True) if not count)
    clipped = samples.skipped["saturated"]
    sentences = {
        f"No model was named: {DEFAULT_MODEL} is the largest that estimate tries; --model checks another.": (
            options.model is None and not material
        ),
        "The strength of the lights is unknown (relative radiometry): albedos are known up to one scale.": (
            plan.photographs.relative
        ),
        f"The scene's material ({material}) is another model: its values are not used.": (
            material and options.model not in (None, material)
        ),
        f"Image {dark} gives no usable pixel: its light is behind the object, or it is clipped.": dark,
        f"{clipped:,} pixels are predicted to be saturated: they tell little.": clipped,
        "No mesh: cast shadows are unknown and left out of account.": plan.photographs.scene.surface.mesh is None,
    }
    return [*plan.photographs.notes, *(sentence for sentence, holds in sentences.items() if holds)]
