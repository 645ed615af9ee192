"""What photographs will tell of every parameter of a model, and why of some they tell little."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from matest.identifiability.forecast import Forecast
from matest.identifiability.reasons import Reasons
from matest.inference.derived import reported_name, shows_only_in_derived
from matest.inference.quantities import Number

# Relative standard error above which a parameter is weak: the error bar is larger than the value.
_WEAK = 1.0


@dataclass(frozen=True)
class Prediction:
    """What the photographs will tell of one parameter. A list has one number per channel.

    Attributes:
        value: the value it is predicted for.
        std: predicted standard error, which holds stated errors of the calibration; None where not determined, or not
            estimated.
        relative: largest std over value (over the domain's width where that is 0).
        range: smallest and largest `relative` over all levels of the shape parameters that were not given, None where
            one of them leaves it undetermined; None altogether where all do, or there was only one level.
        unit: "1", "rad", "µm".
        status: determined | weak (std above the value, or good near it only) | not determined | held (by default) |
            fixed | tied.
        reason: why it is weak, not determined, held, or known up to a scale only; empty otherwise.
        noise_std: the part of `std` that is due to the noise.
    """

    value: Number
    std: Number
    relative: float | None
    range: tuple[float, float | None] | None
    unit: str
    status: str
    reason: str = ""
    noise_std: Number = None


def predictions(forecasts: Sequence[Forecast], reasons: Reasons, reasons_if_free: Reasons) -> dict[str, Prediction]:
    """The prediction of every parameter, and of a derived quantity in place of a parameter that shows only in it.

    Args:
        forecasts: at the nominal values, then at the other levels.
        reasons: of the parameters that are estimated.
        reasons_if_free: of all parameters, those held by default free too.
    """
    forecast, problem = forecasts[0], forecasts[0].problem
    stand_ins = {reported_name(problem, name): name for name in problem.free if shows_only_in_derived(problem, name)}
    values: dict[str, Number] = {name: value.tolist() for name, value in forecast.expansion.values.items()}
    values |= {name: forecast.posterior.estimates[name].value for name in stand_ins}
    by_noise = forecast.by_noise.posterior
    out = {}
    for name, estimate in forecast.posterior.estimates.items():
        # A derived quantity of parameters that show by themselves says nothing new.
        if name in values:
            noise_std = by_noise.estimates[name].std
            prediction = Prediction(
                values[name], estimate.std, None, None, estimate.unit, estimate.status, noise_std=noise_std
            )
            source = problem.ties.get(name, stand_ins.get(name, name))
            if source in problem.where:
                prediction = _of_estimated(prediction, name, source, forecasts, reasons)
            elif source in reasons_if_free.problem.where:
                prediction = replace(prediction, status="held", reason=reasons_if_free.of(source))
            out[name] = prediction
    return out


def _of_estimated(
    prediction: Prediction, name: str, source: str, forecasts: Sequence[Forecast], reasons: Reasons
) -> Prediction:
    """Complete the prediction of a parameter that is estimated, or takes the value of an estimated `source`."""
    problem = forecasts[0].problem
    relative = [float(forecast.relative_std[problem.where[source]].max()) for forecast in forecasts]
    status, reason = _verdict(prediction.status, source, relative[0], reasons)
    if forecasts[0].budget is not None and status != "determined":
        by_noise = forecasts[0].by_noise
        noise_alone = float(by_noise.relative_std[problem.where[source]].max())
        if _verdict(by_noise.posterior.estimates[name].status, source, noise_alone, reasons)[0] == "determined":
            reason = "the stated errors of the calibration leave it open"
    span = _span(relative)
    if shows_only_in_derived(problem, name):
        span, reason = None, f"only {reported_name(problem, name)} is seen without coherent light"
    size = None if status == "not determined" else relative[0]
    return replace(prediction, relative=size, range=span, status=status, reason=reason)


def _verdict(status: str, name: str, relative: float, reasons: Reasons) -> tuple[str, str]:
    """Status and reason of an estimated parameter, by the first rule that holds."""
    if status == "not determined":
        return status, reasons.of(name)
    if status == "determined" and relative > _WEAK:
        return "weak", reasons.of(name)
    if status == "determined" and name in reasons.bent:
        return "weak", reasons.curved
    return status, reasons.locked(name) or ""


def _span(relative: Sequence[float]) -> tuple[float, float | None] | None:
    """The smallest and the largest of several relative errors, which are infinite where not determined."""
    smallest, largest = min(relative), max(relative)
    if len(relative) == 1 or not math.isfinite(smallest):
        return None
    return smallest, largest if math.isfinite(largest) else None
