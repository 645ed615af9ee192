"""Errors of the calibration as people read them: one row a family."""

from __future__ import annotations

import math
from collections.abc import Iterator

from matest.estimation.calibration import NuisanceEstimate
from matest.estimation.result import Estimate
from matest.inference.quantities import Number
from matest.report.format import measured
from matest.samples.uncertainty import labelled

# What page and terminal call the columns.
COLUMNS = ("error of", "n", "size ± error", "standard deviation", "most of the error bar of")
TITLE = "Errors of the calibration"
_OF_REFINED = "Size: as estimated with the material; of n errors their rms, ± that of the standard errors of each. "
_OF_ALL = (
    "Standard deviation: expected of each. Last column: the parameters whose error bars are mostly due to errors that "
    "were not refined."
)
_OF_NAMES = " In brackets the name for --uncertainty and --refine."
# In any unit of a calibration nothing.
_NOTHING = 1e-9


def legend(estimate: Estimate) -> str:
    """What the columns mean, as far as they have something in them."""
    refined = any(errors.refined for errors in estimate.nuisance.values())
    bracketed = any(labelled(name) != name for name in estimate.nuisance)
    return f"{_OF_REFINED if refined else ''}{_OF_ALL}{_OF_NAMES if bracketed else ''}"


def error_rows(estimate: Estimate) -> Iterator[tuple[str, str, str, str, str]]:
    """The cells of `COLUMNS`."""
    for name, errors in estimate.nuisance.items():
        expected = f"{_in_unit(errors.prior_std, None, errors.unit)} ({errors.origin})"
        yield labelled(name), _number(errors), _size(errors), expected, ", ".join(errors.limits)


def _number(errors: NuisanceEstimate) -> str:
    """How many errors of a family were refined, in a cell."""
    return str(errors.count) if errors.count else ""


def _size(errors: NuisanceEstimate) -> str:
    """The errors of a family in a cell."""
    values, stds = _numbers(errors.value), _numbers(errors.std)
    if errors.size is None or not values:
        return "not refined"
    if errors.count == 1:
        return _in_unit(values[0], stds[0], errors.unit)
    return _in_unit(errors.size, _typical_error(errors.size, values, stds), errors.unit)


def _numbers(value: Number) -> list[float]:
    """The numbers of a family; empty where it was not refined."""
    return [number for number in value if number is not None] if isinstance(value, list) else []


def _typical_error(size: float, values: list[float], stds: list[float]) -> float | None:
    """The rms of standard errors, in the unit of the size of their values; None where all values are 0."""
    rms = _rms(values)
    return _rms(stds) * size / rms if rms > 0 else None


def _rms(numbers: list[float]) -> float:
    return math.hypot(*numbers) / math.sqrt(len(numbers))


def _in_unit(value: float, std: float | None, unit: str) -> str:
    """A number with its unit; an angle in degrees."""
    if unit == "px²" and value > 0:
        # People know the width of a blur, not its variance.
        width = math.sqrt(value)
        value, std, suffix = width, None if std is None else std / (2 * width), " px"
    elif unit == "rad":
        value, std, suffix = math.degrees(value), None if std is None else math.degrees(std), "°"
    else:
        suffix = "" if unit == "1" else f" {unit}"
    if max(abs(value), std or 0.0) < _NOTHING:
        return f"0{suffix}"
    return (f"{value:.3g}" if std is None else measured(value, std)) + suffix
