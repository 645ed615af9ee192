"""A capture that is read wrongly: which mistake in its description explains why no model fits, and how to mend it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from matest.errors import InputError
from matest.estimation.remedies import Diagnosis
from matest.estimators import Problem, Solution, fit
from matest.samples.account import CalibratedSamples
from matest.samples.reading import Reading

# Relative rms error below which no mistake is looked for: the smallest of a wrong transfer function is about as large.
_SUSPICIOUS = 0.05


@dataclass(frozen=True)
class Misreading:
    """A mistake in the description of a capture.

    Attributes:
        causes: its name, such as "normals y down"; of several that look the same, all their names.
        message: what it is, what it does to the fit and what to mend, as sentences.
        relative_rmse_before, relative_rmse_after: of the model as the capture is described, and of the same model with
            the mistake undone, at a few thousand pixels.
        chi2_before, chi2_after: per value, likewise.
        order: of each image the number of the one whose stated lights are its own; empty where each has its own.
    """

    causes: tuple[str, ...]
    message: str
    relative_rmse_before: float
    relative_rmse_after: float
    chi2_before: float
    chi2_after: float
    order: tuple[int, ...] = ()

    @property
    def diagnosis(self) -> Diagnosis:
        """The same, as a result tells it beside other causes of residuals."""
        first, *others = self.causes
        return Diagnosis(first, None, None, "", self.chi2_before, self.chi2_after, self.message, others)


def misreading(problem: Problem, solution: Solution, samples: CalibratedSamples, seed: int) -> Misreading | None:
    """The mistake that explains why a model misses samples grossly; None where it does not, or none explains it.

    Args:
        problem: what was estimated, without errors of the calibration.
        solution: of the fit to the samples.
        samples: that were fitted.
        seed: of the draw of pixels.
    """
    before = solution.statistics
    readings = samples.better_readings() if before.relative_rmse > _SUSPICIOUS else []
    if not readings:
        return None
    try:
        after = fit(problem, readings[0].samples, seed).statistics
    except InputError:
        return None
    if after.relative_rmse >= before.relative_rmse:
        return None
    misses = f"misses the images by {100 * after.relative_rmse:.2g}% instead of {before.relative_rmse:.0%}"
    return Misreading(
        causes=tuple(reading.cause for reading in readings),
        message=f"{_findings(readings)}: {readings[0].instead} the model {misses}. {_mends(readings)}",
        relative_rmse_before=before.relative_rmse,
        relative_rmse_after=after.relative_rmse,
        chi2_before=before.reduced_chi2,
        chi2_after=after.reduced_chi2,
        order=next((reading.order for reading in readings if reading.order), ()),
    )


def misdescribed(samples: CalibratedSamples) -> str:
    """The mistake that leaves no value to fit, and its mend: sentences; empty where none is found."""
    readings = samples.better_readings()
    return f"{_findings(readings)}. {_mends(readings)}" if readings else ""


def _findings(readings: Sequence[Reading]) -> str:
    found = ", or ".join(reading.finding for reading in readings)
    doubt = " (these images do not tell which)" if len(readings) > 1 else ""
    return f"It seems that {found}{doubt}"


def _mends(readings: Sequence[Reading]) -> str:
    first, *others = (reading.mend for reading in readings)
    return " Or ".join([first, *(mend[0].lower() + mend[1:] for mend in others)])
