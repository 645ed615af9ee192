"""Errors of the calibration as people read them: one row a family."""

from __future__ import annotations

import math
from collections.abc import Iterator

from matest.estimation.calibration import NuisanceEstimate
from matest.estimation.result import Estimate
from matest.report.format import measured

# What page and terminal call the columns.
COLUMNS = ("error of", "size", "one standard deviation", "of the error bars")
TITLE = "Errors of the calibration"
LEGEND = (
    "Size: as estimated with the material, of several the rms of the error; error bars allow for errors that were not "
    "refined. Last column: the parameters whose error bars are mostly theirs."
)


def error_rows(estimate: Estimate) -> Iterator[tuple[str, str, str, str]]:
    """The cells of `COLUMNS`."""
    for name, errors in estimate.nuisance.items():
        spread = _in_unit(errors.prior_std, None, errors.unit)
        yield name, _size(errors), f"{spread} ({errors.origin})", ", ".join(errors.limits)


def _size(errors: NuisanceEstimate) -> str:
    """The errors of a family in a cell."""
    if errors.size is None or not isinstance(errors.value, list) or not isinstance(errors.std, list):
        return "not refined"
    if errors.count == 1:
        return _in_unit(errors.value[0], errors.std[0], errors.unit)
    return f"{_in_unit(errors.size, None, errors.unit)} rms of {errors.count}"


def _in_unit(value: float | None, std: float | None, unit: str) -> str:
    """A number with its unit; an angle in degrees."""
    if value is not None and unit == "rad":
        return f"{measured(math.degrees(value), None if std is None else math.degrees(std))}°"
    return measured(value, std) + ("" if unit == "1" else f" {unit}")
