"""From a fit to one with the errors of the calibration that are to be estimated, and what residuals are due to then."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from matest.estimation.calibration import Calibration, implausible
from matest.estimation.diagnosis import Cause, causes
from matest.estimation.options import Options
from matest.estimators import Solution
from matest.progress import Progress
from matest.samples.account import CalibratedSamples
from matest.samples.uncertainty import Uncertainty, labelled


class Refined(NamedTuple):
    """A fit, and what is known of the calibration's errors.

    Attributes:
        solution: with those that were to be estimated.
        calibration: which errors are reckoned with.
        causes: of residuals, the one that explains most first.
        notes: on what was not refined though it was asked for, as sentences.
    """

    solution: Solution
    calibration: Calibration
    causes: list[Cause]
    notes: Sequence[str] = ()


def refined(
    solution: Solution,
    samples: CalibratedSamples,
    options: Options,
    stated: Uncertainty,
    progress: Progress,
    *,
    misread: bool = False,
) -> Refined:
    """The fit with the errors that options name, or, where they leave that open, with those that explain residuals.

    Error bars reckon with errors that explain residuals and are not estimated as with stated ones.

    Args:
        solution: of the material alone.
        samples: that were fitted.
        options: what to refine.
        stated: of the capture.
        progress: called with a word on what is being done.
        misread: whether the capture is known to be described wrongly: small errors explain nothing of it.

    Raises:
        InputError: errors to refine that have no effect.
    """
    calibration = Calibration.of(options, stated, samples, solution.problem)
    solution = calibration.refine(solution, samples, options.seed, progress)
    found = [] if misread else causes(solution, samples, options.seed, progress)
    notes: list[str] = []
    if options.refines_found:
        sizes = {cause.family: abs(cause.size or 0) for cause in found if cause.refinable}
        further = calibration.refining(sizes)
        again = further.refine(solution, samples, options.seed, progress) if sizes else solution
        beyond = implausible(again)
        if not sizes:
            notes.append("--refine auto: nothing was found that can be refined.")
        elif beyond or not again.converged:
            why = f"errors of {', '.join(map(labelled, beyond))} came out larger than a calibration's are"
            notes.append(
                f"--refine auto: errors of {', '.join(map(labelled, sizes))} were refined and given up: "
                f"{why if beyond else 'the fit did not converge'}."
            )
        else:
            solution, calibration = again, further
            settled = [replace(cause, refined=True) for cause in found if cause.refinable]
            found = [*settled, *causes(solution, samples, options.seed, progress)]
    unsettled = {cause.family: abs(cause.size) for cause in found if cause.size and not cause.refined}
    return Refined(solution, calibration.with_found(unsettled), found, notes)
